"""Rhythm: does the body move when the voice sounds, more than it would by chance."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

MIN_SHIFT = 1.0  # s: speech moved by less than this still half fits
SHIFT_STEP = 0.25  # s


class Agreement(NamedTuple):
    """How well motion goes with speech, and the same against speech moved in time, which is what chance gets."""

    matched: float
    shifted: float  # mean of the same over shifted speech
    share_below: float  # share of shifts that correlate less than the match


def smooth(signal: Float[np.ndarray, " T"], rate_hz: float, seconds: float = 0.2) -> Float[np.ndarray, " T"]:
    """Moving average over `seconds`, edges held."""
    width = max(1, round(seconds * rate_hz)) | 1
    padded = np.pad(signal, width // 2, mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def correlation(a: Float[np.ndarray, " T"], b: Float[np.ndarray, " T"]) -> float:
    """Pearson's r; 0 when either is constant."""
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0.0 else 0.0


def agreement(
    speed: Float[np.ndarray, " T"], energy: Float[np.ndarray, " E"], rate_hz: float, max_lag: float = 0.2
) -> Agreement:
    """Pearson's r of smoothed hand speed and smoothed speech energy, at the best lag within +-max_lag seconds.

    The comparison moves the speech in a circle by every quarter second from MIN_SHIFT on, with the same
    freedom of lag, so that it keeps the speech's own rhythm and loses only its timing.

    Raises:
        ValueError: lengths differ, or the clip is too short to shift.
    """
    if len(speed) != len(energy):
        raise ValueError(f"hand speed has {len(speed)} frames and speech {len(energy)}; cut them to one length.")
    if len(speed) < 3 * MIN_SHIFT * rate_hz:
        raise ValueError(f"{len(speed)} frames are too few to shift by {MIN_SHIFT:g} s; use 3 s or more.")
    speed, energy = smooth(speed, rate_hz), smooth(energy, rate_hz)
    lags = range(-round(max_lag * rate_hz), round(max_lag * rate_hz) + 1)

    def best(shift: float) -> float:
        moved = np.roll(energy, round(shift * rate_hz))
        return max(correlation(speed, np.roll(moved, lag)) for lag in lags)

    return against_chance(best, len(speed) / rate_hz)


def against_chance(score: Callable[[float], float], seconds: float) -> Agreement:
    """A `score` of speech moved in a circle by so many seconds: unmoved, and by every quarter second from 1 s on.

    Raises:
        ValueError: less than 3 s.
    """
    if seconds < 3 * MIN_SHIFT:
        raise ValueError(f"{seconds:.1f} s are too short to shift by {MIN_SHIFT:g} s; use 3 s or more.")
    moved = np.array([score(shift) for shift in np.arange(MIN_SHIFT, seconds - MIN_SHIFT, SHIFT_STEP).tolist()])
    matched = score(0.0)
    return Agreement(matched, float(moved.mean()), float((moved < matched).mean()))
