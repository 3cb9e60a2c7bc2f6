"""Factors of a style (lean, hand height, tempo, ...) read off a motion: kinematic measures, then ridge regression.

The regression is fitted on clips whose factors are known; what it is worth is its error on other such clips, which
belongs beside every error that is measured with it.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..motion import bvh
from ..motion.bvh import Clip
from ..motion.skeleton import Skeleton
from . import kinematic
from .kinematic import Positions

SMALLEST = 1e-3  # cm, cm/s: what logarithms take for nothing


class Ruler(NamedTuple):
    """A linear map from standardised measures and their squares to factors."""

    names: tuple[str, ...]  # of the F factors
    mean: Float[np.ndarray, " S"]
    spread: Float[np.ndarray, " S"]
    weights: Float[np.ndarray, "2*S F"]
    offset: Float[np.ndarray, " F"]


def measures(clip: Clip) -> Float[np.ndarray, " S"]:
    """What factors show in: `style_statistics`, then pitches, heights, fingers, and how abruptly the hands move.

    Neither place nor heading of the body counts. Lengths in cm, pitches in rad, the rest logarithms of ratios.

    Raises:
        ValueError: fewer than 8 frames, or a skeleton without hips, spine, head or hands.
    """
    if len(clip.euler) < 8:
        raise ValueError(f"a clip of {len(clip.euler)} frames is too short to measure; give 8 or more.")
    body, rate_hz = kinematic.in_heading(clip), bvh.rate_hz(clip.frame_time)
    parts = (_trunk(body, clip.skeleton), _hands(body, clip.skeleton), _abruptness(body, clip.skeleton, rate_hz))
    return np.concatenate([kinematic.style_statistics(clip), *parts])


def fit(
    measured: Float[np.ndarray, "N S"], factors: Float[np.ndarray, "K F"], names: Sequence[str], ridge: float = 3.0
) -> Ruler:
    """The ruler with the smallest squared error on N = K clips of known factors, its weights held down by `ridge`.

    Raises:
        ValueError: the numbers of clips, or of factors and names, differ; or fewer than two clips.
    """
    if len(measured) != len(factors) or factors.shape[1] != len(names) or len(factors) < 2:
        raise ValueError(
            f"got measures of {len(measured)} clips, and {factors.shape[1]} factors of {len(factors)} with "
            f"{len(names)} names; give two clips or more, one row each, and one name for each factor."
        )
    mean, spread = measured.mean(axis=0), measured.std(axis=0) + 1e-6
    inputs = _inputs((measured - mean) / spread)
    scale = factors.std(axis=0) + 1e-12
    offset, centre = factors.mean(axis=0), inputs.mean(axis=0)
    inner = inputs - centre
    square = inner.T @ inner + ridge * np.eye(inputs.shape[1])
    weights = np.linalg.solve(square, inner.T @ ((factors - offset) / scale)) * scale
    return Ruler(tuple(names), mean, spread, weights, offset - centre @ weights)


def recover(ruler: Ruler, measured: Float[np.ndarray, "*b S"]) -> Float[np.ndarray, "*b F"]:
    """Factors of clips from their measures, in the factors' own units."""
    return _inputs((measured - ruler.mean) / ruler.spread) @ ruler.weights + ruler.offset


def _inputs(z: Float[np.ndarray, "*b S"]) -> Float[np.ndarray, "*b 2*S"]:
    """Measures and their squares, held within four spreads so that one odd measure cannot carry a factor away."""
    z = np.clip(z, -4.0, 4.0)
    return np.concatenate([z, z * z / 4.0], axis=-1)


def _pitch(direction: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, " T"]:
    """Forward lean of directions in the body's heading, rad from upright."""
    return np.arctan2(direction[:, 2], direction[:, 1])


