"""Whose skeleton it is: its limbs, its stature, and where left, up and front are in every joint's frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np

from zeggs_jax.motion import kinematics
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.features import local_quaternions
from zeggs_jax.motion.skeleton import Skeleton

TIPS = ("head", "left_hand", "right_hand", "left_foot", "right_foot")


class Sample(NamedTuple):
    """A few frames of a clip in world space, from which a body takes its measures."""

    pos: np.ndarray  # [F, J, 3]
    mat: np.ndarray  # [F, J, 3, 3] joint -> world

    def seen_from(self, joint: int, other: int) -> np.ndarray:
        """[3] where `other` is in the frame of `joint`, on average."""
        return self.into(joint, self.pos[:, other] - self.pos[:, joint])

    def into(self, joint: int, vector: np.ndarray, frames: np.ndarray | slice = slice(None)) -> np.ndarray:
        """[3] a world vector `[F, 3]` turned into the frame of `joint`, on average over the chosen frames."""
        return np.einsum("fba,fb->fa", self.mat[frames, joint], vector[frames]).mean(axis=0)


def world(clip: Clip, frames: Sequence[int] | np.ndarray) -> Sample:
    """Some frames of a clip in world.

    Kinematics gives places; rotations are read off three pointers, one metre long, fixed to every joint.
    """
    frames, count = np.asarray(frames), len(clip.skeleton)
    clip = clip._replace(euler=clip.euler[frames], positions=clip.positions[frames])
    parents = (*clip.skeleton.parents, *np.repeat(np.arange(count), 3).tolist())
    pointers = np.tile(100.0 * np.eye(3), (len(frames), count, 1))
    straight = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (len(frames), 3 * count, 4))
    places = np.concatenate([clip.positions, pointers], axis=1, dtype=np.float32)
    turns = np.concatenate([local_quaternions(clip), straight], axis=1, dtype=np.float32)
    pos = np.asarray(_forward(places, turns, parents), np.float64)
    pos, ends = pos[:, :count], pos[:, count:].reshape(len(frames), count, 3, 3)
    return Sample(pos, np.swapaxes(ends - pos[:, :, None], -1, -2) / 100.0)


_forward = jax.jit(jax.vmap(kinematics.forward_positions, in_axes=(0, 0, None)), static_argnums=2)


def at_rest(clip: Clip) -> Skeleton:
    """The skeleton with bones as the frames show them: some files keep all of them in position channels."""
    offsets = np.median(clip.positions, axis=0)
    offsets[0] = clip.skeleton.offsets[0]
    return replace(clip.skeleton, offsets=offsets)


class Limb(NamedTuple):
    """A chain of joints from the trunk outwards, with the place of shoulder and elbow, or hip and knee."""

    joints: tuple[int, ...]
    start: int  # places in `joints`
    middle: int


class Anatomy(NamedTuple):
    """A skeleton with its parts named and measured, in its own length unit."""

    skeleton: Skeleton
    sample: Sample
    spine: tuple[int, ...]  # from the pelvis to the head; empty when the body is not recognised
    limbs: dict[str, Limb]  # left_hand, right_hand, left_foot, right_foot
    stature: float
    left: np.ndarray  # [J, 3] the body's left, up and front in the frame of every joint
    up: np.ndarray
    front: np.ndarray
    facing: float  # mean heading about world y, radians; 0 looks along +z


def study(skeleton: Skeleton, sample: Sample) -> Anatomy:
    """Name and measure a body; `spine` and `limbs` stay empty where the joint names say too little."""
    spine, limbs = find_limbs(skeleton)
    hip, other = (limbs[role].joints[0] if limbs else 0 for role in ("left_foot", "right_foot"))
    left_world = level(sample.pos[:, hip] - sample.pos[:, other])
    front_world = np.cross(left_world, [0.0, 1.0, 0.0])
    up_world = np.broadcast_to([0.0, 1.0, 0.0], left_world.shape)
    joints = range(len(skeleton.parents))
    axes = np.stack([[sample.into(j, axis) for j in joints] for axis in (left_world, up_world, front_world)])
    if limbs and (rest := rest_axes(skeleton, spine, limbs)) is not None:
        axes = np.broadcast_to(rest[:, None], axes.shape)
    axes = unit(axes)
    facing = float(np.arctan2(front_world[:, 0].sum(), front_world[:, 2].sum()))
    left, up, front = axes
    tall = stature(sample, spine, limbs)
    return Anatomy(skeleton, sample, spine, limbs, tall, left, up, front, facing)


def find_limbs(skeleton: Skeleton) -> tuple[tuple[int, ...], dict[str, Limb]]:
    """The way from the pelvis to the head, and the four limbs, from the joints' roles and the tree alone."""
    try:
        tips = {role: skeleton.role(role) for role in TIPS}
    except ValueError:
        return (), {}
    way = {role: ancestry(skeleton.parents, joint) for role, joint in tips.items()}
    pelvis = fork(way["left_foot"], way["right_foot"])
    chest = fork(way["left_hand"], way["right_hand"])
    if any(at not in way["head"] for at in (pelvis, chest)) or pelvis == chest:
        return (), {}
    chains = {}
    for role in TIPS[1:]:
        base = chest if role.endswith("hand") else pelvis
        if base not in way[role]:
            return (), {}
        chains[role] = tuple(way[role][way[role].index(base) + 1 :])
    spine = tuple(way["head"][way["head"].index(pelvis) :])
    if len(spine) < 3 or any(len(chain) < 3 for chain in chains.values()):
        return (), {}
    return spine, {role: Limb(chain, *hinge(skeleton, chain)) for role, chain in chains.items()}


