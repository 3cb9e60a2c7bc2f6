"""Augmentation (ZeroEGGS Sec. 4.1): motion and speech played faster or slower, bodies seen in a mirror.

A clip played at pace p is a clip of fewer or more frames at the same frame time: its frame i shows what the clip
shows at frame i p. Written for one piece of a clip.
"""

from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int

from zeggs_jax.motion import pose as poses
from zeggs_jax.motion.pose import Root, from_vector, to_vector
from zeggs_jax.motion.skeleton import Skeleton

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


def play(clip: Piece, at: Float[np.ndarray, " F"], pace: float, frame_time: float, most: int) -> Piece:
    """What a whole clip shows at the times `at[1:]` (in frames, `pace` apart); `at[0]` is the time before them.

    Features, positions and roots lie on lines between the frames, rotations turn the shorter way. Velocities
    are those of the played motion: of the root by differences, of joints the mean over the time between two
    played frames, times the pace (for positions that is the difference). Before its first frame the clip moves
    as in the first. Compiled once for up to `most` frames.
    """
    at = np.maximum(at, 0.0)
    left = at.astype(np.int64)
    right, weight = np.minimum(left + 1, len(clip.pose) - 1), (at - left).astype(np.float32)
    near, far = (Piece(*(x[rows[1:]] for x in clip)) for rows in (left, right))
    w = weight[1:, None]
    pose, joints = near.pose, (near.pose.shape[1] - 6) // 15
    still, axes, moving = (slice(6 + a * joints, 6 + b * joints) for a, b in ((0, 3), (3, 9), (9, 15)))
    before, after = (_root(clip.root_pos[rows], clip.root_rot[rows]) for rows in (left, right))
    turned = _turn(near.pose[:, axes], far.pose[:, axes], before, after, weight, frame_time, most)

    pose[:, still] += w * (far.pose[:, still] - pose[:, still])
    pose[:, axes] = turned.axes
    # the velocities of frame t hold from t - 1 to t: what part of the time from at - pace to at is whose
    ahead = np.minimum(w, np.float32(pace))
    here = np.minimum(np.float32(pace) - ahead, 1.0)
    behind = np.float32(pace) - ahead - here
    older = np.flatnonzero(behind > 0)
    for part in (slice(0, 6), moving):
        pose[:, part] = here * pose[:, part] + ahead * far.pose[:, part]
        pose[older, part] += behind[older] * clip.pose[np.maximum(left[1:][older] - 1, 0), part]
    known = at[1:] >= pace  # the frame before is in the clip
    pose[known, :6] = turned.velocities[known]
    return Piece(near.speech + w * (far.speech - near.speech), pose, turned.root.pos, turned.root.rot)


def _root(pos: Any, rot: Any) -> Root:
    """A root of numpy arrays."""
    return Root(pos, rot)


class _Turned(NamedTuple):
    """What `play` leaves to geometry."""

    axes: Float[Values, "T 6*J"]
    velocities: Float[Values, "T 6"]  # of the root, from the frame before
    root: Root


def _turn(near, far, before: Root, after: Root, weight: np.ndarray, frame_time: float, most: int) -> _Turned:
    """Axes of T frames and roots of those and the one before, between two each; padded to `most`, on the CPU."""
    frames, missing = len(near), most - len(near)
    arrays = ((near, far, weight[1:]), (before, after, weight))
    padded = jax.tree.map(lambda x: np.concatenate([x, np.repeat(x[-1:], missing, axis=0)]), arrays)
    with jax.default_device(_host()):
        turned = _blend(*padded, np.float32(frame_time))
    return jax.tree.map(lambda x: np.asarray(x)[:frames], turned)


@jax.jit
def _blend(axes: tuple, roots: tuple, frame_time: Array) -> _Turned:
    near, far, weight = axes
    pairs = (len(near), -1, 2, 3)
    blended = poses.blend_axes(near.reshape(pairs), far.reshape(pairs), weight[:, None])
    root = poses.blend_roots(*roots)
    first, then = (jax.tree.map(lambda x, cut=cut: x[cut], root) for cut in (slice(None, -1), slice(1, None)))
    velocities = jnp.concatenate(poses.velocities(first, then, frame_time), axis=-1)
    return _Turned(blended.reshape(near.shape), velocities, then)


@cache
def _host() -> jax.Device | None:  # pyright: ignore[reportInvalidTypeForm]
    """The CPU, whatever the step runs on; None where JAX was told to do without."""
    try:
        return jax.local_devices(backend="cpu")[0]
    except RuntimeError:
        return None


def mirror_of(skeleton: Skeleton, across: tuple[int, ...]) -> Mirror:
    """The mirror of a body's pose vectors (motion/pose.py, `mirror`), which keeps the body's own offsets.

    Exact for a body whose sides are alike. Otherwise the offsets stay on their sides and the joints' turns
    change them, so that world positions are the image only up to the asymmetry (see edit.mirror, keep_offsets).
    """
    joints = len(skeleton)
    numbers = np.arange(1, poses.size(joints) + 1, dtype=np.float32)
    image = np.asarray(to_vector(poses.mirror(from_vector(numbers, _root(np.zeros(3), np.zeros(4))), across)))
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
