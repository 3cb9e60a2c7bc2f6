"""Speech of espeak-ng with the time of every word, from the library that comes with the program."""

import ctypes
import ctypes.util
import re

import numpy as np
import soxr

RATE = 16000
RETRIEVAL, UTF8 = 1, 1  # of espeak-ng's speak_lib.h: give the samples back; the text's encoding
WORD = 1  # type of an event
Timed = tuple[str, float, float]  # a word, its start and its end in s


class _Event(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int), ("message", ctypes.c_uint), ("text_position", ctypes.c_int), ("length", ctypes.c_int),
        ("audio_position", ctypes.c_int), ("sample", ctypes.c_int), ("user_data", ctypes.c_void_p),
        ("id", ctypes.c_char * 8),
    )  # fmt: skip


def installed() -> bool:
    """Is the library of espeak-ng here?"""
    return ctypes.util.find_library("espeak-ng") is not None


def speak(text: str, voice: str = "en-us", words_a_minute: int = 150) -> tuple[np.ndarray, list[Timed]]:
    """(samples [n] at 16 kHz, a `Timed` for each word of `text`, which holds plain ASCII).

    OSError where espeak-ng is not installed.
    """
    name = ctypes.util.find_library("espeak-ng")
    if name is None:
        raise OSError("espeak-ng is not installed; apt-get install espeak-ng.")
    library = ctypes.CDLL(name)
    samples: list[np.ndarray] = []
    begun: list[tuple[int, float]] = []  # (first letter, ms)

    @ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.POINTER(_Event))
    def heard(wave, count, events):  # type: ignore[no-untyped-def]
        if wave and count > 0:
            samples.append(np.ctypeslib.as_array(wave, (count,)).copy())
        k = 0
        while events[k].type:
            if events[k].type == WORD:
                begun.append((events[k].text_position - 1, events[k].audio_position / 1000.0))
            k += 1
        return 0

    rate = library.espeak_Initialize(RETRIEVAL, 0, None, 0)
    library.espeak_SetSynthCallback(heard)
    library.espeak_SetVoiceByName(voice.encode())
    library.espeak_SetParameter(1, words_a_minute, 0)
    raw = text.encode()
    library.espeak_Synth(raw, len(raw) + 1, 0, 0, 0, UTF8, None, None)
    library.espeak_Synchronize()
    wave = np.concatenate(samples).astype(np.float32) / 32768.0
    return soxr.resample(wave, rate, RATE), _timed(text, dict(reversed(begun)), wave, rate)


def _timed(text: str, begun: dict[int, float], wave: np.ndarray, rate: int) -> list[Timed]:
    """Words of the text with their times; each ends where the next begins, or before it where silence follows."""
    found = [(match[0], begun[match.start()]) for match in re.finditer(r"\S+", text) if match.start() in begun]
    ends = [start for _, start in found[1:]] + [len(wave) / rate]
    timed = []
    for (word, start), end in zip(found, ends, strict=True):
        piece = np.abs(wave[round(start * rate) : round(end * rate)])
        loud = np.flatnonzero(piece > 0.02 * np.abs(wave).max())
        timed.append((word, start, start + (int(loud[-1]) + 1) / rate if len(loud) else end))
    return timed
