"""The denoiser's losses (Sec. 6.2): noise (Eq. 14), meaning (Eq. 15) and style (Eq. 16) of the motion it makes."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ..data import scale
from ..data.scale import Scale
from . import diffusion, joint_embedding, prompts, vqvae
from .config import DiffuclipConfig
from .diffusion import Schedule
from .model import decode

Params = Any
Denoise = Callable[[Float[Array, "L C"], Float[Array, " L"]], Float[Array, "L C"]]
"""(noisy latents, the level of each) -> their noise."""


def noise(
    found: Float[Array, "L C"],
    true: Float[Array, "L C"],
    counted: Bool[Array, " L"],
    weight: Float[ArrayLike, "*L"] = 1.0,
) -> Float[Array, ""]:
    """Mean squared error of the noise over the latents that are counted (Eq. 14, first term), with weights."""
    apart = weight * jnp.mean((found - true) ** 2, axis=-1)
    return jnp.sum(jnp.where(counted, apart, 0.0)) / jnp.maximum(jnp.sum(counted), 1)


def noise_weight(config: DiffuclipConfig, schedule: Schedule, level: Float[Array, " L"]) -> Float[Array, " L"]:
    """1 as printed; for a network whose output is a velocity 1 / alpha^2, which makes the error that of the velocity.

    The printed error all but leaves out high levels of such a network, at which style and meaning are decided.
    """
    if config.denoiser.output == "noise":
        return jnp.ones_like(level)
    alpha, _ = diffusion.amounts(schedule, level)
    return 1.0 / alpha**2


def meaning(
    params: Params,
    config: DiffuclipConfig,
    z_scale: Scale,
    true: Float[Array, "L C"],
    made: Float[Array, "L C"],
    mask: Bool[Array, " L"],
) -> Float[Array, ""]:
    """1 - cosine of the gesture embeddings of true and made latents, both quantised (Eq. 15)."""

    def embedded(latents: Float[Array, "L C"]) -> Float[Array, " D"]:
        quantised, _ = vqvae.quantise(params["codes"], config, scale.invert(z_scale, latents))
        return joint_embedding.encode_gesture(params["joint"], config, scale.apply(z_scale, quantised), mask).pooled

    return 1.0 - cosine(jax.lax.stop_gradient(embedded(true)), embedded(made))


def style(
    params: Params,
    config: DiffuclipConfig,
    z_scale: Scale,
    true: Float[Array, "N D"],
    made: Float[Array, "L C"],
    mask: Bool[Array, " N"],
) -> Float[Array, ""]:
    """1 - cosine of the prompt embeddings of the true motion and of the made latents' (Eq. 16); motions scaled."""
    moved = decode(params["codes"], config, z_scale, made)[: len(true)]
    embedded = partial(prompts.encode_motion, params["prompts"], config)
    return 1.0 - cosine(jax.lax.stop_gradient(embedded(true, mask)), embedded(moved, mask))


def cosine(a: Float[Array, " n"], b: Float[Array, " n"]) -> Float[Array, ""]:
    """Cosine of the angle between two vectors; its gradient is finite at zero."""
    return jnp.sum(a * b) / jnp.sqrt(jnp.sum(a * a) * jnp.sum(b * b) + 1e-12)


def short_denoising(
    config: DiffuclipConfig,
    schedule: Schedule,
    denoise: Denoise,
    latents: Float[Array, "L C"],
    drawn: Float[Array, "L C"],
    noisy: Bool[Array, " L"],
) -> Float[Array, "L C"]:
    """Latents noised to `return_step` with the noise `drawn` and denoised again in a few DDIM steps.

    The way of DiffusionCLIP (gap 11) for the perceptual terms; each step's network is computed again in the backward
    pass. Latents that are not `noisy` stay as they are, clean context.
    """
    diffuse = config.diffusion
    levels = jnp.linspace(diffuse.return_step, 0, diffuse.short_steps + 1).round()
    start = jnp.where(noisy, levels[0], 0.0)
    z = jnp.where(noisy[:, None], diffusion.diffuse(schedule, latents, drawn, start), latents)
    evaluate = jax.checkpoint(denoise)
    for k in range(diffuse.short_steps):
        here, there = (jnp.where(noisy, level, 0.0) for level in (levels[k], levels[k + 1]))
        stepped = diffusion.ddim_step(schedule, z, evaluate(z, here), here, there)
        z = jnp.where(noisy[:, None], stepped, latents)
    return z
