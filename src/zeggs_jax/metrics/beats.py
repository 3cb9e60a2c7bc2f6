"""Beats of motion against sounds and stressed words: beat consistency, beat alignment, alignment with stresses.

All times are seconds from the first frame, so that the rates of audio frames and motion frames cannot be mixed up.
Speech has several onsets a second: with sigma 0.3 s a motion that beats at random scores about 0.8. A score means
something only beside that of the same speech moved in time, which `Agreement.shifted` is.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.signal import argrelextrema, find_peaks

from .movement import Movement, checked, from_hips
from .rhythm import Agreement, against_chance

ORDER = 7.0 / 30.0  # s to both sides within which a beat is the slowest moment: 7 frames at 30 Hz (EMAGE)
MOVING = 0.10  # of the joint's mean speed: what is slower rests and has no beats (EMAGE)
SIGMA = 0.3  # s: how far a beat may be from a sound and still count (EMAGE; TalkSHOW takes 0.5)
STRESS_SIGMA = 0.1  # s: a stressed syllable lasts about 0.2 s
PROMINENCE = 0.5  # of the mean speed: how much a stroke is faster, or a stop slower, than what is around it
ONSET_HOP = 512  # samples at 16 kHz (EMAGE)

Times = Float[np.ndarray, " _"]  # s, from the first frame, rising


Moments = Literal["strokes", "stops"]


class Stresses(NamedTuple):
    """How well moments of the hands fall on stressed words."""

    agreement: Agreement
    lag: float  # s, median: positive where the hands come after the stress; NaN without moments or stresses


def path_speed(path: Float[np.ndarray, "T 3"], rate_hz: float) -> Float[np.ndarray, " T"]:
    """Speed by central differences, cm/s; one-sided in the first and last frame."""
    return np.linalg.norm(np.gradient(np.asarray(path, np.float64), axis=0), axis=-1) * rate_hz


def motion_beats(
    path: Float[np.ndarray, "T 3"], rate_hz: float, mean_speed: float | None = None, moving: float = MOVING
) -> Times:
    """Moments in which a joint is slower than in all others within 7/30 s, but not at rest (EMAGE's beats).

    `mean_speed` (cm/s) is the joint's over a corpus; left out, over this path. A joint that is slower than `moving` of
    it rests.

    Raises:
        ValueError: fewer than 3 frames, or NaN.
    """
    path = _finite(path)
    speed = path_speed(path, rate_hz)
    usual = float(speed.mean()) if mean_speed is None else mean_speed
    lowest = argrelextrema(speed, np.less, order=max(1, round(ORDER * rate_hz)))[0]
    return lowest[speed[lowest] > moving * usual] / rate_hz


def strokes(path: Float[np.ndarray, "T 3"], rate_hz: float) -> Times:
    """Moments that are faster than the movement before and after by half the mean speed or more.

    Raises:
        ValueError: fewer than 3 frames, or NaN.
    """
    return _turns(path, rate_hz, 1.0)


def stops(path: Float[np.ndarray, "T 3"], rate_hz: float) -> Times:
    """Moments that are slower than the movement before and after by half the mean speed or more: ends of strokes.

    Unlike `motion_beats` they may be full stops, and trembling at rest is none.

    Raises:
        ValueError: fewer than 3 frames, or NaN.
    """
    return _turns(path, rate_hz, -1.0)


def _turns(path: Float[np.ndarray, "T 3"], rate_hz: float, sign: float) -> Times:
    speed = path_speed(_finite(path), rate_hz)
    if not speed.mean() > 0.0:
        return np.zeros(0)
    return find_peaks(sign * speed, prominence=PROMINENCE * speed.mean())[0] / rate_hz


def closeness(events: Times, others: Times, sigma: float = SIGMA) -> float:
    """Mean over events of exp(-d^2 / (2 sigma^2)), d the time to the nearest of the others; 0 where there are none."""
    events, others = np.asarray(events, np.float64), np.asarray(others, np.float64)
    if not events.size or not others.size:
        return 0.0
    apart = np.abs(events[:, None] - others[None, :]).min(axis=1)
    return float(np.exp(-np.square(apart) / (2.0 * sigma**2)).mean())


def consistency(motion: Sequence[Times], sounds: Times, sigma: float = SIGMA) -> float:
    """Beat consistency (BC; Liu et al. 2022): how near each sound is to a beat of each joint, mean over joints.

    It grows with the number of beats, so a trembling body scores well; see `alignment`.
    """
    return float(np.mean([closeness(sounds, beats, sigma) for beats in motion])) if len(motion) else 0.0


def alignment(motion: Sequence[Times], sounds: Times, sigma: float = SIGMA) -> float:
    """Beat alignment (AIST++, Li et al. 2021): how near each beat of a joint is to a sound, mean over joints.

    AIST++ takes a sigma of 3 frames at 60 Hz (0.05 s), for music.
    """
    return float(np.mean([closeness(beats, sounds, sigma) for beats in motion])) if len(motion) else 0.0


def joint_beats(motion: Movement, joints: Sequence[int] | None = None) -> list[Times]:
    """Beats of the hands (or other joints), measured from the hips.

    Raises:
        ValueError: fewer than 3 frames, NaN, or a skeleton without hips or hands.
    """
    body = from_hips(checked(motion, 3))
    joints = [body.skeleton.role(hand) for hand in ("left_hand", "right_hand")] if joints is None else joints
    return [motion_beats(body.positions[:, joint], body.rate_hz) for joint in joints]


def with_speech(motion: Movement, sounds: Times, joints: Sequence[int] | None = None) -> tuple[Agreement, Agreement]:
    """Consistency and alignment of the hands' beats with the onsets of speech (s), each beside chance.

    Raises:
        ValueError: less than 3 s of motion, onsets that are no times of it, or what `joint_beats` refuses.
    """
    found, seconds = joint_beats(motion, joints), len(motion.positions) / motion.rate_hz
    sounds = _times(sounds, seconds)
    consistent = against_chance(lambda shift: consistency(found, moved(sounds, shift, seconds)), seconds)
    aligned = against_chance(lambda shift: alignment(found, moved(sounds, shift, seconds)), seconds)
    return consistent, aligned


def with_stresses(
    motion: Movement, stresses: Times, moments: Moments = "strokes", joints: Sequence[int] | None = None
) -> Stresses:
    """How near each stressed syllable (s, known from a transcript) is to a stroke of a hand, beside chance.

    The stroke of a gesture falls on the stressed syllable or just before it (McNeill 1992). Speakers differ in whether
    the fastest moment ("strokes") or the end of the stroke ("stops") is on it; compare like with like.

    Raises:
        ValueError: less than 3 s of motion, stresses that are no times of it, NaN, a skeleton without hips or hands.
    """
    body, seconds = from_hips(checked(motion, 3)), len(motion.positions) / motion.rate_hz
    stresses, find = _times(stresses, seconds), strokes if moments == "strokes" else stops
    joints = [body.skeleton.role(hand) for hand in ("left_hand", "right_hand")] if joints is None else joints
    found = np.unique(np.concatenate([find(body.positions[:, joint], body.rate_hz) for joint in joints]))
    score = against_chance(lambda shift: closeness(moved(stresses, shift, seconds), found, STRESS_SIGMA), seconds)
    if not found.size or not stresses.size:
        return Stresses(score, float("nan"))
    lags = found[None, :] - stresses[:, None]
    nearest = lags[np.arange(len(stresses)), np.abs(lags).argmin(axis=1)]
    return Stresses(score, float(np.median(nearest)))


def moved(times: Times, shift: float, seconds: float) -> Times:
    """Times moved in a circle of `seconds`."""
    return np.sort((np.asarray(times, np.float64) + shift) % seconds)


def onsets(wave: Float[np.ndarray, " n"], rate_hz: int = 16000) -> Times:
    """Onsets of a mono recording as EMAGE takes them: librosa's, hop 512 at 16 kHz. The first call takes seconds.

    Raises:
        ValueError: another rate, for which the published scores say nothing.
    """
    if rate_hz != 16000:
        raise ValueError(f"onsets are taken at 16000 Hz, got {rate_hz}; resample the recording (speech.wav.read does).")
    from librosa.onset import onset_detect  # several seconds to import

    return np.asarray(onset_detect(y=np.asarray(wave, np.float32), sr=rate_hz, hop_length=ONSET_HOP, units="time"))


def _times(times: Times, seconds: float) -> Times:
    times = np.asarray(times, np.float64)
    if not np.isfinite(times).all() or (times.size and not (times.min() >= 0.0 and times.max() <= seconds)):
        raise ValueError(
            f"times from {times.min():g} to {times.max():g} s are not all within the {seconds:.2f} s of the motion; "
            "give seconds from its first frame."
        )
    return np.sort(times)


def _finite(path: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T 3"]:
    path = np.asarray(path, np.float64)
    if len(path) < 3:
        raise ValueError(f"a path of {len(path)} frames is too short for beats; give 3 or more.")
    if not np.isfinite(path).all():
        raise ValueError("a path holds NaN or infinite places; mend or leave out the clip.")
    return path
