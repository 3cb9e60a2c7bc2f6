"""The state of the body in one frame: `Pose` with its `Root`, packed and unpacked, moved on and looked from.

Names of the release: root_vel = root_vel, root_ang = root_vrt, joint_pos = lpos, joint_axes = ltxy,
joint_vel = lvel, joint_ang = lvrt (ZeroEGGS Sec. 3.1). The root is the character on the ground: below the
spine, turned with the hips. Joint values are relative to the parent joint; those of joint 0 to the root.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from zeggs_jax.geometry import quaternion, rotation


class Root(NamedTuple):
    """Where the character stands and faces, in world."""

    pos: Float[Array, "*b 3"]  # cm, y = 0
    rot: Float[Array, "*b 4"]  # wxyz, a turn about y


class Pose(NamedTuple):
    """One frame of J joints; motions carry a leading frame axis."""

    root: Root
    root_vel: Float[Array, "*b 3"]  # cm/s, in the frame of the previous root
    root_ang: Float[Array, "*b 3"]  # rad/s, scaled axis, in the frame of the previous root
    joint_pos: Float[Array, "*b J 3"]  # cm
    joint_axes: Float[Array, "*b J 2 3"]  # turned x and y axis
    joint_vel: Float[Array, "*b J 3"]  # cm/s
    joint_ang: Float[Array, "*b J 3"]  # rad/s, scaled axis


def size(joints: int) -> int:
    """Length of the vector of a pose: 1131 for 75 joints."""
    return 6 + 15 * joints


def to_vector(pose: Pose) -> Float[Array, "*b D"]:
    """The network's form [6 + 15 J]: root velocities, joint positions, axes, velocities, angular ones."""
    lead = pose.root_vel.shape[:-1]
    parts = [jnp.asarray(part).reshape(*lead, -1) for part in pose[1:]]
    return jnp.concatenate(parts, axis=-1)


def from_vector(vector: Float[ArrayLike, "*b D"], root: Root) -> Pose:
    """Inverse of `to_vector`; the root is not in the vector and is given. Of a numpy array the parts are views."""
    packed: Any = vector if isinstance(vector, np.ndarray) else jnp.asarray(vector)
    lead, joints = packed.shape[:-1], (packed.shape[-1] - 6) // 15
    if packed.shape[-1] != size(joints):
        raise ValueError(f"A pose vector has 6 + 15 J numbers, got {packed.shape[-1]}.")
    cuts = [0, 3, 6, 6 + 3 * joints, 6 + 9 * joints, 6 + 12 * joints, size(joints)]
    root_vel, root_ang, pos, axes, vel, ang = (packed[..., start:stop] for start, stop in pairwise(cuts))
    return Pose(
        root=root,
        root_vel=root_vel,
        root_ang=root_ang,
        joint_pos=pos.reshape(*lead, joints, 3),
        joint_axes=axes.reshape(*lead, joints, 2, 3),
        joint_vel=vel.reshape(*lead, joints, 3),
        joint_ang=ang.reshape(*lead, joints, 3),
    )


def integrate(
    root: Root, root_vel: Float[ArrayLike, "*b 3"], root_ang: Float[ArrayLike, "*b 3"], frame_time: ArrayLike
) -> Root:
    """The root one frame later, moved by velocities (cm/s, rad/s) in its own frame (ZeroEGGS Sec. 3.4).

    The rotation is not renormalised, as released.
    """
    pos = root.pos + quaternion.rotate(root.rot, jnp.asarray(root_vel) * frame_time)
    turn = quaternion.from_scaled_axis(quaternion.rotate(root.rot, jnp.asarray(root_ang) * frame_time))
    return Root(pos, quaternion.multiply(turn, root.rot))


def velocities(root: Root, after: Root, frame_time: ArrayLike) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 3"]]:
    """Inverse of `integrate`: the velocities (cm/s, rad/s, in the frame of `root`) that lead to `after`."""
    away = quaternion.inverse(root.rot)
    turn = quaternion.positive(quaternion.multiply(after.rot, away))
    ang = quaternion.to_scaled_axis(turn) / frame_time
    return quaternion.rotate(away, (after.pos - root.pos) / frame_time), quaternion.rotate(away, ang)


def blend_roots(before: Root, after: Root, weight: Float[ArrayLike, "*b"]) -> Root:
    """From `before` (weight 0) to `after` (1): positions in a line, rotations the shorter way, w >= 0."""
    weight = jnp.asarray(weight)
    pos = before.pos + weight[..., None] * (after.pos - before.pos)
    opposite = jnp.sum(before.rot * after.rot, axis=-1, keepdims=True) < 0
    rot = quaternion.slerp(before.rot, jnp.where(opposite, -after.rot, after.rot), weight)
    return Root(pos, quaternion.positive(rot))


def blend_axes(
    before: Float[ArrayLike, "*b 2 3"], after: Float[ArrayLike, "*b 2 3"], weight: Float[ArrayLike, "*#b"]
) -> Float[Array, "*b 2 3"]:
    """From rotation `before` (weight 0) to `after` (1): axes in a line, made orthonormal again.

    Of two that are 0.5 rad apart the blend is within 1e-3 rad of constant speed.
    """
    before, after = jnp.asarray(before), jnp.asarray(after)
    mixed = before + jnp.asarray(weight)[..., None, None] * (after - before)
    return rotation.matrix_to_axes(rotation.axes_to_matrix(mixed))


def mirror(pose: Pose, across: Sequence[int]) -> Pose:
    """The image in the plane x = 0 (ZeroEGGS Sec. 4.1); `across` names every joint's counterpart.

    A rotation R becomes M R M with M = diag(-1, 1, 1). Bones take the offsets of the other side.
    """
    joints = np.asarray(across)
    seen, turned = np.array([-1.0, 1.0, 1.0], np.float32), np.array([1.0, -1.0, -1.0], np.float32)

    def times(x: Float[ArrayLike, "..."], signs: np.ndarray) -> Array:
        x = jnp.asarray(x)
        return x * signs.reshape((1,) * (x.ndim - signs.ndim) + signs.shape)

    return Pose(
        root=Root(times(pose.root.pos, seen), times(pose.root.rot, np.array([1, 1, -1, -1], np.float32))),
        root_vel=times(pose.root_vel, seen),
        root_ang=times(pose.root_ang, turned),
        joint_pos=times(pose.joint_pos[..., joints, :], seen),
        joint_axes=times(pose.joint_axes[..., joints, :, :], np.stack([turned, seen])),
        joint_vel=times(pose.joint_vel[..., joints, :], seen),
        joint_ang=times(pose.joint_ang[..., joints, :], turned),
    )


def gaze_direction(root: Root, target: Float[ArrayLike, "*b 3"]) -> Float[Array, "*b 3"]:
    """From the root to a world point `target` (cm), in the root's frame; not normalised, as released."""
    return quaternion.rotate(quaternion.inverse(root.rot), jnp.asarray(target) - root.pos)


def relative(root: Root, origin: Root) -> Root:
    """`root` seen from `origin`: where `origin` becomes the world's origin, facing +Z."""
    back = quaternion.inverse(origin.rot)
    return Root(quaternion.rotate(back, root.pos - origin.pos), quaternion.multiply(back, root.rot))


def rebase(pose: Pose, origin: Root) -> Pose:
    """The same pose in a world whose origin and +Z are those of `origin`; only the root changes."""
    return pose._replace(root=relative(pose.root, origin))
