"""One entry of a corpus -> its training clips: silenced, trimmed, upright, paced, centred, of one length."""

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from zeggs_jax.data import body as bodies
from zeggs_jax.data.body import BodyConfig
from zeggs_jax.data.entry import Entry
from zeggs_jax.motion import bvh, edit
from zeggs_jax.speech import features, wav

MIN_FRAMES = 8  # velocities of the first frame need 4, the statistics drop 2 at either end
MAX_MISMATCH_S = 0.5
SPEECH_RMS = 1e-3  # -60 dB: in the loudest 50 ms any speech is above it
STILL_RAD = 1e-4  # a joint that turns less does not move
FOUND = BodyConfig()  # all of it
BROKEN = (RuntimeError, ArithmeticError, LookupError, MemoryError, TypeError, AttributeError, EOFError)


class Take(NamedTuple):
    """A clip of motion and the speech to it, both from time 0."""

    name: str
    entry: Entry
    clip: bvh.Clip
    wave: np.ndarray  # [n], 16 kHz, loudness as recorded


def takes(
    entry: Entry, pace: tuple[float, ...] = (1.0,), rate_hz: float | None = None, centre: bool = True,
    as_released: bool = False, body: BodyConfig = FOUND, min_frames: int = MIN_FRAMES,
) -> Iterator[Take]:  # fmt: skip
    """One take per pace; a pace below 1 is faster. ValueError or OSError names the file that does not fit.

    The body is brought to centimetres, y up and +z ahead as `body` says. Refused are files that do not read,
    speech and motion whose lengths differ by more than 0.5 s (both are cut to the shorter), no speech, no motion,
    values that are not finite, and fewer than `min_frames` frames.

    `as_released`: centring by the yaw quaternion as the release leaves it (not normalised), speech that may be
    longer, shorter or silent, and a body that is changed only where `body` says so.
    """
    clip, wave = _synchronised(entry)
    _check_transcript(entry)
    if as_released:
        body = as_given(body)
    else:
        _check_moves(entry, clip)
    with naming(entry.bvh):
        clip = bodies.normalise(clip, body, str(entry.bvh))
        if rate_hz is not None and rate_hz != bvh.rate_hz(clip.frame_time):
            clip = edit.resample(clip, rate_hz)
    if not as_released:
        clip, wave = _same_length(entry, clip, wave)
        _check_speech(entry, wave)
    if len(clip.euler) < min_frames:
        raise ValueError(f"'{entry.bvh}' has {len(clip.euler)} usable frames, {min_frames} are needed; leave it out.")
    for factor in pace:
        name, paced, paced_wave = entry.name, clip, wave
        if factor != 1.0:
            with naming(entry.bvh):
                paced = edit.retime(clip, factor)
            with naming(entry.wav):
                paced_wave = wav.retime(wave, factor).astype(np.float32)
        if len(pace) > 1:
            name = f"{entry.name}_x_" + str(float(factor)).replace(".", "_")
        if centre:
            with naming(entry.bvh):
                paced = edit.centre(paced, as_released=as_released)
        yield Take(name, entry, paced, paced_wave)


def body_of(entries: Iterable[Entry], body: BodyConfig, as_released: bool = False) -> BodyConfig:
    """`body` with all that it leaves open found from the first clip that tells, so that all are read alike."""
    body = as_given(body) if as_released else body
    for entry in entries:
        try:
            clip, _ = _synchronised(entry)
            return bodies.resolve(clip, body, str(entry.bvh))
        except (ValueError, OSError):
            continue  # whoever makes this clip will say why
    return body


def as_given(body: BodyConfig) -> BodyConfig:
    """What `body` says, and where it says nothing the files as they are, as the release takes them."""
    given = {name: value for name, value in vars(body).items() if value not in (None, "auto")}
    axes = None if body.facing != "auto" else ()
    return replace(bodies.AS_IS, **{"axes": axes, **given})


@contextmanager
def naming(file: object) -> Iterator[None]:
    """Puts the file's name in front of a ValueError raised inside, unless it is there."""
    try:
        yield
    except ValueError as error:
        if str(error).startswith(f"'{file}'"):
            raise
        raise ValueError(f"'{file}': {error}") from error


