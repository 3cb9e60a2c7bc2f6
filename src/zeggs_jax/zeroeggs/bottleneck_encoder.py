"""A style encoder without chance or order: each number of the body's mean and spread over time, then few numbers.

Not in the paper. What a style is may show in how the body stands on average and in how much it moves: the encoder is
told nothing else of an example, neither rhythm nor order, and squeezes it through `hidden` units into `size` numbers.
There is no sampling, hence no divergence in the loss and no variety of one style.
"""

import dataclasses

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..motion.skeleton import Skeleton
from ..nn.attention import masked
from ..nn.compute import Matmul
from ..nn.layers import Dense
from .style_encoder import RELU_GAIN, StyleDistribution, StyleEncoderConfig, from_linen

SMALLEST = 1e-5  # of a variance, in the scaled vector's unit: keeps the root's slope finite at rest


class BottleneckEncoder(nn.Module):
    """Mean and standard deviation over time of every number -> dense -> the style."""

    config: StyleEncoderConfig
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(
        self, example: Float[Array, "M P"], length: ArrayLike, deterministic: bool = True
    ) -> StyleDistribution:
        """Scaled pose vectors -> a style embedding; dropout is on the hidden units."""
        x = jax.nn.relu(
            Dense(self.config.hidden, RELU_GAIN, matmul=self.matmul, name="hidden")(over_time(example, length))
        )
        x = nn.Dropout(self.config.dropout, deterministic=deterministic)(x)
        return StyleDistribution(Dense(self.config.size, 1.0, matmul=self.matmul, name="style")(x), None)


def over_time(example: Float[Array, "M P"], length: ArrayLike) -> Float[Array, " 2*P"]:
    """Mean and standard deviation of the columns over the frames before `length`."""
    mask = jnp.arange(example.shape[0]) < length
    mean = masked(example, mask).sum(0) / length
    variance = jnp.square(masked(example - mean[None], mask)).sum(0) / length
    return jnp.concatenate([mean, jnp.sqrt(variance + SMALLEST)])


def _deterministic(config: StyleEncoderConfig, skeleton: Skeleton) -> StyleEncoderConfig:
    return dataclasses.replace(config, variational=False)


BOTTLENECK = from_linen(BottleneckEncoder, fit=_deterministic)
