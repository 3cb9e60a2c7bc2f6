"""`Clip` to `Motion`, the features that the networks read, and back (ZeroEGGS Sec. 3.1).

Computed in float64, returned in float32. Frames are padded to a power of two inside, so that clips of any
length share a few compiled programs.
"""

from collections.abc import Callable
from functools import partial
from itertools import zip_longest
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from zeggs_jax.geometry import quaternion, rotation
from zeggs_jax.motion import kinematics
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.pose import Pose, Root, rebase
from zeggs_jax.motion.skeleton import Skeleton

GAZE_DISTANCE = 100.0  # cm ahead of the root, where the head looks


class Motion(NamedTuple):
    """T frames of poses, and the point that the character looks at."""

    pose: Pose  # every array with a leading axis of T frames
    gaze: Float[Array, "3"]  # cm, world, on the ground: the median over the clip


def encode(clip: Clip) -> Motion:
    """The features of a clip, as the release computes them; ValueError under 4 frames.

    The root stands under the spine joint and faces where the hips face; velocities are backward differences,
    and those of frame 0 are extrapolated from frames 1 to 3. Facing -Z, where the release gives NaN, is a
    half turn.
    """
    frames = len(clip.euler)
    if frames < 4:
        raise ValueError(f"A clip of {frames} frames is too short for velocities; give at least 4 frames.")
    body = clip.skeleton
    paths = tuple(tuple(body.path(body.role(role))) for role in ("hips", "spine", "head"))
    pose, look = in_float64(
        partial(_encode, orders=clip.orders, paths=paths, frame_time=clip.frame_time),
        clip.euler,
        clip.positions,
    )
    gaze = np.median(pose.root.pos + GAZE_DISTANCE * look, axis=0)
    pose, gaze = jax.tree.map(lambda x: jax.device_put(x.astype(np.float32)), (pose, gaze))  # compiles nothing
    return Motion(pose, gaze)


def decode(
    poses: Pose,
    skeleton: Skeleton,
    frame_time: float,
    rebase: bool = True,
    offsets: Literal["first_frame", "skeleton", "per_frame"] = "first_frame",
    unit_root: bool = True,
) -> Clip:
    """Poses of T frames as a clip with zyx Euler angles (ZeroEGGS Sec. 3.5).

    `rebase` moves the whole motion so that the root of frame 0 is at the origin and faces +Z. `offsets` says
    where the bones' offsets come from: the joint positions of frame 0 (as released), the skeleton's own, or
    "per_frame", which also keeps the predicted positions of all joints in every frame. The root's rotation
    loses length in a long rollout, which Euler angles do not bear; without `unit_root` it stays, as released.
    """
    euler, positions = in_float64(partial(_decode, rebased=rebase, unit_root=unit_root), poses)
    first = positions[0] if offsets != "skeleton" else np.asarray(skeleton.offsets, np.float64)
    if offsets != "per_frame":
        positions[:, 1:] = first[1:]
    body = Skeleton(skeleton.names, skeleton.parents, first.copy(), skeleton.roles)
    return Clip(body, ("zyx",) * len(skeleton), euler, positions, frame_time)


def local_quaternions(clip: Clip) -> Float[np.ndarray, "T J 4"]:
    """Joint rotations relative to the parent, float64, without sign jumps from frame to frame."""
    return in_float64(partial(_local_quaternions, orders=clip.orders), clip.euler)


def with_quaternions(clip: Clip, rotations: Float[np.ndarray, "T J 4"], positions: np.ndarray) -> Clip:
    """The clip with other local rotations and positions [T, J, 3] (cm), in its own Euler orders."""
    euler = in_float64(partial(_eulers, orders=clip.orders), rotations)
    return clip._replace(euler=euler, positions=np.asarray(positions, np.float64))


def local_axes(clip: Clip) -> Float[np.ndarray, "T J 2 3"]:
    """Joint rotations relative to the parent as their turned x and y axes, float64."""
    return in_float64(rotation.quaternion_to_axes, local_quaternions(clip))


def from_axes(
    axes: Float[np.ndarray, "T J 2 3"], place: Float[np.ndarray, "T 3"], skeleton: Skeleton, frame_time: float
) -> Clip:
    """A clip with zyx Euler angles from axes, made orthonormal, and joint 0's place (cm, world); bones as they are."""
    euler = in_float64(_axes_eulers, axes)
    positions = np.tile(np.asarray(skeleton.offsets, np.float64), (len(axes), 1, 1))
    positions[:, 0] = place
    return Clip(skeleton, ("zyx",) * len(skeleton), euler, positions, frame_time)


def world_positions(clip: Clip) -> Float[np.ndarray, "T J 3"]:
    """Positions of all joints in world, cm."""
    run = partial(_world_positions, orders=clip.orders, parents=clip.skeleton.parents)
    return in_float64(run, clip.euler, clip.positions)


