"""How a body moves: speed, acceleration and jerk and how they are distributed, drift, what tells styles apart."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from ..motion import bvh, features
from ..motion.bvh import Clip
from . import movement
from .movement import Movement, Positions

BINS = 50  # of a histogram, from 0 to the truth's 99th percentile; what is above has a bin of its own

Order = Literal[1, 2, 3]  # of a derivative: speed, acceleration, jerk


class Spread(NamedTuple):
    """How a quantity is distributed over frames and joints."""

    mean: float
    std: float
    median: float
    p95: float


class Dynamics(NamedTuple):
    """Lengths of the first three derivatives of joint positions."""

    speed: Spread  # cm/s
    acceleration: Spread  # cm/s^2
    jerk: Spread  # cm/s^3


def world_positions(clip: Clip) -> Positions:
    """World positions of all joints, cm, for every frame."""
    return np.asarray(features.world_positions(clip), np.float64)


def speeds(positions: Positions, rate_hz: float) -> Float[np.ndarray, "T J"]:
    """Speed of every joint, cm/s; frame 0 repeats frame 1."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=-1) * rate_hz
    return np.concatenate([steps[:1], steps])


def hand_speed(clip: Clip) -> Float[np.ndarray, " T"]:
    """Mean speed of both hands relative to the hips, cm/s."""
    skeleton, positions = clip.skeleton, world_positions(clip)
    hands = [skeleton.role("left_hand"), skeleton.role("right_hand")]
    relative = positions[:, hands] - positions[:, [skeleton.role("hips")]]
    return speeds(relative, bvh.rate_hz(clip.frame_time)).mean(axis=1)


def mean_jerk(clip: Clip) -> float:
    """Mean length of the third difference of joint positions times rate cubed, cm/s^3 (GENEA's definition)."""
    third = np.diff(world_positions(clip), n=3, axis=0)
    return float(np.linalg.norm(third, axis=-1).mean() * bvh.rate_hz(clip.frame_time) ** 3)


def root_drift(clip: Clip) -> float:
    """Largest horizontal distance of the hips from where they started, cm."""
    hips = world_positions(clip)[:, clip.skeleton.role("hips")]
    return float(np.linalg.norm((hips - hips[:1])[:, [0, 2]], axis=-1).max())


def style_statistics(clip: Clip) -> Float[np.ndarray, " S"]:
    """What tells styles apart in numbers: means and spreads of heights, reaches and speeds (cm, cm/s).

    Positions are relative to the hips' ground point and in the body's mean heading, so that neither
    where the body stands nor where it looks counts.
    """
    return statistics_of(movement.of(clip))


def statistics_of(motion: Movement) -> Float[np.ndarray, " S"]:
    """`style_statistics` of joint positions."""
    left, right, hips, spine, head = map(motion.skeleton.role, ("left_hand", "right_hand", "hips", "spine", "head"))
    body = movement.in_heading(motion).positions
    pace = np.log(1.0 + speeds(body, motion.rate_hz))
    parts = [body[:, j] for j in (left, right, head, spine, hips)]
    means = [part.mean(axis=0) for part in parts]
    spreads = [10.0 * np.log(1.0 + part.std(axis=0)) for part in parts]
    paces = [20.0 * pace[:, j].mean(keepdims=True) for j in (left, right, head, hips)]
    return np.concatenate([*means, *spreads, *paces])


def in_heading(clip: Clip) -> Positions:
    """World positions relative to the mean hips' ground point, turned so that the shoulders' mean line is x."""
    return movement.in_heading(movement.of(clip)).positions


def derivative(positions: Positions, rate_hz: float, order: Order) -> Float[np.ndarray, "_ J"]:
    """Length of the difference of an order, times rate^order: cm/s, cm/s^2, cm/s^3 (GENEA, with the true rate).

    GENEA's scripts multiply by 30 whatever the rate is.
    """
    return np.linalg.norm(np.diff(positions, n=order, axis=0), axis=-1) * rate_hz**order


