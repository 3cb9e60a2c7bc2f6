"""Feet on the ground: skating while they should stand, floating, sinking into the floor."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..motion.skeleton import Skeleton
from .movement import Movement, alike, checked

STANDING = 5.0  # percentile of a joint's height over the truth that counts as standing
NEAR = 2.5  # cm above standing: still on the ground
LIFTING = 20.0  # cm/s up or down: a foot that is put down or lifted does not stand
SUNK = 0.5  # cm below standing that are no fault yet


class Ground(NamedTuple):
    """Heights at which a body's feet stand."""

    joints: tuple[int, ...]  # of the feet, and their toes where there are
    heights: Float[np.ndarray, " K"]  # cm, world


class Feet(NamedTuple):
    """How feet keep to the ground."""

    skate: float  # cm/s, mean horizontal speed of joints that stand; 0 when none ever does
    standing: float  # share of joints and frames that stand
    floating: float  # share of frames in which no joint of either foot is near the ground or below it
    sunk: float  # cm, mean depth of joints below the ground, over all frames


def ground(truth: Sequence[Movement]) -> Ground:
    """Where the feet of a body stand: a low percentile (5) of each joint's height over recorded motion.

    Raises:
        ValueError: no motion, motions of different skeletons or rates, no feet.
    """
    truth = alike(truth, 1)
    joints = contacts(truth[0].skeleton)
    heights = np.concatenate([movement.positions[:, joints, 1] for movement in truth])
    return Ground(tuple(joints), np.percentile(heights, STANDING, axis=0))


def contacts(skeleton: Skeleton) -> list[int]:
    """The feet and their first children (toes), where there are; ValueError for a skeleton without feet."""
    feet = [skeleton.role(role) for role in ("left_foot", "right_foot")]
    toes = [next((j for j, parent in enumerate(skeleton.parents) if parent == foot), None) for foot in feet]
    return sorted({*feet, *(toe for toe in toes if toe is not None)})


def measure(movement: Movement, on: Ground | None = None) -> Feet:
    """Skating, floating and sinking on a ground; left out, the motion's own, which hides most of the latter two.

    A joint stands while it is less than 2.5 cm above its standing height and neither rises nor falls faster than
    20 cm/s. How fast it slides does not decide that it stands: with the usual limit on the speed itself feet
    that slide faster would count less. Float and penetration as in Motius' physical metrics.

    Raises:
        ValueError: fewer than 2 frames, NaN, no feet, or a ground of another skeleton.
    """
    movement = checked(movement)
    on = ground([movement]) if on is None else on
    if list(on.joints) != contacts(movement.skeleton):
        raise ValueError("the ground was measured on another skeleton; measure it on recorded motion of this one.")
    positions = movement.positions[:, list(on.joints)]
    velocity = np.diff(positions, axis=0) * movement.rate_hz
    above = positions[1:, :, 1] - on.heights
    stands = (above < NEAR) & (np.abs(velocity[..., 1]) < LIFTING)
    sliding = np.linalg.norm(velocity[..., [0, 2]], axis=-1)
    return Feet(
        skate=float(sliding[stands].mean()) if stands.any() else 0.0,
        standing=float(stands.mean()),
        floating=float((above >= NEAR).all(axis=1).mean()),
        sunk=float(np.maximum(-above - SUNK, 0.0).mean()),
    )
