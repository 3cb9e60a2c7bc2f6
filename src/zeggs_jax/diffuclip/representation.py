"""Sec. 4: a frame of motion as the networks see it: the root's displacement and 6-D rotations of every joint.

Columns of a frame: 0 and 1 the horizontal way of joint 0 since the frame before (left, ahead; cm), in the frame that
the body heads to now; 2 its height (cm), which therefore cannot drift; then the turned x and y axis of every joint
(`6 J`), of joint 0 in world, in which the first frame heads to +Z. Only the place on the ground is integrated.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Float32

from ..data.scale import Scale
from ..motion import edit, features, kinematics
from ..motion.bvh import Clip
from ..motion.skeleton import Skeleton

ROOT = 3  # columns before the rotations
HORIZON = 8.0  # frames over which an error of the displacement is counted: it adds up
SHORTEST_REACH = 2.0  # cm, by which a turn of a joint that carries nothing is weighed


def encode(clip: Clip) -> Float32[np.ndarray, "T D"]:
    """The frames of a clip, D = 3 + 6 J; frame 0 moves as frame 1 does."""
    clip = edit.centre(clip)
    axes, place = features.local_axes(clip), clip.positions[:, 0]
    sine, cosine = heading(axes)
    step = np.diff(place, axis=0, prepend=place[:1])
    left, ahead = cosine * step[:, 0] - sine * step[:, 2], sine * step[:, 0] + cosine * step[:, 2]
    rows = np.stack([left, ahead, place[:, 1]], axis=-1)
    rows[:1, :2] = rows[1:2, :2] if len(rows) > 1 else 0.0
    return np.concatenate([rows, axes.reshape(len(axes), -1)], axis=-1).astype(np.float32)


def bones(clip: Clip) -> Skeleton:
    """The skeleton that `decode` puts the clip's rotations on: where a file has joint positions that differ from its
    OFFSETs, each joint's median position (cm, in its parent's frame) takes their place.
    """
    skeleton = clip.skeleton
    offsets = np.array(skeleton.offsets, float)
    offsets[1:] = np.median(clip.positions[:, 1:], axis=0)
    return Skeleton(skeleton.names, skeleton.parents, offsets, skeleton.roles)


def decode(motion: Float[np.ndarray, "T D"], skeleton: Skeleton, frame_time: float) -> Clip:
    """Frames as a clip, joint 0 above the origin in the first; rotations are made orthonormal.

    ValueError where the frames are not of this skeleton.
    """
    check(motion, skeleton)
    axes = np.asarray(motion[:, ROOT:], np.float64).reshape(len(motion), -1, 2, 3)
    place = features.in_float64(ground, motion[:, :ROOT], axes)
    return features.from_axes(axes, place, skeleton, frame_time)


def check(motion: Float[np.ndarray, "T D"], skeleton: Skeleton) -> None:
    """ValueError where `motion` has not the columns of `skeleton`."""
    if motion.shape[-1] != ROOT + 6 * len(skeleton):
        raise ValueError(
            f"A motion frame of {motion.shape[-1]} numbers is not of a body of {len(skeleton)} joints, which has "
            f"{ROOT + 6 * len(skeleton)} (3 + 6 for each joint); use the skeleton that the model was trained on."
        )


def positions(
    motion: Float[ArrayLike, "T D"], offsets: Float[ArrayLike, "J 3"], parents: tuple[int, ...]
) -> Float[Array, "T J 3"]:
    """World positions of all joints (cm), joint 0 above the origin in the first frame; differentiable."""
    motion = jnp.asarray(motion)
    axes = motion[:, ROOT:].reshape(len(motion), -1, 2, 3)
    return kinematics.axes_positions(ground(motion[:, :ROOT], axes), axes, offsets, parents)


@jax.jit
def ground(root: Float[ArrayLike, "T 3"], axes: Float[ArrayLike, "T J 2 3"]) -> Float[Array, "T 3"]:
    """Places of joint 0 (cm, world): the steps of frames 1.. turned by the heading and summed; heights as given."""
    (sine, cosine), root = heading(axes), jnp.asarray(root)
    left, ahead = root[:, 0], root[:, 1]
    step = jnp.stack([cosine * left + sine * ahead, cosine * ahead - sine * left], axis=-1)
    moved = jnp.cumsum(step, axis=0) - step[:1]
    return jnp.stack([moved[:, 0], root[:, 2], moved[:, 1]], axis=-1)


def heading(axes: Float[ArrayLike, "T J 2 3"]) -> tuple[Float[ArrayLike, " T"], Float[ArrayLike, " T"]]:
    """Sine and cosine of the angle about y from +Z to where joint 0's z axis points on the ground."""
    x, y = axes[:, 0, 0], axes[:, 0, 1]  # type: ignore[index]
    across, ahead = x[:, 1] * y[:, 2] - x[:, 2] * y[:, 1], x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]
    length = (across**2 + ahead**2 + 1e-12) ** 0.5
    return across / length, ahead / length


def scale(motions: Sequence[Float[np.ndarray, "_ D"]], skeleton: Skeleton) -> Scale:
    """Mean of every column, and for every joint one number in place of its standard deviations.

    An error in scaled columns counts as the way (cm) by which it displaces what the joint carries, so that forty
    finger joints do not outweigh the arms and a column that never changes amplifies no noise. The mean square of all
    scaled columns is 1 over the frames given.
    """
    check(motions[0], skeleton)
    frames = sum(map(len, motions))
    mean = sum(motion.sum(axis=0, dtype=np.float64) for motion in motions) / frames
    square = sum(((motion - mean) ** 2).sum(axis=0) for motion in motions) / frames
    weights = np.concatenate([[HORIZON, HORIZON, 1.0], np.repeat(reaches(skeleton), 6)])
    size = np.sqrt((weights**2 * square).mean())  # cm
    std = max(size, 1e-3) / weights
    return Scale(np.asarray(mean, np.float32), std.astype(np.float32))


def reaches(skeleton: Skeleton) -> Float[np.ndarray, " J"]:
    """How far from each joint the farthest joint is that it carries, along the bones (cm), at least 2."""
    reach = np.zeros(len(skeleton))
    for joint in range(len(skeleton) - 1, 0, -1):
        parent = skeleton.parents[joint]
        reach[parent] = max(reach[parent], reach[joint] + float(np.linalg.norm(skeleton.offsets[joint])))
    return np.maximum(reach, SHORTEST_REACH)