def dynamics(motion: Movement, joints: Sequence[int] | None = None) -> Dynamics:
    """Speed, acceleration and jerk over all frames and `joints` (all where left out).

    Third differences of noise grow with the cube of the rate: compare motions of one rate.

    Raises:
        ValueError: fewer than 4 frames, or NaN.
    """
    motion = movement.checked(motion, 4)
    positions = motion.positions if joints is None else motion.positions[:, list(joints)]
    spreads = []
    for order in (1, 2, 3):
        values = derivative(positions, motion.rate_hz, order)
        median, p95 = np.percentile(values, (50, 95)).tolist()
        spreads.append(Spread(float(values.mean()), float(values.std()), median, p95))
    return Dynamics(*spreads)


def hellinger(first: Float[np.ndarray, " B"], second: Float[np.ndarray, " B"]) -> float:
    """Distance of two histograms: sqrt(1 - sum sqrt(p q)), 0 where they are alike, 1 where they share no bin (GENEA).

    Raises:
        ValueError: other numbers of bins, or a histogram that counts nothing.
    """
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if first.shape != second.shape or not (first.sum() > 0 and second.sum() > 0):
        raise ValueError(
            f"histograms of {len(first)} and {len(second)} bins with sums {first.sum():g} and {second.sum():g} "
            "cannot be compared; give two over the same bins, neither empty."
        )
    overlap = np.sqrt(first / first.sum() * (second / second.sum())).sum()
    return float(np.sqrt(max(1.0 - overlap, 0.0)))


def hellinger_of(
    made: Sequence[Movement],
    truth: Sequence[Movement],
    order: Order = 1,
    joints: Sequence[int] | None = None,
    edges: Float[np.ndarray, " B"] | None = None,
) -> float:
    """Hellinger distance between how fast (order 1; 2 acceleration, 3 jerk) the joints of two groups of clips move.

    `edges` of the bins left out are 50 from 0 to the truth's 99th percentile, so that units do not matter; what is
    above the last edge is counted in a bin of its own. GENEA's are `np.arange(0, 50)` cm/s (its histogram's default; or
    every 0.05, with which two samples of one motion are far apart), and what is above is dropped there.

    Raises:
        ValueError: no clips, skeletons or rates that differ, fewer than 4 frames, NaN, or a truth that stands still.
    """
    names = [f"{group} motion {k + 1}" for group, clips in (("made", made), ("true", truth)) for k in range(len(clips))]
    if not made or not truth:
        raise ValueError(f"got {len(made)} made and {len(truth)} true motions to compare; give one or more of each.")
    both = movement.alike([*made, *truth], 4, names)
    edges = edges_of(truth, order, joints) if edges is None else edges
    counts = [histogram(motion, order, edges, joints) for motion in both]
    return hellinger(np.sum(counts[: len(made)], axis=0), np.sum(counts[len(made) :], axis=0))


def edges_of(truth: Sequence[Movement], order: Order, joints: Sequence[int] | None = None) -> Float[np.ndarray, " B"]:
    """Edges of 50 bins from 0 to the truth's 99th percentile; ValueError for a truth that stands still."""
    values = np.concatenate([_lengths(motion, order, joints) for motion in truth])
    if not (top := float(np.percentile(values, 99))) > 0.0:
        raise ValueError("the true motion stands still, so its speeds have no range; give motion that moves.")
    return np.linspace(0.0, top, BINS + 1)


def histogram(
    motion: Movement, order: Order, edges: Float[np.ndarray, " B"], joints: Sequence[int] | None = None
) -> Float[np.ndarray, " B"]:
    """How often a derivative's length is between two edges, and above the last."""
    counts, _ = np.histogram(_lengths(motion, order, joints), np.append(edges, np.inf))
    return counts.astype(np.float64)


def _lengths(motion: Movement, order: Order, joints: Sequence[int] | None) -> Float[np.ndarray, " n"]:
    positions = motion.positions if joints is None else motion.positions[:, list(joints)]
    return derivative(positions, motion.rate_hz, order).ravel()
