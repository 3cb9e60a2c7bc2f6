"""Augmentation (ZeroEGGS Sec. 4.1): motion and speech played faster or slower, bodies seen in a mirror.

A clip played at pace p is a clip of fewer or more frames at the same frame time: its frame i shows what the clip
shows at frame i p. Written for one example of a batch, for the training step to map over all of them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int

from zeggs_jax.data.statistics import Moments, merge
from zeggs_jax.data.windows import Batch, Piece, Recorded, Times
from zeggs_jax.motion import pose as poses
from zeggs_jax.motion.pose import Pose, Root, from_vector, to_vector
from zeggs_jax.motion.skeleton import Skeleton


class Mirror(NamedTuple):
    """The mirror image of pose vectors: other columns, with other signs, moved by the body's asymmetry."""

    columns: Int[np.ndarray, " D"]
    signs: Float32[np.ndarray, " D"]
    shift: Float32[np.ndarray, " D"]  # cm in the columns of joint positions; 0 where both sides are alike


SEEN, TURNED = np.array([-1, 1, 1], np.float32), np.array([1, 1, -1, -1], np.float32)  # points, rotations of the root
POINT = Mirror(np.arange(3), SEEN, np.zeros(3, np.float32))


def augment(recorded: Recorded, by: Mirror | None, window: int, frame_time: float) -> Batch:
    """The window of `window` frames and its example, of one row of a batch, as the networks are to see them."""
    piece, times = recorded.piece, recorded.times
    if not isinstance(piece, Piece):
        raise TypeError("pieces that are located have to be gathered first (windows.gather).")
    if times is not None:
        piece = play(piece, times, frame_time)
    gaze = jnp.asarray(recorded.gaze)
    if (mirrored := recorded.mirrored) is not None:
        if by is None:
            raise ValueError("Windows of a body without a mirror cannot be mirrored; set windows.mirror to 0.")
        image = mirror(piece, by)
        piece = jax.tree.map(lambda x, y: jnp.where(mirrored, y, x), piece, image)
        gaze = jnp.where(mirrored, gaze * SEEN, gaze)
    speech, pose, *root = (jax.lax.dynamic_slice_in_dim(x, recorded.start, window) for x in piece)
    there = jnp.arange(len(piece.pose)) < recorded.length
    return Batch(
        speech=speech,
        poses=from_vector(pose, Root(*root)),
        gaze=gaze,
        example=jnp.where(there[:, None], piece.pose, 0.0),
        example_length=jnp.asarray(recorded.length),
        label=jnp.asarray(recorded.label),
        foreign=recorded.foreign,
    )


def play(piece: Piece, times: Times, frame_time: float) -> Piece:
    """What a piece [R, ...] shows at F times; of the time before them too, at which nothing is shown.

    Features, positions and roots lie on lines between the frames, rotations turn the shorter way. Velocities
    are those of the played motion: of the root by differences, of joints the mean over the time between two
    played frames, times the pace (for positions that is the difference). Before its first frame a clip moves
    as in the first.
    """
    piece = Piece(*map(jnp.asarray, piece))
    pace, row, weight = map(jnp.asarray, times)
    shown, w = row[1:], weight[1:]
    near, far, older = (_pose(piece, rows) for rows in (shown, _next(shown, piece), jnp.maximum(shown - 1, 0)))
    root = poses.blend_roots(_root(piece, row), _root(piece, _next(row, piece)), weight)
    before, root = (jax.tree.map(lambda x, cut=cut: x[cut], root) for cut in (slice(None, -1), slice(1, None)))

    # the velocities of frame t hold from t - 1 to t: what part of the time from at - pace to at is whose
    ahead = jnp.minimum(w, pace)
    here = jnp.minimum(pace - ahead, 1.0)
    behind = pace - ahead - here

    def velocity(name: str) -> Array:
        parts = [_times(share, getattr(p, name)) for share, p in ((ahead, far), (here, near), (behind, older))]
        return parts[0] + parts[1] + parts[2]

    moved = (row[1:] != row[:-1]) | (weight[1:] != weight[:-1])  # else there is no frame before
    led = poses.velocities(before, root, frame_time)
    root_vel, root_ang = (
        jnp.where(moved[:, None], ours, velocity(name))
        for ours, name in zip(led, ("root_vel", "root_ang"), strict=True)
    )
    pose = Pose(
        root=root,
        root_vel=root_vel,
        root_ang=root_ang,
        joint_pos=near.joint_pos + _times(w, far.joint_pos - near.joint_pos),
        joint_axes=poses.blend_axes(near.joint_axes, far.joint_axes, w[:, None]),
        joint_vel=velocity("joint_vel"),
        joint_ang=velocity("joint_ang"),
    )
    heard, coming = piece.speech[shown], piece.speech[_next(shown, piece)]
    return Piece(heard + _times(w, coming - heard), to_vector(pose), *root)


def _next(rows: Int[Array, " F"], piece: Piece) -> Int[Array, " F"]:
    return jnp.minimum(rows + 1, len(piece.pose) - 1)


def _root(piece: Piece, rows: Int[Array, " F"]) -> Root:
    return Root(piece.root_pos[rows], piece.root_rot[rows])  # pyright: ignore[reportArgumentType]  arrays of JAX


def _pose(piece: Piece, rows: Int[Array, " F"]) -> Pose:
    return from_vector(piece.pose[rows], _root(piece, rows))


def _times(weight: Float[Array, " F"], values: Float[Array, "F *b"]) -> Float[Array, "F *b"]:
    """Every frame by its own weight."""
    return weight.reshape(-1, *(1,) * (values.ndim - 1)) * values


def mirror_of(skeleton: Skeleton, across: tuple[int, ...]) -> Mirror:
    """The mirror of a body's pose vectors (motion/pose.py, `mirror`), which keeps the body's own offsets.

    Exact for a body whose sides are alike. Otherwise the offsets stay on their sides and the joints' turns
    change them, so that world positions are the image only up to the asymmetry (see edit.mirror, keep_offsets).
    """
    joints = len(skeleton)
    numbers, still = np.arange(1, poses.size(joints) + 1, dtype=np.float32), Root(jnp.zeros(3), jnp.zeros(4))
    image = np.asarray(to_vector(poses.mirror(from_vector(numbers, still), across)))
    other_side = skeleton.offsets[np.asarray(across)] * SEEN
    shift = np.zeros(len(numbers), np.float32)
    shift[9 : 6 + 3 * joints] = (skeleton.offsets - other_side)[1:].ravel()
    return Mirror(np.abs(image).astype(np.int64) - 1, np.sign(image), shift)


def mirror(piece: Piece, by: Mirror) -> Piece:
    """The piece [R, ...] with the body seen in the mirror x = 0; what is heard stays."""
    speech, pose, pos, rot = map(jnp.asarray, piece)
    return Piece(speech, pose[:, by.columns] * by.signs[None] + by.shift[None], pos * SEEN[None], rot * TURNED[None])


def with_images(moments: Moments, by: Mirror) -> Moments:
    """Of rows and their mirror images, from the moments of the rows.

    Columns that differ from their image by the rounding of float32 alone (bone offsets) are taken as their own.
    """
    mean = moments.mean[by.columns] * by.signs + by.shift
    rounding = 1e-6 * (np.abs(moments.mean) + np.abs(by.shift))
    mean = np.where(np.abs(mean - moments.mean) <= rounding, moments.mean, mean)
    return merge(moments, Moments(moments.count, mean, moments.squares[by.columns]))
