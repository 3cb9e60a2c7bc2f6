"""Sec. 6.2.1: a video to the prompt space: an image tower on every picture, a transformer over the pictures (Eq. 18).

The paper's tower is CLIP's, frozen; the small one is three strided convolutions that are trained with the transformer.
"""

from typing import Any

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Float

from ..nn.attention import positions
from ..nn.layers import Dense
from . import bert
from .config import DiffuclipConfig, PromptsConfig
from .joint_embedding import unit

Params = Any
CHANNELS = ((16, 5), (32, 3), (64, 3))  # of each convolution of the small tower, and its size


class SmallTower(nn.Module):
    """A picture -> a vector."""

    width: int

    @nn.compact
    def __call__(self, image: Float[Array, "H W 3"]) -> Float[Array, " E"]:
        x = 2.0 * image - 1.0
        for channels, size in CHANNELS:
            x = jax.nn.relu(nn.Conv(channels, (size, size), strides=2)(x))
        return Dense(self.width, gain=1.0, zero_bias=True)(x.reshape(-1))


class VideoEncoder(nn.Module):
    """Pictures, or the vectors of a frozen tower, in order -> prompt space."""

    config: PromptsConfig

    @nn.compact
    def __call__(self, seen: Float[Array, "V ..."], deterministic: bool = True) -> Float[Array, " size"]:
        c = self.config
        if c.image == "small":
            tower = nn.vmap(SmallTower, variable_axes={"params": None}, split_rngs={"params": False})
            seen = tower(c.video_width, name="tower")(seen)
        x = Dense(c.video_width, gain=1.0, zero_bias=True, name="enter")(seen)
        first = self.param("class", nn.initializers.normal(0.02), (1, c.video_width))
        x = jnp.concatenate([first, x + positions(len(x), c.video_width)])
        x = nn.Dropout(c.dropout, deterministic=deterministic)(bert.norm(1e-5, "enter_norm")(x))
        whole = jnp.ones(len(x), bool)
        x = bert.Encoder(c.video_layers, c.video_heads, c.dropout, 1e-5, name="blocks")(x, whole, deterministic)
        return unit(Dense(c.size, gain=1.0, zero_bias=True, name="leave")(x[0]))


def init(key: Array, config: DiffuclipConfig, vector: int = 0) -> Params:
    """Drawn parameters; `vector` is how many numbers the frozen tower gives for a picture, where there is one."""
    c = config.prompts
    seen = jnp.zeros((2, vector)) if c.image == "clip" else jnp.zeros((2, c.pixels, c.pixels, 3))
    return VideoEncoder(c).init(key, seen)["params"]


def encode(
    params: Params, config: DiffuclipConfig, seen: Float[Array, "V ..."], key: Array | None = None
) -> Float[Array, " size"]:
    """The prompt that a video is, of unit length: of its pictures [V, H, W, 3], 0 to 1, or CLIP's vectors [V, E]."""
    rngs = None if key is None else {"dropout": key}
    made = VideoEncoder(config.prompts).apply({"params": params}, jnp.asarray(seen), key is None, rngs=rngs)
    return jnp.asarray(made)
