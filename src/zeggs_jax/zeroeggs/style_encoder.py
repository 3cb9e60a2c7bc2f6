"""ZeroEGGS Fig. 3b, the style encoder: an example motion of any length to N(mean, var) over style embeddings.

Two kinds, as in the release: `attn` (convolutions, positions, one transformer block, mean over time: the
paper's) and `gru` (convolutions, bidirectional GRU). Examples of different lengths are padded to one and
masked; padding changes nothing, because the mask is applied again before every convolution, in the attention
and in the mean. All kinds that a config can name are in `encoders.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ..motion.skeleton import Skeleton
from ..nn.attention import TransformerBlock, masked, positions
from ..nn.compute import Matmul
from ..nn.layers import Conv, Dense, Dropout, GRUCell, LayerNorm

RELU_GAIN = 2.0**0.5


@dataclass(frozen=True)
class StyleEncoderConfig:
    """Sizes of the style encoder; kind 'label' means one-hot styles and no encoder (the release's v2)."""

    kind: str = "attn"  # a name in `encoders.ENCODERS`, or 'label'
    hidden: int = 512
    size: int = 64
    variational: bool = True
    heads: int = 4
    dropout: float = 0.2
    block_dropout: float = 0.1
    parts: tuple[str, ...] = ()  # of kind 'parts', for every joint the part of the body it is in; training fills it in

    @property
    def outputs(self) -> int:
        """Numbers that the encoder returns: mean and log variance, or the embedding alone."""
        return 2 * self.size if self.variational else self.size


class StyleDistribution(NamedTuple):
    """A Gaussian over style embeddings; not variational: `log_var` is None and `mean` is the style."""

    mean: Float[Array, " Z"]
    log_var: Float[Array, " Z"] | None


def _as_it_is(config: StyleEncoderConfig, skeleton: Skeleton) -> StyleEncoderConfig:
    return config


class Encoder(NamedTuple):
    """A kind of style encoder: two pure functions on a plain dict of parameters, for one clip.

    init(key, config, inputs) -> params: drawn for examples of `inputs` numbers a frame.
    apply(params, config, example[M, inputs], length, dropout_key, matmul) -> StyleDistribution of `config.size`
    numbers. `example` is scaled (`Scales.pose_in`), a pose vector (`motion.pose.to_vector`) and three columns of
    gaze in a row. Frames from `length` on, which may be traced, are padding: what stands there changes nothing.
    `dropout_key` is None outside training. With `matmul` "bfloat16" matrices in `params` come rounded.
    fit(config, skeleton) -> config: the config with what it has to know of the corpus's body, called by training.
    """

    init: Callable[[Array, StyleEncoderConfig, int], Any]
    apply: Callable[[Any, StyleEncoderConfig, Array, ArrayLike, Array | None, Matmul], StyleDistribution]
    fit: Callable[[StyleEncoderConfig, Skeleton], StyleEncoderConfig] = _as_it_is


def from_linen(
    network: Callable[[StyleEncoderConfig, Matmul], nn.Module],
    fit: Callable[[StyleEncoderConfig, Skeleton], StyleEncoderConfig] = _as_it_is,
) -> Encoder:
    """The Encoder of a Linen module that is called with (example, length, deterministic)."""

    def init(key: Array, config: StyleEncoderConfig, inputs: int) -> Any:
        return network(config, "float32").init(key, jnp.zeros((1, inputs)), 1)["params"]

    def apply(
        params: Any,
        config: StyleEncoderConfig,
        example: Float[Array, "M P"],
        length: ArrayLike,
        dropout_key: Array | None,
        matmul: Matmul,
    ) -> StyleDistribution:
        module: Any = network(config, matmul)
        rngs = None if dropout_key is None else {"dropout": dropout_key}
        return module.apply({"params": params}, example, length, dropout_key is None, rngs=rngs)

    return Encoder(init, apply, fit)


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
        kind = RecurrentEncoder if self.config.kind == "gru" else AttentionEncoder
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
        drop = Dropout(config.dropout, deterministic)
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
