"""A recording for a take: sentences spoken, cut to whole frames, heard through a microphone."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from zeggs_jax.synthetic import sentences, voice
from zeggs_jax.synthetic.voice import Word

WORDS_PER_SECOND = 2.7


class Recording(NamedTuple):
    """Speech for a take at 16 kHz; `words` is empty when their times are unknown."""

    wave: Float32[np.ndarray, " n"]
    text: str
    words: Sequence[Word]
    speaker: str


def speak(seconds: float | int, seed: int, text: str | None = None) -> Recording:
    """About `seconds` of sentences, or `text`, by a random synthetic voice; words with exact times."""
    text = sentences.monologue(seed, int(WORDS_PER_SECOND * seconds)) if text is None else text
    wave, words = voice.speak(text, seed, lead=lead_silence(seed))
    return Recording(wave, text, words, "synthetic")


def lead_silence(seed: int) -> float:
    """Seconds before the first word: usually a moment, in every eighth clip a few seconds."""
    draw = np.random.default_rng([seed, 31])
    return float(draw.uniform(1.5, 4.0) if draw.random() < 0.125 else draw.uniform(0.15, 0.6))


def swell(wave: Float[np.ndarray, " n"], seed: int) -> Float32[np.ndarray, " n"]:
    """The speech with a loudness that wanders over 9 dB, and a level of its own between -30 and -16 dB."""
    draw = np.random.default_rng([seed, 37])
    knots = np.arange(0.0, len(wave) / voice.RATE + 2.5, 2.5)
    gain = np.interp(np.arange(len(wave)) / voice.RATE, knots, draw.uniform(-6.0, 3.0, len(knots)))
    louder = wave.astype(np.float64) * 10.0 ** (gain / 20.0)
    level = np.sqrt(np.mean(louder**2)) + 1e-9
    wanted = 10.0 ** (draw.uniform(-30.0, -16.0) / 20.0)
    return (louder * min(wanted / level, 0.98 / max(float(np.abs(louder).max()), 1e-9))).astype(np.float32)


def fit(recording: Recording, seconds: float | int, rate_hz: int, seed: int) -> tuple[Recording, int]:
    """The recording cut or padded to `seconds`, exactly a whole number of frames; and that number."""
    frames = round(seconds * rate_hz)
    samples = round(frames * voice.RATE / rate_hz)
    wave = recording.wave[:samples]
    if len(wave) < samples:
        wave = np.pad(wave, (0, samples - len(wave)))
    else:
        fade = min(480, samples)
        wave = np.concatenate([wave[:-fade], wave[-fade:] * np.linspace(1.0, 0.0, fade, dtype=np.float32)])
    kept = [w for w in recording.words if w.end < samples / voice.RATE]
    return recording._replace(wave=swell(wave, seed), words=kept), frames


def room(wave: Float[np.ndarray, " n"], seed: int) -> Float32[np.ndarray, " n"]:
    """The speech as a microphone might hear it: tilted by up to 4 dB an octave, with noise 25 to 65 dB lower.

    Without this, pauses would be digital silence, which no real recording has.
    """
    draw = np.random.default_rng([seed, 43])
    hz = np.fft.rfftfreq(len(wave), 1.0 / voice.RATE)
    octaves = np.log2(np.clip(hz, 100.0, 7000.0) / 1000.0)
    spoken = np.fft.irfft(np.fft.rfft(wave) * 10.0 ** (draw.uniform(-4.0, 2.0) * octaves / 20.0), len(wave))
    colour = 10.0 ** (draw.uniform(-6.0, 0.0) * octaves / 20.0)  # white to brown
    noise = np.fft.irfft(np.fft.rfft(draw.standard_normal(len(wave))) * colour, len(wave))
    level = np.sqrt(np.mean(spoken**2)) * 10.0 ** (-draw.uniform(25.0, 65.0) / 20.0)
    heard = spoken + noise * level / max(float(np.sqrt(np.mean(noise**2))), 1e-12)
    return (heard * min(1.0, 0.98 / max(float(np.abs(heard).max()), 1e-9))).astype(np.float32)
