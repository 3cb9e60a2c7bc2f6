"""Kinematic measures of a clip: hand speed, jerk, root drift, and the statistics that tell styles apart."""

import numpy as np
from jaxtyping import Float

from ..motion import bvh, features
from ..motion.bvh import Clip

Positions = Float[np.ndarray, "T J 3"]


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
    skeleton, positions = clip.skeleton, world_positions(clip)
    shoulders = [skeleton.parents[skeleton.parents[skeleton.role(hand)]] for hand in ("left_hand", "right_hand")]
    across = (positions[:, shoulders[0]] - positions[:, shoulders[1]]).mean(axis=0)
    angle = np.arctan2(across[2], across[0])
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    origin = positions[:, skeleton.role("hips")].mean(axis=0) * np.array([1.0, 0.0, 1.0])
    return (positions - origin) @ turn.T
