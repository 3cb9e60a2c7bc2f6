"""ZeroEGGS Eq. 2, the training loss: 17 weighted L1 terms of one clip and the annealed KL divergence of the style.

Terms and weights are the release's (the paper's list is shorter). A term is the mean of |weight (predicted - target)|
over frames, joints and components; frame 0, which the decoder is given, counts with its error of zero.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..motion import kinematics
from ..motion import pose as poses
from ..motion.kinematics import ANG, AXES, POS, VEL
from ..motion.pose import Pose, Root
from .style_encoder import StyleDistribution


class Terms(NamedTuple):
    """The 17 terms of one clip, or their weights; local is relative to the parent, joint 0's to the world."""

    root_pos: ArrayLike  # world, cm
    root_rot: ArrayLike  # world, matrix
    root_vel: ArrayLike  # world, cm/s
    root_ang: ArrayLike  # world, rad/s
    joint_pos: ArrayLike  # local, cm
    joint_axes: ArrayLike  # local, as predicted: not made orthogonal, joint 0's relative to the root
    joint_vel: ArrayLike  # local, cm/s
    joint_ang: ArrayLike  # local, rad/s
    world_pos: ArrayLike  # cm
    world_rot: ArrayLike  # matrix
    world_vel: ArrayLike  # cm/s
    world_ang: ArrayLike  # rad/s
    joint_pos_step: ArrayLike  # from frame to frame, per second
    joint_axes_step: ArrayLike
    world_pos_step: ArrayLike
    world_rot_step: ArrayLike
    gaze: ArrayLike  # unit vector to the target, in the root's frame


WEIGHTS = Terms(
    root_pos=0.1, root_rot=10.0, root_vel=0.1, root_ang=5.0,
    joint_pos=15.0, joint_axes=15.0, joint_vel=10.0, joint_ang=7.0,
    world_pos=0.1, world_rot=3.0, world_vel=0.06, world_ang=1.25,
    joint_pos_step=7.0, joint_axes_step=8.0, world_pos_step=0.06, world_rot_step=1.25,
    gaze=10.0,
)  # fmt: skip


def reconstruction(
    predicted: Pose,
    target: Pose,
    gaze: Float[Array, "*T 3"],
    parents: tuple[int, ...],
    frame_time: ArrayLike,
    facing: bool = True,
) -> Terms:
    """The weighted terms of one clip of T frames; `gaze` is the world point [cm] to face, one or one per frame.

    Not `facing`: the term of the gaze is zero.
    """
    gaze = jnp.broadcast_to(gaze, predicted.root.pos.shape)
    weights = WEIGHTS if facing else WEIGHTS._replace(gaze=0.0)
    ours, theirs = (_compared(motion, gaze, parents, frame_time) for motion in (predicted, target))
    return jax.tree.map(lambda weight, a, b: weight * jnp.mean(jnp.abs(a - b)), weights, ours, theirs)


def _compared(motion: Pose, gaze: Float[Array, "T 3"], parents: tuple[int, ...], frame_time: ArrayLike) -> Terms:
    """What the terms compare; joint quantities as [component, (axis,) joint, frame]."""
    placed = kinematics.place(motion, parents)
    axes = jnp.transpose(motion.joint_axes, (3, 2, 1, 0))

    def step(x: Float[Array, "*j T"]) -> Float[Array, "*j t"]:
        return (x[..., 1:] - x[..., :-1]) / frame_time

    return Terms(
        root_pos=placed.root[:, POS],
        root_rot=placed.root[:, AXES],
        root_vel=placed.root[:, VEL],
        root_ang=placed.root[:, ANG],
        joint_pos=placed.local[:, POS],
        joint_axes=axes,
        joint_vel=placed.local[:, VEL],
        joint_ang=placed.local[:, ANG],
        world_pos=placed.world[:, POS],
        world_rot=placed.world[:, AXES],
        world_vel=placed.world[:, VEL],
        world_ang=placed.world[:, ANG],
        joint_pos_step=step(placed.local[:, POS]),
        joint_axes_step=step(axes),
        world_pos_step=step(placed.world[:, POS]),
        world_rot_step=step(placed.world[:, AXES]),
        gaze=_facing(motion.root, gaze),
    )


def _facing(root: Root, target: Float[Array, "T 3"]) -> Float[Array, "T 3"]:
    """Unit vectors to the target in the root's frame, normalised in world as released (x / (|x| + 1e-8))."""
    arm = target - root.pos
    square = jnp.sum(arm * arm, axis=-1, keepdims=True)
    apart = square > 0
    length = jnp.where(apart, jnp.sqrt(jnp.where(apart, square, 1.0)), 0.0)  # gradient 0 on the target itself
    here = root._replace(pos=jnp.zeros_like(root.pos))
    return poses.gaze_direction(here, arm / (length + 1e-8))


def kl(style: StyleDistribution) -> Float[Array, ""]:
    """Divergence of the style's Gaussian from N(0, 1), the mean over its dimensions as released (the paper sums)."""
    if style.log_var is None:
        return jnp.zeros((), style.mean.dtype)
    return -0.5 * jnp.mean(1.0 + style.log_var - style.mean**2 - jnp.exp(style.log_var))


def kl_weight(
    step: ArrayLike, limit: ArrayLike = 0.2, middle: ArrayLike = 7500.0, slope: ArrayLike = 0.005
) -> Float[Array, ""]:
    """Annealed weight of the divergence at update `step`: a sigmoid, capped (released: at 0.2, from 7,223 on)."""
    return jnp.minimum(jax.nn.sigmoid(slope * (jnp.asarray(step) * 1.0 - middle)), limit)


def total(terms: Terms, divergence: ArrayLike) -> Float[Array, ""]:
    """The loss: the sum of the 17 terms and the weighted divergence, over 18 (without a divergence too)."""
    return jnp.asarray(sum(terms) + divergence) / (len(Terms._fields) + 1)