@contextmanager
def _reading(file: Path) -> Iterator[None]:
    """One sentence that names the file for whatever goes wrong in reading it."""
    try:
        yield
    except ValueError as error:
        told = " ".join(str(error).split())
        raise ValueError(told if file.name in told else f"'{file}': {told}") from error
    except FileNotFoundError:
        raise
    except OSError as error:
        raise OSError(f"'{file}' cannot be read: {error.strerror or error}; check the file.") from error
    except BROKEN as error:
        told = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise ValueError(f"'{file}' is damaged and does not read ({told}); export it again.") from error


def _synchronised(entry: Entry) -> tuple[bvh.Clip, np.ndarray]:
    """Both files, cut to the acted part, with nobody else's voice."""
    with _reading(entry.bvh):
        clip = bvh.read(entry.bvh)
    with _reading(entry.wav):
        wave = wav.read(entry.wav)
    for values in (clip.euler, clip.positions):
        if not np.isfinite(values).all():
            raise ValueError(f"'{entry.bvh}' holds values that are NaN or infinite; export the motion again.")
    if entry.sync is None:
        return clip, wave
    wave = wav.silence(wave, entry.sync.speaking_s)
    start, stop = (round(time * wav.RATE_HZ) for time in entry.sync.audio_s)
    first, last = (round(time * bvh.rate_hz(clip.frame_time)) for time in entry.sync.motion_s)
    if first >= len(clip.euler) or start >= len(wave):
        raise ValueError(f"'{entry.name}' starts to act after its recording ends; check its time codes in info.csv.")
    with naming(entry.bvh):
        return edit.trim(clip, first, min(last, len(clip.euler))), wave[start:stop]


def _check_transcript(entry: Entry) -> None:
    if entry.transcript is None or entry.transcript.suffix.lower() not in (".json", ".txt"):
        return  # whoever reads its times checks the others
    with _reading(entry.transcript):
        try:
            text = entry.transcript.read_text(encoding="utf-8-sig")
            if entry.transcript.suffix.lower() == ".json":
                json.loads(text)
        except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
            kind = "JSON" if entry.transcript.suffix.lower() == ".json" else "UTF-8 text"
            raise ValueError(f"'{entry.transcript}' is not {kind} ({error}); mend or remove it.") from error


def _check_moves(entry: Entry, clip: bvh.Clip) -> None:
    if len(clip.euler) > 1 and np.ptp(clip.euler, axis=0).max() < STILL_RAD:
        raise ValueError(f"'{entry.bvh}' holds one pose that never moves; export the motion again or leave it out.")


def _check_speech(entry: Entry, wave: np.ndarray) -> None:
    """The loudest 50 ms must be as loud as the quietest speech."""
    block = wav.RATE_HZ // 20
    blocks = np.resize(wave, (max(1, len(wave) // block), block)) if len(wave) else np.zeros((1, 1))
    loudest = float(blocks.std(axis=1).max())
    if loudest < SPEECH_RMS:
        level = f"{20 * np.log10(loudest):.0f} dB" if loudest > 0 else "digital silence"
        raise ValueError(f"'{entry.wav}' has no speech (its loudest part is {level}); record again or leave it out.")


def _same_length(entry: Entry, clip: bvh.Clip, wave: np.ndarray) -> tuple[bvh.Clip, np.ndarray]:
    """Cut to the shorter of the two."""
    rate_hz = bvh.rate_hz(clip.frame_time)
    motion_s, speech_s = len(clip.euler) / rate_hz, len(wave) / wav.RATE_HZ
    if abs(motion_s - speech_s) > MAX_MISMATCH_S:
        raise ValueError(
            f"'{entry.bvh}' lasts {motion_s:.2f} s and '{entry.wav.name}' {speech_s:.2f} s, at most "
            f"{MAX_MISMATCH_S} s apart was expected; cut them to the same span."
        )
    frames = min(len(clip.euler), features.frame_count(len(wave), rate_hz))
    if frames < 1:
        raise ValueError(f"'{entry.wav}' lasts {speech_s:.3f} s, less than a frame; leave it out.")
    samples = min(len(wave), round(frames / rate_hz * wav.RATE_HZ))
    with naming(entry.bvh):
        return edit.trim(clip, 0, frames), wave[:samples]