def world_frames(clip: Clip) -> tuple[Float[np.ndarray, "T J 3"], Float[np.ndarray, "T J 3 3"]]:
    """Positions of all joints in world, cm, and rotation matrices whose columns are their axes in world."""
    run = partial(_world_frames, orders=clip.orders, parents=clip.skeleton.parents)
    return in_float64(run, clip.euler, clip.positions)


def in_float64(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call with every array in float64 and padded in time; results cut to length, as numpy arrays."""
    frames = len(jax.tree.leaves(arguments)[0])
    missing = (256 if frames <= 256 else max(1024, 1 << (frames - 1).bit_length())) - frames

    def padded(x: Any) -> np.ndarray:
        x = np.asarray(x, np.float64)
        return np.concatenate([x, np.repeat(x[-1:], missing, axis=0)])

    with jax.enable_x64(True):
        result = function(*jax.tree.map(padded, arguments))
        return jax.tree.map(lambda x: np.array(x)[:frames], result)  # numpy cuts: jax would compile every length


@partial(jax.jit, static_argnames="orders")
def _local_quaternions(euler: Float[Array, "T J 3"], orders: tuple[str, ...]) -> Float[Array, "T J 4"]:
    return quaternion.unroll(_by_order(quaternion.from_euler, euler, orders))


@jax.jit
def _axes_eulers(axes: Float[Array, "T J 2 3"]) -> Float[Array, "T J 3"]:
    return quaternion.to_euler(rotation.axes_to_quaternion(axes), "zyx")


@partial(jax.jit, static_argnames="orders")
def _eulers(rotations: Float[Array, "T J 4"], orders: tuple[str, ...]) -> Float[Array, "T J 3"]:
    return _by_order(quaternion.to_euler, rotations, orders)


def _by_order(function: Callable[..., Array], x: Array, orders: tuple[str, ...]) -> Array:
    """A conversion applied to all joints, once for every Euler order that occurs."""
    groups = {order: [j for j, own in enumerate(orders) if own == order] for order in dict.fromkeys(orders)}
    parts = [function(x[:, np.asarray(joints)], order) for order, joints in groups.items()]
    back = np.argsort([joint for joints in groups.values() for joint in joints])
    return jnp.concatenate(parts, axis=1)[:, back]


@partial(jax.jit, static_argnames=("orders", "parents"))
def _world_positions(
    euler: Float[Array, "T J 3"],
    positions: Float[Array, "T J 3"],
    orders: tuple[str, ...],
    parents: tuple[int, ...],
) -> Float[Array, "T J 3"]:
    rotations = _by_order(quaternion.from_euler, euler, orders)
    return jax.vmap(partial(kinematics.forward_positions, parents=parents))(positions, rotations)


@partial(jax.jit, static_argnames=("orders", "parents"))
def _world_frames(
    euler: Float[Array, "T J 3"],
    positions: Float[Array, "T J 3"],
    orders: tuple[str, ...],
    parents: tuple[int, ...],
) -> tuple[Float[Array, "T J 3"], Float[Array, "T J 3 3"]]:
    still = jnp.zeros_like(positions)
    turns = quaternion.to_matrix(_by_order(quaternion.from_euler, euler, orders))
    world = jax.vmap(partial(kinematics.chain, parents=parents))(kinematics.World(positions, turns, still, still))
    return world.pos, world.mat


@partial(jax.jit, static_argnames=("orders", "paths"))
def _encode(
    euler: Float[Array, "T J 3"],
    positions: Float[Array, "T J 3"],
    orders: tuple[str, ...],
    paths: tuple[tuple[int, ...], ...],
    frame_time: Float[Array, ""] | float,
) -> tuple[Pose, Float[Array, "T 3"]]:
    """Poses, and the horizontal direction in which the head looks."""
    rotations = _local_quaternions(euler, orders)
    turns, places = _follow(rotations, positions, paths)  # of hips, spine and head
    root = Root(places[:, 1] * jnp.array([[1.0, 0.0, 1.0]]), _yaw(_ahead(turns[:, 0])))
    away = quaternion.inverse(root.rot)
    rotations = rotations.at[:, 0].set(quaternion.multiply(away, rotations[:, 0]))
    positions = positions.at[:, 0].set(quaternion.rotate(away, positions[:, 0] - root.pos))

    previous = jnp.concatenate([away[:1], away[:-1]])
    pose = Pose(
        root=root,
        root_vel=quaternion.rotate(previous, _velocity(root.pos, frame_time)),
        root_ang=quaternion.rotate(previous, _angular_velocity(root.rot, frame_time)),
        joint_pos=positions,
        joint_axes=rotation.quaternion_to_axes(rotations),
        joint_vel=_velocity(positions, frame_time),
        joint_ang=_angular_velocity(rotations, frame_time),
    )
    return pose, quaternion.normalize(_ahead(turns[:, 2]))


def _follow(
    rotations: Float[Array, "T J 4"], positions: Float[Array, "T J 3"], paths: tuple[tuple[int, ...], ...]
) -> tuple[Float[Array, "T p 4"], Float[Array, "T p 3"]]:
    """World rotations and positions of the joints at which paths from joint 0 end, one joint at a time."""
    joints = np.asarray(list(zip_longest(*paths, fillvalue=-1)))  # short paths wait at their end
    ended = (joints < 0)[:, None, :, None]
    turns = jnp.where(ended, jnp.eye(1, 4)[None, None], jnp.swapaxes(rotations[:, joints], 0, 1))
    arms = jnp.where(ended, 0.0, jnp.swapaxes(positions[:, joints], 0, 1))

    def step(above: tuple[Array, Array], local: tuple[Array, Array]) -> tuple[tuple[Array, Array], None]:
        (turn, pos), (local_turn, arm) = above, local
        return (quaternion.multiply(turn, local_turn), pos + quaternion.rotate(turn, arm)), None

    return jax.lax.scan(step, (turns[0], arms[0]), (turns[1:], arms[1:]))[0]


def _ahead(turn: Float[Array, "T 4"]) -> Float[Array, "T 3"]:
    """Where +Z points after a turn, flattened to the ground, not normalised."""
    ahead = quaternion.rotate(turn, jnp.zeros((len(turn), 3), turn.dtype).at[:, 2].set(1.0))
    return ahead * jnp.array([[1.0, 0.0, 1.0]])


def _yaw(ahead: Float[Array, "T 3"]) -> Float[Array, "T 4"]:
    """The turn about y, w >= 0, that takes +Z to a horizontal direction."""
    half = 0.5 * jnp.arctan2(ahead[:, 0], ahead[:, 2])
    zero = jnp.zeros_like(half)
    return jnp.stack([jnp.cos(half), zero, jnp.sin(half), zero], axis=-1)


def _velocity(x: Float[Array, "T *b"], frame_time: Float[Array, ""] | float) -> Float[Array, "T *b"]:
    """Backward differences per second."""
    return _extrapolated((x[1:] - x[:-1]) / frame_time)


def _angular_velocity(q: Float[Array, "T *b 4"], frame_time: Float[Array, ""] | float) -> Float[Array, "T *b 3"]:
    """Scaled axis per second of the shorter turn from each frame to the next, in the parent's frame."""
    step = quaternion.multiply(q[1:], quaternion.inverse(q[:-1]))
    return _extrapolated(quaternion.to_scaled_axis(quaternion.positive(step)) / frame_time)


def _extrapolated(v: Array) -> Array:
    """Velocities of frames 1.. with that of frame 0 put before: v1 - (v3 - v2), as released."""
    return jnp.concatenate([v[:1] - (v[2:3] - v[1:2]), v])


@partial(jax.jit, static_argnames=("rebased", "unit_root"))
def _decode(poses: Pose, rebased: bool, unit_root: bool) -> tuple[Float[Array, "T J 3"], Float[Array, "T J 3"]]:
    """Euler angles and local positions, joint 0 in world."""
    if unit_root:
        poses = _with_unit_root(poses)
    if rebased:
        first = Root(*(jnp.broadcast_to(x[:1], x.shape) for x in poses.root))
        poses = rebase(poses, first)
    rotations, positions = _local(poses)
    return quaternion.to_euler(rotations, "zyx"), positions


@jax.jit
def joints(pose: Pose, origin: Root) -> tuple[Float[Array, "J 4"], Float[Array, "J 3"]]:
    """One pose as engines take it: rotations (wxyz) and positions (cm) in the parent's frame, of joint 0 in world.

    The world is one in which `origin`, of unit length, is in the middle and faces +Z: what `decode` makes of frame 0.
    """
    poses, first = jax.tree.map(lambda a: jnp.asarray(a)[None], (pose, origin))
    rotations, positions = _local(rebase(_with_unit_root(poses), first))
    return rotations[0], positions[0]


def _with_unit_root(poses: Pose) -> Pose:
    return poses._replace(root=Root(poses.root.pos, quaternion.normalize(poses.root.rot)))


def _local(poses: Pose) -> tuple[Float[Array, "T J 4"], Float[Array, "T J 3"]]:
    """Local rotations and positions, joint 0 in world."""
    turn, rotations = poses.root.rot, rotation.axes_to_quaternion(poses.joint_axes)
    rotations = rotations.at[:, 0].set(quaternion.multiply(turn, rotations[:, 0]))
    hips = poses.root.pos + quaternion.rotate(turn, poses.joint_pos[:, 0])
    return rotations, poses.joint_pos.at[:, 0].set(hips)