def _trunk(body: Positions, skeleton: Skeleton) -> Float[np.ndarray, " K"]:
    """Pitch of trunk and head with their spread, height of hips and shoulders, swing of the hips."""
    hips, head = skeleton.role("hips"), skeleton.role("head")
    arms = [_up(skeleton, skeleton.role(hand), 2) for hand in ("left_hand", "right_hand")]
    chest = _up(skeleton, arms[0], 2)
    tip = next((j for j, parent in enumerate(skeleton.parents) if parent == head), None)
    skull = body[:, head] - body[:, skeleton.parents[head]] if tip is None else body[:, tip] - body[:, head]
    trunk, nod = _pitch(body[:, chest] - body[:, hips]), _pitch(skull)
    lifted = (body[:, arms] - body[:, [chest]]).mean(axis=(0, 1))
    sway = body[:, hips, 0]
    return np.array(
        [
            trunk.mean(), nod.mean(), np.log(nod.std() + SMALLEST), np.log(np.ptp(nod) + SMALLEST),
            np.log(np.abs(np.diff(nod)).mean() + 1e-2 * SMALLEST), lifted[1], lifted[2],
            *np.percentile(body[:, hips, 1], (5, 50, 95)), np.log(sway.std() + SMALLEST),
            _log_ratio(np.abs(np.diff(sway)).mean(), sway.std()),
        ]
    )  # fmt: skip


def _hands(body: Positions, skeleton: Skeleton) -> Float[np.ndarray, " K"]:
    """Where the hands are from their shoulders, how far their paths spread, how open fingers and palms are."""
    parts = []
    for side, hand in ((1.0, skeleton.role("left_hand")), (-1.0, skeleton.role("right_hand"))):
        place = (body[:, hand] - body[:, _up(skeleton, hand, 2)]) * np.array([side, 1.0, 1.0])
        parts.append([*np.percentile(place, (10, 50, 90), axis=0).ravel(), *_fingers(body, skeleton, hand, side)])
    left, right = np.array(parts)
    return np.concatenate([0.5 * (left + right), left - right])


def _fingers(body: Positions, skeleton: Skeleton, hand: int, side: float) -> tuple[float, float, float]:
    """(mean distance of the finger tips from the wrist, from each other, how far the palm looks up); 0 without any."""
    tips = _tips(skeleton, hand)
    if len(tips) < 3:
        return 0.0, 0.0, 0.0
    arms = body[:, tips] - body[:, [hand]]
    across = side * np.cross(arms[:, 1], arms[:, -1])
    facing = across / (np.linalg.norm(across, axis=-1, keepdims=True) + 1e-9)
    apart = np.linalg.norm(np.diff(arms, axis=1), axis=-1)
    return float(np.linalg.norm(arms, axis=-1).mean()), float(apart.mean()), float(facing[:, 1].mean())


def _abruptness(body: Positions, skeleton: Skeleton, rate_hz: float) -> Float[np.ndarray, " K"]:
    """Of both hands: how fast they are, how the fast moments compare with all, and how quickly speed changes."""
    hands = [skeleton.role("left_hand"), skeleton.role("right_hand")]
    path = body[:, hands] - body[:, [skeleton.role("hips")]]
    lengths = [np.linalg.norm(np.diff(path, n=n, axis=0), axis=-1) * rate_hz**n for n in (1, 2, 3)]
    left, right = (float(np.log(lengths[0][:, k].mean() + SMALLEST)) for k in range(2))
    quick = np.percentile(lengths[0].max(axis=1), (50, 75, 90, 98))
    return np.array(
        [
            0.5 * (left + right), left - right, *np.log(quick + SMALLEST),
            *(_log_ratio(b.mean(), a.mean()) for a, b in pairwise(lengths)),
            *(_log_ratio(np.percentile(b, 95), np.percentile(a, 95)) for a, b in pairwise(lengths)),
        ]
    )  # fmt: skip


def _log_ratio(a: float, b: float) -> float:
    return float(np.log((a + SMALLEST) / (b + SMALLEST)))


def _up(skeleton: Skeleton, joint: int, steps: int) -> int:
    """The joint `steps` nearer to the root, or the root."""
    for _ in range(steps):
        joint = max(skeleton.parents[joint], 0)
    return joint


def _tips(skeleton: Skeleton, hand: int) -> list[int]:
    """The ends of the chains below the hand, in the skeleton's order."""
    below = {hand}
    for joint, parent in enumerate(skeleton.parents):
        if parent in below:
            below.add(joint)
    inner = set(skeleton.parents)
    return sorted(joint for joint in below - {hand} if joint not in inner)
