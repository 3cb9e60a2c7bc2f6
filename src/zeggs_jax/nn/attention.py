"""Self-attention over one clip's frames: sinusoidal positions and the feed-forward transformer block.

ZeroEGGS Fig. 3b's block: attention, then two convolutions, each added to its input and normalised after.
Frames of padding (mask False) are neither attended to nor seen by a convolution.
"""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Bool, Float, Float32

from .compute import Matmul, operand, precision
from .layers import Conv, Dense, Dropout, LayerNorm

QUERIES = 512  # frames whose attention is formed at a time


def positions(frames: int, width: int) -> Float32[np.ndarray, "T E"]:
    """Sinusoidal table: even columns sin(p w_i), odd columns cos(p w_i), w_i = 10000^(-2i / width).

    Computed in float32 like the release's; against float64 it is off by 3e-5 at 512 frames.
    """
    rates = np.exp(np.arange(0, width, 2, dtype=np.float32) * np.float32(-math.log(10000.0) / width))
    angles = np.arange(frames, dtype=np.float32)[:, None] * rates[None, :]
    table = np.empty((frames, width), np.float32)
    table[:, 0::2], table[:, 1::2] = np.sin(angles), np.cos(angles[:, : width // 2])
    return table


def masked(x: Float[Array, "T C"], mask: Bool[Array, " T"]) -> Float[Array, "T C"]:
    """`x` with zeros in the padding, as beyond the ends of an unpadded clip."""
    return jnp.where(mask[:, None], x, 0.0)


def in_blocks(mix: Callable[[Array], Array], queries: Float[Array, "T h d"]) -> Float[Array, "T h d"]:
    """`mix`, which makes of every query one row, of at most QUERIES at a time: memory grows with the clip's length.

    All frames' weights at once would take memory by its square: 1 GB for 8000 frames and four heads.
    """
    frames = queries.shape[0]
    if frames <= QUERIES:
        return mix(queries)
    filled = jnp.pad(queries, ((0, -frames % QUERIES), (0, 0), (0, 0)))
    blocks = filled.reshape(-1, QUERIES, *queries.shape[1:])
    return jax.lax.map(jax.checkpoint(mix), blocks).reshape(filled.shape)[:frames]


class SelfAttention(nn.Module):
    """Multi-head self-attention; one projection (3E, E) makes queries, keys and values, in this order."""

    heads: int
    dropout: float
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(
        self, x: Float[Array, "T E"], mask: Bool[Array, " T"], deterministic: bool = True
    ) -> Float[Array, "T E"]:
        frames, width = x.shape
        stacked = Dense(3 * width, gain=1.0, zero_bias=True, matmul=self.matmul, name="project_in")(x)
        query, key, value = (a.reshape(frames, self.heads, -1) for a in jnp.split(stacked, 3, axis=-1))
        query, key, value = (operand(a, self.matmul) for a in (query / math.sqrt(width // self.heads), key, value))
        whole = not deterministic and self.dropout > 0  # dropout draws for all queries at once
        drop = Dropout(self.dropout, False)

        def mix(query: Float[Array, "Q h d"]) -> Float[Array, "Q h d"]:
            scores = jnp.einsum("qhd,khd->hqk", query, key, precision=precision(self.matmul))
            weights = jax.nn.softmax(jnp.where(mask[None, None, :], scores, -jnp.inf), axis=-1)
            weights = operand(drop(weights) if whole else weights, self.matmul)
            return jnp.einsum("hqk,khd->qhd", weights, value, precision=precision(self.matmul))

        mixed = (mix(query) if whole else in_blocks(mix, query)).reshape(frames, width)
        return Dense(width, zero_bias=True, matmul=self.matmul, name="project_out")(mixed)


class TransformerBlock(nn.Module):
    """Attention and two convolutions of width 3, each with dropout, residual and layer norm after it."""

    heads: int
    dropout: float
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(
        self, x: Float[Array, "T E"], mask: Bool[Array, " T"], deterministic: bool = True
    ) -> Float[Array, "T E"]:
        width = x.shape[-1]
        drop = Dropout(self.dropout, deterministic)
        attended = SelfAttention(self.heads, self.dropout, self.matmul, name="attention")(x, mask, deterministic)
        x = LayerNorm(name="attention_norm")(drop(attended) + x)
        inner = jax.nn.relu(Conv(width, 3, gain=math.sqrt(2.0), matmul=self.matmul, name="conv0")(masked(x, mask)))
        inner = Conv(width, 3, gain=1.0, matmul=self.matmul, name="conv1")(masked(inner, mask))
        return LayerNorm(name="conv_norm")(drop(inner) + x)
