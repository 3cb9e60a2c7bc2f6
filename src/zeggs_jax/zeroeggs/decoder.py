"""ZeroEGGS Fig. 4, the decoder: one `lax.scan` whose carry holds the pose with its root and the GRU state.

The body has three verbs: **observe** (last pose and the direction of this frame's target -> scaled vector),
**predict** (GRU, given this frame's speech and style), **integrate** (unscale, unpack, move the root).
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..data import scale
from ..data.scale import Scale, Scales
from ..motion import pose as poses
from ..motion.pose import Pose
from ..nn import deferred
from ..nn.compute import PLAIN, Compute, Matmul, operands
from ..nn.layers import Dense, GRUCell

GAZE = 3  # columns of an observation that are not in a prediction: the direction of the target


@dataclass(frozen=True)
class DecoderConfig:
    """Sizes of the decoder; with 'film' the style scales and shifts the layers instead of being an input.

    Without `facing` the body is not told where to face (the target's columns stay at their mean, the loss has no such
    term); without `initialiser` the first hidden state is zero: the paper's ablations.
    """

    hidden: int = 1024
    layers: int = 2
    conditioning: Literal["normal", "film"] = "normal"
    facing: bool = True
    initialiser: bool = True


class Frame(NamedTuple):
    """What is given for one frame, or with a leading axis for all of them."""

    speech: Float[Array | np.ndarray, "*T S"]  # speech embedding
    style: Float[Array | np.ndarray, "*T Z"]  # style embedding
    target: Float[Array | np.ndarray, "*T 3"]  # world position that the body faces, cm


class DecoderState(NamedTuple):
    """What a frame hands on to the next: the pose with its root in world, one hidden row per GRU layer."""

    pose: Pose
    hidden: Float[Array, "L H"]


class Decoder(nn.Module):
    """The two networks of Fig. 4: the hidden-state initialiser and one step of the recurrence."""

    config: DecoderConfig
    matmul: Matmul = "float32"

    def setup(self) -> None:
        kind = {"normal": Recurrent, "film": FilmRecurrent}[self.config.conditioning]
        if self.config.initialiser:
            self.initialiser = HiddenInitialiser(self.config, self.matmul)
        self.recurrent = kind(self.config, self.matmul)

    def __call__(self, seen: Float[Array, " O"], given: Frame) -> tuple[Array, Array]:
        """Both in a row; what `init` runs."""
        return self.recurrent(seen, given, self.begin(seen, given.style))

    def begin(self, seen: Float[Array, " O"], style: Float[Array | np.ndarray, " Z"]) -> Float[Array, "L H"]:
        """First observation and style -> first hidden state; zeros without an initialiser."""
        if self.config.initialiser:
            return self.initialiser(seen, style)
        return jnp.zeros((self.config.layers, self.config.hidden), seen.dtype)

    def predict(
        self, seen: Float[Array, " O"], given: Frame, hidden: Float[Array, "L H"]
    ) -> tuple[Float[Array, " P"], Float[Array, "L H"]]:
        """Observation, this frame's speech and style, hidden state -> scaled pose vector, hidden state."""
        return self.recurrent(seen, given, hidden)


class HiddenInitialiser(nn.Module):
    """Three dense layers, ELU after the first two (the paper has it after the third as well)."""

    config: DecoderConfig
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(self, seen: Float[Array, " O"], style: Float[Array | np.ndarray, " Z"]) -> Float[Array, "L H"]:
        layers, width = self.config.layers, self.config.hidden
        dense = partial(Dense, matmul=self.matmul)
        x = jnp.concatenate([seen, style])
        for i in range(2):
            x = jax.nn.elu(dense(width, name=f"dense{i}")(x))
        return dense(layers * width, name="dense2")(x).reshape(layers, width)


class StackedGRU(nn.Module):
    """GRU cells one above the other; returns their new hidden states, the last of which is the output."""

    config: DecoderConfig
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(self, x: Float[Array, " I"], hidden: Float[Array, "L H"]) -> Float[Array, "L H"]:
        rows = []
        for i in range(self.config.layers):
            x = GRUCell(self.config.hidden, self.matmul, name=f"layer{i}")(x, hidden[i])
            rows.append(x)
        return jnp.stack(rows)


