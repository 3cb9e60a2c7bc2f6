"""The denoiser's two attentions (Fig. 6): causal over latents, and semantics-aware over words (Eq. 12).

Both tell time by rotating queries and keys (RoPE, Su et al. 2021): what a latent sees depends on how far away it is, in
latents, never on where the window begins. Words are rotated by the time that they are spoken at.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Bool, Float

from ..nn.layers import Dense

SLOWEST = 1000.0  # latents: the slowest rotation turns by one radian in so many


class Past(NamedTuple):
    """Keys and values of latents before the ones at hand; the keys are rotated."""

    keys: Float[Array, "P H d"]
    values: Float[Array, "P H d"]


class Words(NamedTuple):
    """The words that latents attend to."""

    vectors: Float[Array, "S D"]
    saliency: Float[Array, " S"]
    times: Float[Array, " S"]  # in latents
    mask: Bool[Array, " S"]


def rotate(x: Float[Array, "T H d"], at: Float[Array, " T"]) -> Float[Array, "T H d"]:
    """Turn pairs of channels by `at` times their rates; a last odd channel stays as it is."""
    pairs = x.shape[-1] // 2
    rates = SLOWEST ** (-jnp.arange(pairs, dtype=jnp.float32) / max(pairs, 1))
    angles = (at[:, None] * rates[None, :])[:, None, :]
    cos, sin = (jnp.broadcast_to(f(angles), (*x.shape[:-1], pairs)) for f in (jnp.cos, jnp.sin))
    first, second, rest = x[..., :pairs], x[..., pairs : 2 * pairs], x[..., 2 * pairs :]
    return jnp.concatenate([first * cos - second * sin, first * sin + second * cos, rest], axis=-1)


class CausalAttention(nn.Module):
    """Multi-head attention of latents to themselves and to latents before them, and to a `past` that is `seen`."""

    heads: int
    dropout: float

    @nn.compact
    def __call__(
        self,
        x: Float[Array, "L E"],
        at: Float[Array, " L"],
        past: Past | None = None,
        seen: Bool[Array, " P"] | None = None,
        deterministic: bool = True,
    ) -> tuple[Float[Array, "L E"], Past]:
        length, width = x.shape
        stacked = Dense(3 * width, gain=1.0, zero_bias=True, name="project_in")(x)
        query, key, value = (a.reshape(length, self.heads, width // self.heads) for a in jnp.split(stacked, 3, axis=-1))
        query, own = rotate(query, at), Past(rotate(key, at), value)
        keys, values, open_ = own.keys, own.values, jnp.tril(jnp.ones((length, length), bool))
        if past is not None and seen is not None:
            keys, values = jnp.concatenate([past.keys, keys]), jnp.concatenate([past.values, values])
            open_ = jnp.concatenate([jnp.broadcast_to(seen[None], (length, len(seen))), open_], axis=1)
        scores = jnp.einsum("qhd,khd->hqk", query, keys) / math.sqrt(query.shape[-1])
        weights = jax.nn.softmax(jnp.where(open_[None], scores, -jnp.inf), axis=-1)
        weights = nn.Dropout(self.dropout)(weights, deterministic=deterministic)
        mixed = jnp.einsum("hqk,khd->qhd", weights, values).reshape(length, width)
        return Dense(width, gain=1.0, zero_bias=True, name="project_out")(mixed), own


class SemanticsAttention(nn.Module):
    """Eq. 12: attention of latents to words, softmax((Q K^T / sqrt(C)) * saliency) V; without any word it is 0.

    A saliency of 1 for every word is plain attention. With `timed` the scores depend on when a word is spoken.
    """

    heads: int
    timed: bool

    @nn.compact
    def __call__(self, x: Float[Array, "L E"], at: Float[Array, " L"], words: Words) -> Float[Array, "L E"]:
        length, width = x.shape
        query = Dense(width, gain=1.0, zero_bias=True, name="queries")(x)
        query = query.reshape(length, self.heads, width // self.heads)
        stacked = Dense(2 * width, gain=1.0, zero_bias=True, name="keys_values")(words.vectors)
        key, value = (a.reshape(len(words.mask), *query.shape[1:]) for a in jnp.split(stacked, 2, axis=-1))
        if self.timed:
            query, key = rotate(query, at), rotate(key, words.times)
        scores = jnp.einsum("qhd,khd->hqk", query, key) / math.sqrt(query.shape[-1])
        scores = jnp.where(words.mask[None, None], scores * words.saliency[None, None], -1e9)  # finite without words
        mixed = jnp.einsum("hqk,khd->qhd", jax.nn.softmax(scores, axis=-1), value).reshape(length, width)
        return jnp.where(words.mask.any(), Dense(width, gain=1.0, zero_bias=True, name="project_out")(mixed), 0.0)
