"""Sec. 4: the VQ-VAE, motion to codes and back; convolutions as in Jukebox, a net and codebooks for each body part."""

from typing import Any

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Float, Int

from ..data.scale import Scale
from ..motion.skeleton import Skeleton
from ..nn.layers import Dense, torch_bound, uniform
from . import body_parts, quantiser
from .config import CodesConfig, DiffuclipConfig
from .quantiser import Book

Params = Any
FLOOR = 1e-4  # least standard deviation of a channel of Z


class Conv(nn.Module):
    """Convolution over frames, T / stride of them; beyond the ends the first and last frame are repeated."""

    features: int
    kernel: int
    stride: int = 1
    dilation: int = 1

    @nn.compact
    def __call__(self, x: Float[Array, "T in"]) -> Float[Array, "S out"]:
        bound = torch_bound(self.kernel * x.shape[-1])
        weight = self.param("weight", uniform(bound), (self.features, self.kernel, x.shape[-1]))
        bias = self.param("bias", uniform(bound), (self.features,))
        reach = self.dilation * (self.kernel - 1) + 1 - self.stride
        padded = jnp.pad(x, ((reach // 2, reach - reach // 2), (0, 0)), mode="edge")
        product = jax.lax.conv_general_dilated(
            padded[None],
            weight,
            (self.stride,),
            "VALID",
            rhs_dilation=(self.dilation,),
            dimension_numbers=("NWC", "OWI", "NWC"),
        )[0]
        return product + jnp.broadcast_to(bias, product.shape)


class Residual(nn.Module):
    """Blocks of a dilated convolution of width 3 and one of width 1, added to their input."""

    config: CodesConfig
    reverse: bool = False  # the widest dilation first, as in the decoder

    @nn.compact
    def __call__(self, x: Float[Array, "T W"]) -> Float[Array, "T W"]:
        growth = [self.config.dilation**k for k in range(self.config.depth)]
        for k, dilation in enumerate(reversed(growth) if self.reverse else growth):
            inner = Conv(x.shape[-1], 3, dilation=dilation, name=f"wide{k}")(jax.nn.relu(x))
            x = x + Dense(x.shape[-1], name=f"narrow{k}")(jax.nn.relu(inner))
        return x


class Encoder(nn.Module):
    """Every halving is a convolution of width 4 and stride 2, then residual blocks."""

    config: CodesConfig

    @nn.compact
    def __call__(self, x: Float[Array, "T D"]) -> Float[Array, "L C"]:
        for k in range(self.config.halvings):
            x = Conv(self.config.width, 4, 2, name=f"halve{k}")(x)
            x = Residual(self.config, name=f"residual{k}")(x)
        return Conv(self.config.latent, 3, name="out")(x)


class Decoder(nn.Module):
    """The encoder backwards; a frame doubles by a convolution that makes two out of three."""

    config: CodesConfig
    columns: int

    @nn.compact
    def __call__(self, x: Float[Array, "L C"]) -> Float[Array, "T D"]:
        width = self.config.width
        x = Conv(width, 3, name="into")(x)
        for k in range(self.config.halvings):
            x = Residual(self.config, reverse=True, name=f"residual{k}")(x)
            x = Conv(2 * width, 3, name=f"double{k}")(x).reshape(-1, width)
        return Conv(self.columns, 3, name="out")(jax.nn.relu(x))


def init(key: Array, config: DiffuclipConfig, skeleton: Skeleton) -> Params:
    """For each part of the body: its columns of a motion frame, encoder, decoder and codebooks, these without users.

    ValueError where the skeleton has another number of joints than the config, or no hips and spine to divide it by.
    """
    if len(skeleton) != config.joints:
        raise ValueError(f"The skeleton has {len(skeleton)} joints and the config {config.joints}; set joints to that.")
    made, codes = {}, config.codes
    columns = body_parts.columns(skeleton, config.parts)
    for part, own, drawn in zip(body_parts.names(config), columns, jax.random.split(key, len(columns)), strict=True):
        encoder_key, decoder_key = jax.random.split(drawn)
        frames = jax.ShapeDtypeStruct((codes.rate, len(own)), jnp.float32)
        latents = jax.ShapeDtypeStruct((1, codes.latent), jnp.float32)
        made[part] = {
            "columns": jnp.asarray(own, jnp.int32),
            "encoder": Encoder(codes).lazy_init(encoder_key, frames)["params"],
            "decoder": Decoder(codes, len(own)).lazy_init(decoder_key, latents)["params"],
            "book": quantiser.init(codes.quantisers, codes.codes, codes.latent)._asdict(),
        }
    return made


def encode(params: Params, config: DiffuclipConfig, motion: Float[Array, "T D"]) -> Float[Array, "L C"]:
    """Z of scaled motion, not quantised, the parts' channels side by side; L = T / rate, the last frame repeated."""
    padded = jnp.pad(motion, ((0, -len(motion) % config.codes.rate), (0, 0)), mode="edge")
    parts = [encode_part(params[part], config, padded) for part in body_parts.names(config)]
    return jnp.concatenate(parts, axis=-1)


def encode_part(part: Params, config: DiffuclipConfig, motion: Float[Array, "T D"]) -> Float[Array, "L C"]:
    """Z of one part, whose parameters are given; T is a multiple of the rate."""
    return Encoder(config.codes).apply({"params": part["encoder"]}, motion[:, part["columns"].astype(jnp.int32)])  # type: ignore[return-value]


def quantise(
    params: Params, config: DiffuclipConfig, z: Float[Array, "L C"]
) -> tuple[Float[Array, "L C"], Int[Array, "L Q"]]:
    """Quantised Z, with a gradient straight through, and the codes: Q of the first part, then of the next."""
    parts = body_parts.names(config)
    pieces = jnp.split(z, len(parts), axis=-1)
    made = [quantiser.quantise(book(params[part]), piece) for part, piece in zip(parts, pieces, strict=True)]
    return jnp.concatenate([m.vectors for m in made], axis=-1), jnp.concatenate([m.codes for m in made], axis=-1)


def book(part: Params) -> Book:
    """The codebooks of a part's parameters."""
    return Book(**part["book"])


def decode(params: Params, config: DiffuclipConfig, quantised: Float[Array, "L C"]) -> Float[Array, "T D"]:
    """Scaled motion of quantised Z (`quantise` first, as Sec. 4), T = rate L."""
    parts = body_parts.names(config)
    pieces = jnp.split(quantised, len(parts), axis=-1)
    made = [decode_part(params[part], config, piece) for part, piece in zip(parts, pieces, strict=True)]
    order = jnp.concatenate([params[part]["columns"].astype(jnp.int32) for part in parts])
    return jnp.concatenate(made, axis=-1)[:, jnp.argsort(order)]


def decode_part(part: Params, config: DiffuclipConfig, quantised: Float[Array, "L C"]) -> Float[Array, "T n"]:
    """The columns of one part."""
    decoder = Decoder(config.codes, len(part["columns"]))
    return decoder.apply({"params": part["decoder"]}, quantised)  # type: ignore[return-value]


def reconstruct(params: Params, config: DiffuclipConfig, motion: Float[Array, "T D"]) -> Float[Array, "T D"]:
    """Scaled motion through its codes, cut to its length."""
    quantised, _ = quantise(params, config, encode(params, config, motion))
    return decode(params, config, quantised)[: len(motion)]


def latent_scale(z: Float[Array, "N C"]) -> Scale:
    """Mean and standard deviation of every channel of Z, over the latents of the training takes (gap 2)."""
    z = jnp.asarray(z)
    return Scale(z.mean(axis=0), jnp.maximum(z.std(axis=0), FLOOR))
