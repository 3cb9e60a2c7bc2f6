"""The motion of one body as every measure takes it: joint positions in cm, their rate in Hz, their skeleton."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..motion import bvh, features
from ..motion.bvh import Clip
from ..motion.skeleton import Skeleton

Positions = Float[np.ndarray, "T J 3"]
ENDS = ("hips", "head", "left_hand", "right_hand", "left_foot", "right_foot")  # roles between which the body is


class Movement(NamedTuple):
    """T frames of J joints. A measure that needs to know where up is takes the y axis."""

    positions: Positions  # cm, world
    rate_hz: float  # frames per second
    skeleton: Skeleton


def of(clip: Clip) -> Movement:
    """What a clip's joints do in world."""
    positions = np.asarray(features.world_positions(clip), np.float64)
    return Movement(positions, bvh.rate_hz(clip.frame_time), clip.skeleton)


def checked(movement: Movement, frames: int = 2, name: str = "the motion") -> Movement:
    """The same motion in float64.

    Raises:
        ValueError: fewer than `frames` frames, not one place per joint, a place that is no number, no rate.
    """
    positions, joints = np.asarray(movement.positions, np.float64), len(movement.skeleton)
    if positions.ndim != 3 or positions.shape[1:] != (joints, 3):
        raise ValueError(
            f"{name} is an array of shape {positions.shape}; give [frames, {joints}, 3] for this skeleton."
        )
    if len(positions) < frames:
        raise ValueError(f"{name} has {len(positions)} frames, too few to measure; give {frames} or more.")
    if not (np.isfinite(movement.rate_hz) and movement.rate_hz > 0):
        raise ValueError(f"{name} runs at {movement.rate_hz} Hz; give its frames per second.")
    if not np.isfinite(positions).all():
        frame, joint = np.argwhere(~np.isfinite(positions))[0][:2]
        raise ValueError(
            f"{name} has no place for joint '{movement.skeleton.names[joint]}' in frame {frame} (NaN or infinite); "
            "mend or leave out the clip."
        )
    return movement._replace(positions=positions)


def alike(movements: Sequence[Movement], frames: int = 2, names: Sequence[str] = ()) -> list[Movement]:
    """Motions of one skeleton at one rate, in float64.

    Raises:
        ValueError: there is none, one of them is not fit (see `checked`), or two differ in skeleton or rate.
    """
    if not movements:
        raise ValueError("there is no motion to measure; give at least one.")
    names = names or [f"motion {k + 1}" for k in range(len(movements))]
    found = [checked(m, frames, name) for m, name in zip(movements, names, strict=True)]
    for other, name in zip(found[1:], names[1:], strict=True):
        _same_body(found[0].skeleton, other.skeleton, names[0], name)
        if not np.isclose(other.rate_hz, found[0].rate_hz, rtol=5e-4):
            raise ValueError(
                f"{names[0]} runs at {found[0].rate_hz:g} Hz and {name} at {other.rate_hz:g} Hz; "
                "resample one of them (motion.edit.resample)."
            )
    return found


def pair(made: Movement, truth: Movement, frames: int = 2) -> tuple[Movement, Movement]:
    """Two motions to compare frame by frame; see `alike`; ValueError too where their lengths differ."""
    made, truth = alike([made, truth], frames, ["the made motion", "the truth"])
    if len(made.positions) != len(truth.positions):
        raise ValueError(
            f"the made motion has {len(made.positions)} frames and the truth {len(truth.positions)}; "
            "cut them to one length."
        )
    return made, truth


def _same_body(a: Skeleton, b: Skeleton, a_name: str, b_name: str) -> None:
    if a.names == b.names and a.parents == b.parents:
        return
    first = next((x for x, y in zip(a.names, b.names, strict=False) if x != y), None)
    difference = f"first different joint: '{first}'" if first else "their joints or hierarchies differ"
    raise ValueError(
        f"{a_name} has a skeleton of {len(a)} joints and {b_name} another of {len(b)}, {difference}; "
        "measure motions of one skeleton."
    )


def major(skeleton: Skeleton) -> list[int]:
    """The joints from the hips to head, hands and feet: what shows posture and gesture, without fingers and ends."""
    known = [role for role in ENDS if getattr(skeleton.roles, role) is not None]
    start = skeleton.path(skeleton.role("hips"))[:-1]
    return sorted({joint for role in known for joint in skeleton.path(skeleton.role(role))} - set(start))


def from_hips(movement: Movement) -> Movement:
    """Positions relative to the hips of the same frame."""
    hips = movement.positions[:, [movement.skeleton.role("hips")]]
    return movement._replace(positions=movement.positions - hips)


def in_heading(movement: Movement) -> Movement:
    """Positions relative to the mean hips' ground point, turned so that the shoulders' mean line is x."""
    skeleton, positions = movement.skeleton, movement.positions
    shoulders = [skeleton.parents[skeleton.parents[skeleton.role(hand)]] for hand in ("left_hand", "right_hand")]
    across = (positions[:, shoulders[0]] - positions[:, shoulders[1]]).mean(axis=0)
    angle = np.arctan2(across[2], across[0])
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    origin = positions[:, skeleton.role("hips")].mean(axis=0) * np.array([1.0, 0.0, 1.0])
    return movement._replace(positions=(positions - origin) @ turn.T)


def sampled(movement: Movement, rate_hz: float) -> Movement:
    """The motion at another rate, positions between frames on straight lines; it starts with the same frame.

    Of a rate that is not lower than the motion's own, or of smooth motion, nothing is lost; see `motion.edit.resample`
    for clips.
    """
    frames = len(movement.positions)
    count = int((frames - 1) * rate_hz / movement.rate_hz + 1e-9) + 1
    at = np.minimum(np.arange(count) * (movement.rate_hz / rate_hz), frames - 1)
    before = np.minimum(at.astype(int), max(frames - 2, 0))
    after = np.minimum(before + 1, frames - 1)
    share = (at - before)[:, None, None]
    positions = (1.0 - share) * movement.positions[before] + share * movement.positions[after]
    return Movement(positions, rate_hz, movement.skeleton)
