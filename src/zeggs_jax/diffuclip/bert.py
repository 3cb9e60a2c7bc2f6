"""BERT's encoder (Devlin et al. 2019): blocks of attention and two dense layers, each normalised after its residual."""

import math

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Bool, Float

from ..nn.layers import Dense

HIDDEN = -1e9  # the logit of padding: finite, so that a sequence of nothing but padding is finite too


class Attention(nn.Module):
    """Multi-head self-attention; padding is not attended to."""

    heads: int
    dropout: float = 0.0

    @nn.compact
    def __call__(
        self, x: Float[Array, "T E"], mask: Bool[Array, " T"], deterministic: bool = True
    ) -> Float[Array, "T E"]:
        length, width = x.shape
        query, key, value = (
            Dense(width, gain=1.0, zero_bias=True, name=name)(x).reshape(length, self.heads, -1)
            for name in ("query", "key", "value")
        )
        scores = jnp.einsum("qhd,khd->hqk", query / math.sqrt(width // self.heads), key)
        weights = jax.nn.softmax(jnp.where(mask[None, None, :], scores, HIDDEN), axis=-1)
        weights = nn.Dropout(self.dropout)(weights, deterministic=deterministic)
        mixed = jnp.einsum("hqk,khd->qhd", weights, value).reshape(length, width)
        return Dense(width, gain=1.0, zero_bias=True, name="out")(mixed)


class Block(nn.Module):
    """Attention, then two dense layers with GELU between (`inner` wide)."""

    heads: int
    inner: int
    dropout: float = 0.0
    eps: float = 1e-12

    @nn.compact
    def __call__(
        self, x: Float[Array, "T E"], mask: Bool[Array, " T"], deterministic: bool = True
    ) -> Float[Array, "T E"]:
        drop = nn.Dropout(self.dropout, deterministic=deterministic)
        attended = Attention(self.heads, self.dropout, name="attention")(x, mask, deterministic)
        x = norm(self.eps, "attention_norm")(x + drop(attended))
        inner = jax.nn.gelu(Dense(self.inner, gain=1.0, zero_bias=True, name="widen")(x), approximate=False)
        return norm(self.eps, "norm")(x + drop(Dense(x.shape[-1], gain=1.0, zero_bias=True, name="narrow")(inner)))


class Encoder(nn.Module):
    """`layers` blocks, each `4 E` wide inside."""

    layers: int
    heads: int
    dropout: float = 0.0
    eps: float = 1e-12

    @nn.compact
    def __call__(
        self, x: Float[Array, "T E"], mask: Bool[Array, " T"], deterministic: bool = True
    ) -> Float[Array, "T E"]:
        for k in range(self.layers):
            x = Block(self.heads, 4 * x.shape[-1], self.dropout, self.eps, name=f"block{k}")(x, mask, deterministic)
        return x


def norm(eps: float, name: str) -> nn.Module:
    """Layer norm over channels with a two-pass variance."""
    return nn.LayerNorm(epsilon=eps, use_fast_variance=False, name=name)
