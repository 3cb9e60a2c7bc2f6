"""What tells styles apart in one half of the body alone: statistics that the other half has no share in."""

import numpy as np
from jaxtyping import Float

from . import kinematic
from .movement import Movement, checked


def statistics(motion: Movement, half: str) -> Float[np.ndarray, " S"]:
    """Means, spreads and speeds of the joints of a half (cm, cm/s), as `kinematic.style_statistics` has them.

    Of the upper half: hands, elbows, head and spine from the hips of the same frame, in the shoulders' mean heading. Of
    the lower half: hips and knees from the middle of the feet, in the mean heading of the thighs.

    Raises:
        ValueError: another half, a skeleton without these joints, fewer than two frames, NaN.
    """
    motion = checked(motion)
    if half not in ("upper", "lower"):
        raise ValueError(f"a body has no half called {half!r}; choose upper or lower.")
    body = _upper(motion) if half == "upper" else _lower(motion)
    pace = np.log(1.0 + kinematic.speeds(body, motion.rate_hz)).mean(axis=0)
    return np.concatenate([body.mean(axis=0).ravel(), 10.0 * np.log(1.0 + body.std(axis=0)).ravel(), 20.0 * pace])


def _upper(motion: Movement) -> Float[np.ndarray, "T K 3"]:
    skeleton, place = motion.skeleton, motion.positions
    hands = [skeleton.role("left_hand"), skeleton.role("right_hand")]
    elbows = [skeleton.parents[hand] for hand in hands]
    shoulders = [skeleton.parents[elbow] for elbow in elbows]
    joints = [*hands, *elbows, skeleton.role("head"), skeleton.role("spine")]
    return _turned(place[:, joints] - place[:, [skeleton.role("hips")]], place[:, shoulders])


def _lower(motion: Movement) -> Float[np.ndarray, "T K 3"]:
    skeleton, place, hips = motion.skeleton, motion.positions, motion.skeleton.role("hips")
    feet = [skeleton.role("left_foot"), skeleton.role("right_foot")]
    knees = [skeleton.parents[foot] for foot in feet]
    thighs = [skeleton.path(foot)[skeleton.path(foot).index(hips) + 1] for foot in feet]
    middle = place[:, feet].mean(axis=1, keepdims=True)
    return _turned(place[:, [hips, *knees]] - middle, place[:, thighs])


def _turned(body: Float[np.ndarray, "T K 3"], pair: Float[np.ndarray, "T 2 3"]) -> Float[np.ndarray, "T K 3"]:
    """The body so that the mean line from the pair's second joint to its first is x."""
    across = (pair[:, 0] - pair[:, 1]).mean(axis=0)
    angle = np.arctan2(across[2], across[0])
    cos, sin = np.cos(angle), np.sin(angle)
    return body @ np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]).T
