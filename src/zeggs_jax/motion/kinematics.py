"""Joint-local values to world: positions, rotations, velocities, angular velocities, level by level.

Written for one frame; `vmap` over frames and clips. Rotations are multiplied entry by entry with the joints
on the last axis: that runs fast inside the training loss, and needs no 3x3 matrix product or scatter (the
two together crashed jaxlib 0.10.2's CPU compiler under grad of vmap of vmap).
"""

import itertools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from zeggs_jax.geometry import quaternion, rotation
from zeggs_jax.motion.pose import Pose
from zeggs_jax.motion.skeleton import levels


class World(NamedTuple):
    """Joints of one frame in world (`place_root`: joint 0 in world, the rest relative to their parents)."""

    pos: Float[Array, "J 3"]  # cm
    mat: Float[Array, "J 3 3"]  # columns are the joint's axes
    vel: Float[Array, "J 3"]  # cm/s
    ang: Float[Array, "J 3"]  # rad/s


def place_root(pose: Pose, vel_frame: Float[ArrayLike, "4"] | None = None) -> World:
    """Joint 0 moved from the root's frame to world, the others as they are (ZeroEGGS Sec. 3.4).

    `vel_frame` is the rotation in whose frame `root_vel` and `root_ang` are given: the previous frame's root
    rotation, as the features define them. None takes the pose's own, as released for a window's first frame.
    """
    turn = pose.root.rot
    frame = turn if vel_frame is None else jnp.asarray(vel_frame)
    root_vel, root_ang = quaternion.rotate(frame, pose.root_vel), quaternion.rotate(frame, pose.root_ang)
    arm = quaternion.rotate(turn, pose.joint_pos[0])
    mat = rotation.axes_to_matrix(pose.joint_axes)
    vel = root_vel + quaternion.rotate(turn, pose.joint_vel[0]) + jnp.cross(root_ang, arm)
    ang = root_ang + quaternion.rotate(turn, pose.joint_ang[0])
    mat_0 = _product(quaternion.to_matrix(turn)[..., None], mat[0][..., None])[..., 0]

    def with_first(first: Array, rest: Array) -> Array:
        return jnp.concatenate([first[None], rest[1:]])

    return World(
        with_first(pose.root.pos + arm, pose.joint_pos),
        with_first(mat_0, mat),
        with_first(vel, pose.joint_vel),
        with_first(ang, pose.joint_ang),
    )


def chain(local: World, parents: tuple[int, ...]) -> World:
    """World values of all joints, from joint 0 in world and the others relative to their parents."""
    pos, vel, ang = (x.T for x in (local.pos, local.vel, local.ang))
    mat = jnp.moveaxis(local.mat, 0, -1)
    depth_levels = levels(parents)
    first = np.asarray(depth_levels[0])
    done = [(pos[:, first], mat[..., first], vel[:, first], ang[:, first])]
    for above, level in itertools.pairwise(depth_levels):
        joints = np.asarray(level)
        parent = np.asarray([above.index(parents[joint]) for joint in level])
        p_pos, p_mat, p_vel, p_ang = (x[..., parent] for x in done[-1])
        arm = _turn(p_mat, pos[:, joints])
        done.append(
            (
                p_pos + arm,
                _product(p_mat, mat[..., joints]),
                p_vel + _turn(p_mat, vel[:, joints]) + _cross(p_ang, arm),
                p_ang + _turn(p_mat, ang[:, joints]),
            )
        )
    order = np.argsort(np.concatenate([np.asarray(level) for level in depth_levels]))
    pos, mat, vel, ang = (jnp.concatenate(parts, axis=-1)[..., order] for parts in zip(*done, strict=True))
    return World(pos.T, jnp.moveaxis(mat, -1, 0), vel.T, ang.T)


def forward(pose: Pose, parents: tuple[int, ...], vel_frame: Float[ArrayLike, "4"] | None = None) -> World:
    """World positions, rotations and velocities of one pose's joints; see `place_root` for `vel_frame`."""
    return chain(place_root(pose, vel_frame), parents)


def forward_positions(
    local_pos: Float[ArrayLike, "J 3"], local_rot: Float[ArrayLike, "J 4"], parents: tuple[int, ...]
) -> Float[Array, "J 3"]:
    """World positions (cm) from local positions and quaternions, as a BVH clip holds them."""
    local_pos = jnp.asarray(local_pos)
    still = jnp.zeros_like(local_pos)
    return chain(World(local_pos, quaternion.to_matrix(local_rot), still, still), parents).pos


def _turn(mat: Float[Array, "3 3 n"], v: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
    """Matrix times vector, joints last."""
    return mat[:, 0] * v[0] + mat[:, 1] * v[1] + mat[:, 2] * v[2]


def _product(a: Float[Array, "3 3 n"], b: Float[Array, "3 3 n"]) -> Float[Array, "3 3 n"]:
    """Matrix times matrix, joints last."""
    return a[:, 0, None] * b[None, 0] + a[:, 1, None] * b[None, 1] + a[:, 2, None] * b[None, 2]


def _cross(a: Float[Array, "3 n"], b: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
    """Cross product, joints last."""
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
