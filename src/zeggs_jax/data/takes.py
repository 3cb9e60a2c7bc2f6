"""One entry of a corpus -> its training clips: silenced, trimmed, paced, centred, of one length."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from zeggs_jax.data.corpus import Entry
from zeggs_jax.motion import bvh, edit
from zeggs_jax.speech import features, wav

MIN_FRAMES = 8  # velocities of the first frame need 4, the statistics drop 2 at either end
MAX_MISMATCH_S = 0.5


class Take(NamedTuple):
    """A clip of motion and the speech to it, both from time 0."""

    name: str
    entry: Entry
    clip: bvh.Clip
    wave: np.ndarray  # [n], 16 kHz, loudness as recorded


def takes(
    entry: Entry, pace: tuple[float, ...] = (1.0,), rate_hz: float | None = None, centre: bool = True,
    as_released: bool = False,
) -> Iterator[Take]:  # fmt: skip
    """One take per pace; a pace below 1 is faster. ValueError names the file that does not fit.

    `as_released`: centring by the yaw quaternion as the release leaves it (not normalised), and speech that
    may be longer or shorter than the motion. Otherwise both are cut to the shorter, and refused when they
    differ by more than 0.5 s.
    """
    clip, wave = _synchronised(entry)
    if rate_hz is not None and rate_hz != bvh.rate_hz(clip.frame_time):
        with naming(entry.bvh):
            clip = edit.resample(clip, rate_hz)
    if not as_released:
        clip, wave = _same_length(entry, clip, wave)
    if len(clip.euler) < MIN_FRAMES:
        raise ValueError(f"'{entry.bvh}' has {len(clip.euler)} usable frames, {MIN_FRAMES} are needed; leave it out.")
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


@contextmanager
def naming(file: object) -> Iterator[None]:
    """Puts the file's name in front of a ValueError raised inside."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"'{file}': {error}") from error


def _synchronised(entry: Entry) -> tuple[bvh.Clip, np.ndarray]:
    """Both files, cut to the acted part, with nobody else's voice."""
    clip, wave = bvh.read(entry.bvh), wav.read(entry.wav)
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
    samples = min(len(wave), round(frames / rate_hz * wav.RATE_HZ))
    with naming(entry.bvh):
        return edit.trim(clip, 0, frames), wave[:samples]
