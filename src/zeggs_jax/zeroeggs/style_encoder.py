"""ZeroEGGS Fig. 3b, the style encoder: an example motion of any length to N(mean, var) over style embeddings.

Two kinds, as in the release: `attn` (convolutions, positions, one transformer block, mean over time: the
paper's) and `gru` (convolutions, bidirectional GRU). Examples of different lengths are padded to one and
masked; padding changes nothing, because the mask is applied again before every convolution, in the attention
and in the mean.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ..nn.attention import TransformerBlock, masked, positions
from ..nn.compute import Matmul
from ..nn.layers import Conv, Dense, GRUCell, LayerNorm

RELU_GAIN = 2.0**0.5


@dataclass(frozen=True)
class StyleEncoderConfig:
    """Sizes of the style encoder; kind 'label' means one-hot styles and no encoder (the release's v2)."""

    kind: Literal["attn", "gru", "label"] = "attn"
    hidden: int = 512
    size: int = 64
    variational: bool = True
    heads: int = 4
    dropout: float = 0.2
    block_dropout: float = 0.1

    @property
    def outputs(self) -> int:
        """Numbers that the encoder returns: mean and log variance, or the embedding alone."""
        return 2 * self.size if self.variational else self.size


class StyleDistribution(NamedTuple):
    """A Gaussian over style embeddings; not variational: `log_var` is None and `mean` is the style."""

    mean: Float[Array, " Z"]
    log_var: Float[Array, " Z"] | None


class StyleEncoder(nn.Module):
    """Fig. 3b; the frames of `example` from `length` on are padding."""

    config: StyleEncoderConfig
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(
        self, example: Float[Array, "M P"], length: ArrayLike, deterministic: bool = True
    ) -> StyleDistribution:
        """Scaled pose vectors (with gaze columns) -> distribution of the style embedding."""
        mask = jnp.arange(example.shape[0]) < length
        kind = AttentionEncoder if self.config.kind == "attn" else RecurrentEncoder
        outputs = kind(self.config, self.matmul, name="encoder")(masked(example, mask), mask, deterministic)
        if not self.config.variational:
            return StyleDistribution(outputs, None)
        return StyleDistribution(*jnp.split(outputs, 2))


class AttentionEncoder(nn.Module):
    """Two convolutions, sinusoidal positions, one transformer block, mean over the frames of the example."""

    config: StyleEncoderConfig
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(self, x: Float[Array, "M P"], mask: Bool[Array, " M"], deterministic: bool) -> Float[Array, " O"]:
        config = self.config
        drop = nn.Dropout(config.dropout, deterministic=deterministic)
        for i, width in enumerate((config.hidden, config.outputs)):
            x = jax.nn.relu(Conv(width, 3, gain=RELU_GAIN, matmul=self.matmul, name=f"conv{i}")(x))
            x = masked(drop(LayerNorm(name=f"norm{i}")(x)), mask)
        x = x + positions(*x.shape).astype(x.dtype)
        x = TransformerBlock(config.heads, config.block_dropout, self.matmul, name="block")(x, mask, deterministic)
        return masked(x, mask).sum(0) / mask.sum()


class RecurrentEncoder(nn.Module):
    """Two convolutions, a GRU in each direction, one dense layer.

    As released, the dense layer reads both outputs at the last frame, the first that the backward half sees.
    """

    config: StyleEncoderConfig
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(self, x: Float[Array, "M P"], mask: Bool[Array, " M"], deterministic: bool) -> Float[Array, " O"]:
        config = self.config
        for i in range(2):
            x = Conv(config.hidden, 3, gain=RELU_GAIN, matmul=self.matmul, name=f"conv{i}")(x)
            x = masked(jax.nn.relu(x), mask)

        def step(cell: GRUCell, hidden: Array, frame: tuple[Array, Array]) -> tuple[Array, None]:
            return jnp.where(frame[1], cell(frame[0], hidden), hidden), None

        scan = nn.scan(step, variable_broadcast="params", split_rngs={"params": False})
        start = jnp.zeros(config.hidden, x.dtype)
        forward, _ = scan(GRUCell(config.hidden, self.matmul, name="forward"), start, (x, mask))
        backward = GRUCell(config.hidden, self.matmul, name="backward")(x[mask.sum() - 1], start)
        return Dense(config.outputs, gain=1.0, matmul=self.matmul, name="dense")(jnp.concatenate([forward, backward]))


def reparameterise(
    distribution: StyleDistribution, noise: Float[Array, " Z"], temperature: ArrayLike = 1.0
) -> Float[Array, " Z"]:
    """mean + temperature * std * noise: 0 is the mean, more is more varied (the release divides instead)."""
    if distribution.log_var is None:
        return distribution.mean
    return distribution.mean + temperature * jnp.exp(0.5 * distribution.log_var) * noise


def sample_style(key: Array, distribution: StyleDistribution, temperature: ArrayLike = 1.0) -> Float[Array, " Z"]:
    """A style embedding drawn from `distribution` (ZeroEGGS Sec. 3.3), sharper or wider by `temperature`."""
    noise = jax.random.normal(key, distribution.mean.shape, distribution.mean.dtype)
    return reparameterise(distribution, noise, temperature)