def ancestry(parents: Sequence[int], joint: int) -> list[int]:
    """Joints from the root to `joint`, both included."""
    way = [joint]
    while parents[way[-1]] >= 0:
        way.append(parents[way[-1]])
    return way[::-1]


def fork(one: Sequence[int], other: Sequence[int]) -> int:
    """The last joint that two ways from the root share."""
    return [a for a, b in zip(one, other, strict=False) if a == b][-1]


def hinge(skeleton: Skeleton, chain: Sequence[int]) -> tuple[int, int]:
    """Places of the shoulder and elbow (hip and knee) in a chain: the split into the two most equal halves.

    Collar bones in front and twist joints come in all numbers, under all names; lengths do not lie.
    """
    along = np.concatenate([[0.0], np.cumsum([np.linalg.norm(skeleton.offsets[j]) for j in chain[1:]])])
    best, found = np.inf, (0, 1)
    for start in range(len(chain) - 2):
        for middle in range(start + 1, len(chain) - 1):
            upper, lower = along[middle] - along[start], along[-1] - along[middle]
            uneven = abs(upper - lower) / max(upper + lower, 1e-9)
            if uneven < best - 1e-6 and upper > 0.25 * along[-1]:
                best, found = uneven, (start, middle)
    return found


def stature(sample: Sample, spine: Sequence[int], limbs: dict[str, Limb]) -> float:
    """Standing height from the bones between sole and head, in any pose; else the height the clip fills."""
    if not limbs:
        size = np.ptp(sample.pos.reshape(-1, 3), axis=0)
        return float(max(size[1], 0.5 * size.max(), 1e-6))
    legs = [limbs[role].joints[limbs[role].start :] for role in ("left_foot", "right_foot")]
    return float(max((np.mean([way_length(sample, leg) for leg in legs]) + way_length(sample, spine)) / 0.862, 1e-6))


def way_length(sample: Sample, joints: Sequence[int]) -> float:
    """Length of the way along these joints in the first frame."""
    pos = sample.pos[0, list(joints)]
    return float(np.linalg.norm(np.diff(pos, axis=0), axis=-1).sum())


def rest_axes(skeleton: Skeleton, spine: Sequence[int], limbs: dict[str, Limb]) -> np.ndarray | None:
    """[3, 3] left, up and front of the rest pose, or None where that is no body standing upright."""
    pos = np.zeros((len(skeleton.parents), 3))
    for joint, parent in enumerate(skeleton.parents):
        pos[joint] = skeleton.offsets[joint] + (pos[parent] if parent >= 0 else 0.0)
    up = pos[spine[-1]] - pos[spine[0]]
    feet = [pos[limbs[role].joints[-1]] - pos[limbs[role].joints[0]] for role in ("left_foot", "right_foot")]
    left = level(pos[limbs["left_foot"].joints[0]] - pos[limbs["right_foot"].joints[0]])
    standing = unit(up)[1] > 0.9 and all(unit(foot)[1] < -0.6 for foot in feet) and left.any()
    return np.stack([left, [0.0, 1.0, 0.0], np.cross(left, [0.0, 1.0, 0.0])]) if standing else None


def level(vector: np.ndarray) -> np.ndarray:
    """The horizontal direction of a vector (0 where it has none)."""
    return unit(vector * [1.0, 0.0, 1.0])


def unit(vector: np.ndarray) -> np.ndarray:
    """Length one along the last axis; a zero vector stays zero."""
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)
