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
    left, right, hips, spine, head = map(clip.skeleton.role, ("left_hand", "right_hand", "hips", "spine", "head"))
    body = in_heading(clip)
    pace = np.log(1.0 + speeds(body, bvh.rate_hz(clip.frame_time)))
    parts = [body[:, j] for j in (left, right, head, spine, hips)]
    means = [part.mean(axis=0) for part in parts]
    spreads = [10.0 * np.log(1.0 + part.std(axis=0)) for part in parts]
    paces = [20.0 * pace[:, j].mean(keepdims=True) for j in (left, right, head, hips)]
    return np.concatenate([*means, *spreads, *paces])


def in_heading(clip: Clip) -> Positions:
    """World positions relative to the mean hips' ground point, turned so that the shoulders' mean line is x."""
    return movement.in_heading(movement.of(clip)).positions


def derivative(positions: Positions, rate_hz: float, order: Order) -> Float[np.ndarray, "T-order J"]:
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
    chosen = slice(None) if joints is None else list(joints)
    found = [derivative(m.positions[:, chosen], m.rate_hz, order).ravel() for m in both]
    ours, theirs = np.concatenate(found[: len(made)]), np.concatenate(found[len(made) :])
    if edges is None:
        if not (top := float(np.percentile(theirs, 99))) > 0.0:
            raise ValueError("the true motion stands still, so its speeds have no range; give motion that moves.")
        edges = np.linspace(0.0, top, BINS + 1)
    open_ended = np.append(edges, np.inf)
    return hellinger(*(np.histogram(values, open_ended)[0].astype(np.float64) for values in (ours, theirs)))