class Recurrent(nn.Module):
    """Dense + ELU, GRU, dense; observation, speech and style enter both the first layer and the GRU."""

    config: DecoderConfig
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(
        self, seen: Float[Array, " O"], given: Frame, hidden: Float[Array, "L H"]
    ) -> tuple[Float[Array, " P"], Float[Array, "L H"]]:
        dense = partial(Dense, matmul=self.matmul)
        inputs = jnp.concatenate([seen, given.speech, given.style])
        x = jax.nn.elu(dense(self.config.hidden, name="dense_in")(inputs))
        hidden = StackedGRU(self.config, self.matmul, name="gru")(jnp.concatenate([x, inputs]), hidden)
        return dense(seen.shape[-1] - GAZE, name="dense_out")(hidden[-1]), hidden


class FilmRecurrent(nn.Module):
    """The same with FiLM: the style scales and shifts the outputs of the layers before and after the GRU."""

    config: DecoderConfig
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(
        self, seen: Float[Array, " O"], given: Frame, hidden: Float[Array, "L H"]
    ) -> tuple[Float[Array, " P"], Float[Array, "L H"]]:
        width, dense = self.config.hidden, partial(Dense, matmul=self.matmul)
        style: Any = given.style
        gamma = jnp.split(dense(2 * width, gain=1.0, name="gamma")(style) + 1.0, 2)
        beta = jnp.split(dense(2 * width, gain=1.0, name="beta")(style), 2)
        inputs = jnp.concatenate([seen, given.speech])
        x = jax.nn.elu(dense(width, name="dense_in")(inputs)) * gamma[0] + beta[0]
        hidden = StackedGRU(self.config, self.matmul, name="gru")(jnp.concatenate([x, inputs]), hidden)
        x = jax.nn.elu(dense(width, name="dense_mid")(hidden[-1])) * gamma[1] + beta[1]
        return dense(seen.shape[-1] - GAZE, name="dense_out")(x), hidden


def observe(pose: Pose, target: Float[ArrayLike, " 3"], pose_in: Scale, facing: bool = True) -> Float[Array, " O"]:
    """The scaled pose vector and the way from its root to the target (in cm: not normalised, as released).

    Not `facing`: whatever the target, its columns are zero, their mean.
    """
    gaze = poses.gaze_direction(pose.root, target)
    seen = scale.apply(pose_in, jnp.concatenate([poses.to_vector(pose), gaze]))
    return seen if facing else seen.at[-GAZE:].set(0.0)


def begin(
    params: Any, config: DecoderConfig, scales: Scales, first: Pose, given: Frame, matmul: Matmul = "float32"
) -> DecoderState:
    """The state before frame 1, from the first pose and frame 0's style and target."""
    seen = observe(first, given.target, scales.pose_in, config.facing)
    network: Any = Decoder(config, matmul)
    return DecoderState(first, network.apply({"params": params}, seen, given.style, method="begin"))


def predict(
    params: Any, config: DecoderConfig, seen: Float[Array, " O"], given: Frame, hidden: Float[Array, "L H"]
) -> tuple[Float[Array, " P"], Float[Array, "L H"]]:
    """One step of the recurrence: the scaled vector of the next pose, and the hidden state after it."""
    network: Any = Decoder(config)
    return network.apply({"params": params}, seen, given, hidden, method="predict")


def integrate(last: Pose, predicted: Float[Array, " P"], pose_out: Scale, frame_time: ArrayLike) -> Pose:
    """Unscales and unpacks the predicted vector and moves the last root by its velocities."""
    pose = poses.from_vector(scale.invert(pose_out, predicted), last.root)
    return pose._replace(root=poses.integrate(last.root, pose.root_vel, pose.root_ang, frame_time))


def rollout(
    params: Any,
    config: DecoderConfig,
    scales: Scales,
    first: Pose,
    given: Frame,
    frame_time: ArrayLike,
    compute: Compute = PLAIN,
) -> Pose:
    """`first` verbatim, then one pose per frame of `given` from frame 1 on (frame 0's speech is not used)."""
    network: Any = Decoder(config, compute.matmul)
    params = operands(params, compute.matmul)

    def step(recurrent: Any, state: DecoderState, frame: Frame) -> tuple[DecoderState, Pose, Any]:
        seen = observe(state.pose, frame.target, scales.pose_in, config.facing)
        variables = {"params": {"recurrent": recurrent}}
        (predicted, hidden), kept = network.apply(
            variables, seen, frame, state.hidden, method="predict", mutable=[deferred.INPUTS]
        )
        pose = integrate(state.pose, predicted, scales.pose_out, frame_time)
        return DecoderState(pose, hidden), pose, kept[deferred.INPUTS]["recurrent"]

    state = begin(params, config, scales, first, jax.tree.map(lambda a: a[0], given), compute.matmul)
    _, rest = deferred.scan(step, params["recurrent"], state, jax.tree.map(lambda a: a[1:], given), compute)
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, rest)
