"""Augmentation (ZeroEGGS Sec. 4.1): motion and speech played faster or slower, bodies seen in a mirror.

A clip played at pace p is a clip of fewer or more frames at the same frame time: its frame i shows what the clip
shows at frame i p. Written for one piece of a clip.
"""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Float32, Int, Int32

from zeggs_jax.motion import pose as poses
from zeggs_jax.motion.pose import Root, from_vector, to_vector
from zeggs_jax.motion.skeleton import Skeleton

PACE_LIMIT = 0.5  # paces go from 1 - this to 1 + this
Values = np.ndarray | Array


class Piece(NamedTuple):
    """T frames of one clip, as a prepared corpus stores them."""

    speech: Float[Values, "T S"]
    pose: Float[Values, "T D"]  # pose vectors, see motion/pose.py
    root_pos: Float[Values, "T 3"]  # cm, world
    root_rot: Float[Values, "T 4"]  # world


class Mirror(NamedTuple):
    """The mirror image of pose vectors: other columns, with other signs, moved by the body's asymmetry."""

    columns: Int[np.ndarray, " D"]
    signs: Float32[np.ndarray, " D"]
    shift: Float32[np.ndarray, " D"]  # cm in the columns of joint positions; 0 where both sides are alike


def played_ranges(ranges: Int32[np.ndarray, "C 2"], pace: float) -> Int32[np.ndarray, "C 2"]:
    """First and last row + 1 of every clip as if it were played at `pace` from its first row on."""
    frames = np.floor((ranges[:, 1] - ranges[:, 0] - 1) / pace + 1e-9).astype(np.int32) + 1
    return np.stack([ranges[:, 0], ranges[:, 0] + frames], axis=1)


def paced(clip: Piece, at: np.ndarray, pace: float, frame_time: float, most: int) -> Piece:
    """`play` on the rows of a whole clip, reading only those it needs; compiled once for up to `most` frames."""
    at = np.maximum(at, 0.0)
    low, high = int(at[0]), min(int(at[-1]) + 2, len(clip.pose))
    rows = int(most * (1 + PACE_LIMIT)) + 4
    source = Piece(*(np.empty((rows, x.shape[1]), np.float32) for x in clip))
    for empty, x in zip(source, clip, strict=True):
        empty[: high - low] = x[low:high]
        empty[high - low :] = x[high - 1]
    local = np.pad(at - low, (0, most + 1 - len(at)), mode="edge").astype(np.float32)
    with jax.default_device(_host()):
        played = _play(source, local, np.float32(pace), np.float32(frame_time))
    return Piece(*(np.asarray(x)[: len(at) - 1] for x in played))


@cache
def _host() -> jax.Device | None:
    """The CPU, whatever the step runs on; None where JAX was told to do without."""
    try:
        return jax.local_devices(backend="cpu")[0]
    except RuntimeError:
        return None


def play(piece: Piece, at: Float[ArrayLike, " F"], pace: ArrayLike, frame_time: ArrayLike) -> Piece:
    """Frames `at[1:]`, which are `pace` apart, of a piece; `at[0]` is the frame before them, if there is one.

    Features, positions and roots lie on lines between the frames, rotations turn the shorter way. Velocities
    are those of the played motion: for the root by differences, for joints the mean over the time between two
    played frames, times the pace (for positions that is the difference). Before a clip's first frame the body
    moves as in the first.
    """
    at = jnp.asarray(at)
    last = piece.pose.shape[0] - 1
    left = jnp.clip(jnp.floor(at).astype(jnp.int32), 0, last)
    right, weight = jnp.minimum(left + 1, last), at - left
    piece = Piece(*map(jnp.asarray, piece))
    before, after = (Root(piece.root_pos[rows], piece.root_rot[rows]) for rows in (left, right))
    root = poses.blend_roots(before, after, weight)
    first, then = (jax.tree.map(lambda x, cut=cut: x[cut], root) for cut in (slice(None, -1), slice(1, None)))

    left, right, weight = left[1:], right[1:], weight[1:, None]
    near, far = piece.pose[left], piece.pose[right]
    place = near + weight * (far - near)
    # the stored velocities of frame t hold from t - 1 to t: their shares in the time from at - pace to at
    pace = jnp.asarray(pace, weight.dtype)
    here = jnp.minimum(pace - weight, 1.0)
    rate = weight * far + here * near + (pace - weight - here) * piece.pose[jnp.maximum(left - 1, 0)]
    nowhere = Root(first.pos, first.rot)
    blended, moving = from_vector(place, nowhere), from_vector(rate, nowhere)
    axes = poses.blend_axes(*(from_vector(x, nowhere).joint_axes for x in (near, far)), weight=weight)
    vel, ang = poses.velocities(first, then, frame_time)
    started = at[1:, None] - pace > -1e-3
    vel, ang = jnp.where(started, vel, moving.root_vel), jnp.where(started, ang, moving.root_ang)
    played = moving._replace(root_vel=vel, root_ang=ang, joint_pos=blended.joint_pos, joint_axes=axes)
    speech = piece.speech[left] + weight * (piece.speech[right] - piece.speech[left])
    return Piece(speech, to_vector(played), then.pos, then.rot)


_play = jax.jit(play)


def mirror_of(skeleton: Skeleton, across: tuple[int, ...]) -> Mirror:
    """The mirror of a body's pose vectors (motion/pose.py, `mirror`), which keeps the body's own offsets.

    Exact for a body whose sides are alike. Otherwise the offsets stay on their sides and the joints' turns
    change them, so that world positions are the image only up to the asymmetry (see edit.mirror, keep_offsets).
    """
    joints = len(skeleton)
    numbers = np.arange(1, poses.size(joints) + 1, dtype=np.float32)
    image = np.asarray(to_vector(poses.mirror(from_vector(numbers, Root(np.zeros(3), np.zeros(4))), across)))
    other_side = skeleton.offsets[np.asarray(across)] * np.array([-1.0, 1.0, 1.0])
    shift = np.zeros(len(numbers), np.float32)
    shift[9 : 6 + 3 * joints] = (skeleton.offsets - other_side)[1:].ravel()
    return Mirror(np.abs(image).astype(np.int64) - 1, np.sign(image), shift)


def mirror(piece: Piece, by: Mirror) -> Piece:
    """The piece with the body seen in the mirror x = 0; what is heard stays."""
    pose = np.take(np.asarray(piece.pose), by.columns, axis=-1)
    pose *= by.signs
    if by.shift.any():
        pose += by.shift
    pos = piece.root_pos * np.array([-1, 1, 1], np.float32)
    return Piece(piece.speech, pose, pos, piece.root_rot * np.array([1, 1, -1, -1], np.float32))
