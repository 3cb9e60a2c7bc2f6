"""Joint-local values to world: positions, rotations, velocities, angular velocities, level by level.

All quantities of all joints are one array [3, 6, J, ...] inside: component, quantity (position, velocity,
angular velocity, three axes), joint, frames if there are any. A level of the hierarchy then costs one gather
and one sum of three products: it compiles fast, is fast inside the training loss, and needs no 3x3 matrix
product or scatter (the two together crashed jaxlib 0.10.2's CPU compiler under grad of vmap of vmap).
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

POS, VEL, ANG, AXES = 0, 1, 2, slice(3, 6)  # the six quantities, along the second axis


class World(NamedTuple):
    """Joints of one frame in world, or each relative to its parent; clips carry a leading frame axis."""

    pos: Float[Array, "*T J 3"]  # cm
    mat: Float[Array, "*T J 3 3"]  # columns are the joint's axes
    vel: Float[Array, "*T J 3"]  # cm/s
    ang: Float[Array, "*T J 3"]  # rad/s


class Placed(NamedTuple):
    """The bodies of T frames as [component, quantity, joint, frame], in cm, cm/s, rad/s and unit axes."""

    root: Float[Array, "3 6 T"]  # the character's root in world
    local: Float[Array, "3 6 J T"]  # joint 0 in world, the others relative to their parents
    world: Float[Array, "3 6 J T"]


def place(pose: Pose, parents: tuple[int, ...]) -> Placed:
    """Root and joints of T frames in world, frames last, as the training loss compares them (Sec. 3.4).

    Root velocities turn with the previous frame's root, as the features define them; those of the first
    frame with its own, as released.
    """
    turn = jnp.asarray(pose.root.rot)
    joints = _pack_pose(pose, jnp.concatenate([turn[:1], turn[:-1]]))
    world = _chain(joints, _below_root(parents))
    local = jnp.concatenate([world[:, :, 1:2], joints[:, :, 2:]], axis=2)
    return Placed(world[:, :, 0], local, world[:, :, 1:])


def forward(pose: Pose, parents: tuple[int, ...], vel_frame: Float[ArrayLike, "4"] | None = None) -> World:
    """World positions, rotations and velocities of the joints of one pose.

    `vel_frame` is the rotation in whose frame `root_vel` and `root_ang` are given: the previous frame's root
    rotation, as the features define them. None takes the pose's own, as released for a window's first frame.
    """
    frame = pose.root.rot if vel_frame is None else jnp.asarray(vel_frame)
    world = _chain(_pack_pose(pose, frame), _below_root(parents))
    return _unpack(world[:, :, 1:])


def chain(local: World, parents: tuple[int, ...]) -> World:
    """World values of all joints, from joint 0 in world and the others relative to their parents."""
    return _unpack(_chain(_pack(local), parents))


def forward_positions(
    local_pos: Float[ArrayLike, "J 3"], local_rot: Float[ArrayLike, "J 4"], parents: tuple[int, ...]
) -> Float[Array, "J 3"]:
    """World positions (cm) from local positions and quaternions, as a BVH clip holds them."""
    local_pos = jnp.asarray(local_pos)
    still = jnp.zeros_like(local_pos)
    return chain(World(local_pos, quaternion.to_matrix(local_rot), still, still), parents).pos


def axes_positions(
    place: Float[ArrayLike, "T 3"],
    axes: Float[ArrayLike, "T J 2 3"],
    offsets: Float[ArrayLike, "J 3"],
    parents: tuple[int, ...],
) -> Float[Array, "T J 3"]:
    """World positions (cm) of T frames from joint 0's place and local rotations as two axes, made orthonormal.

    Offsets stay what they are in every frame; that of joint 0 is not used. No velocities: a third of `chain`'s work.
    """
    matrices = jnp.transpose(rotation.axes_to_matrix(axes), (2, 3, 1, 0))  # component, axis, joint, frame
    arms, depth_levels = jnp.asarray(offsets), levels(parents)
    places, turns = [jnp.asarray(place).T[:, None]], matrices[:, :, :1]
    for above, level in itertools.pairwise(depth_levels):
        own, parent = np.asarray(level), np.asarray([above.index(parents[joint]) for joint in level])
        turn = turns[:, :, parent]  # world axes of the parents
        x, y, z = arms[own].T[:, None, :, None]
        places.append(places[-1][:, parent] + turn[:, 0] * x + turn[:, 1] * y + turn[:, 2] * z)
        x, y, z = matrices[:, None, :, own]
        turns = turn[:, 0, None] * x + turn[:, 1, None] * y + turn[:, 2, None] * z
    order = np.argsort(np.concatenate([np.asarray(level) for level in depth_levels]))
    return jnp.transpose(jnp.concatenate(places, axis=1)[:, order], (2, 1, 0))


def _chain(joints: Float[Array, "3 6 n *T"], parents: tuple[int, ...]) -> Float[Array, "3 6 n *T"]:
    """Every joint carried by its parent, from the first one outwards."""
    depth_levels = levels(parents)
    done = [joints[:, :, np.asarray(depth_levels[0])]]
    for above, level in itertools.pairwise(depth_levels):
        parent = done[-1][:, :, np.asarray([above.index(parents[joint]) for joint in level])]
        done.append(_carry(parent, joints[:, :, np.asarray(level)]))
    order = np.argsort(np.concatenate([np.asarray(level) for level in depth_levels]))
    return jnp.concatenate(done, axis=2)[:, :, order]


def _carry(parent: Float[Array, "3 6 n *T"], child: Float[Array, "3 6 n *T"]) -> Float[Array, "3 6 n *T"]:
    """Children in world from parents in world; a parent adds its velocity and its spin times the arm."""
    axes = parent[:, AXES]
    turned = axes[:, 0, None] * child[None, 0] + axes[:, 1, None] * child[None, 1] + axes[:, 2, None] * child[None, 2]
    spin, arm = parent[:, ANG], turned[:, POS]
    swing = jnp.stack(
        [
            spin[1] * arm[2] - spin[2] * arm[1],
            spin[2] * arm[0] - spin[0] * arm[2],
            spin[0] * arm[1] - spin[1] * arm[0],
        ]
    )
    moved = [parent[:, POS] + arm, parent[:, VEL] + turned[:, VEL] + swing, spin + turned[:, ANG]]
    return jnp.concatenate([*(x[:, None] for x in moved), turned[:, AXES]], axis=1)


def _pack_pose(pose: Pose, vel_frame: Float[ArrayLike, "*T 4"]) -> Float[Array, "3 6 n *T"]:
    """The root in world, then the joints relative to their parents, those of joint 0 to the root."""
    vel, ang = (quaternion.rotate(vel_frame, v) for v in (pose.root_vel, pose.root_ang))
    root = (pose.root.pos, quaternion.to_matrix(pose.root.rot), vel, ang)
    joints = (pose.joint_pos, rotation.axes_to_matrix(pose.joint_axes), pose.joint_vel, pose.joint_ang)
    axis = vel.ndim - 1
    with_root = (jnp.concatenate([jnp.expand_dims(r, axis), j], axis) for r, j in zip(root, joints, strict=True))
    return _pack(World(*with_root))


def _pack(world: World) -> Float[Array, "3 6 n *T"]:
    """Quantities [*T, J, ...] as one array with the joints and the frames last."""
    columns = jnp.stack([world.pos, world.vel, world.ang], axis=-1)
    packed = jnp.concatenate([columns, world.mat], axis=-1)
    frames = packed.ndim - 3
    return jnp.transpose(packed, (frames + 1, frames + 2, frames, *range(frames)))


def _unpack(packed: Float[Array, "3 6 J"]) -> World:
    """One frame's joints."""
    pos, vel, ang = packed[:, POS].T, packed[:, VEL].T, packed[:, ANG].T
    return World(pos, jnp.moveaxis(packed[:, AXES], -1, 0), vel, ang)


def _below_root(parents: tuple[int, ...]) -> tuple[int, ...]:
    """The hierarchy with the character's root above joint 0."""
    return (-1, *(parent + 1 for parent in parents))
