"""Stage 5, the denoiser (Sec. 6.2): noise, meaning and style losses on windows of takes, all else frozen."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32

from ...data import scale
from ...data.scale import Scale
from ...training.step import TrainState, begin, make_step, trained
from .. import denoiser, diffusion, losses, prompts
from ..config import DiffuclipConfig
from ..model import conditions, words_near
from ..tokens import Tokens
from .stage import Encoded, Material, Params, Stage, Take, optimiser, window

STRETCHES = 12  # prompts of different stretches of each take
SHORTEST_S = 2.0  # of a motion prompt


class Window(NamedTuple):
    """A window of a take, and the prompt it is made under."""

    latents: Float[Array, "L C"]
    mask: Bool[Array, " L"]
    rhythm: Float[Array, "A 2"]  # `ahead` latents longer
    spoken: Tokens
    motion: Float[Array, "N D"]  # scaled; as much of the window as a prompt may hold
    motion_mask: Bool[Array, " N"]
    style: Float[Array, " P"]


class Frozen(NamedTuple):
    """What is not trained."""

    params: Params
    latent_scale: Scale


def stage(config: DiffuclipConfig, material: Material, params: dict[str, Params]) -> Stage:
    """The stage; `params` holds codes, joint and prompts, `material` the encoded takes."""
    settings, steps = config.learn_denoiser, optimiser(config.learn_denoiser)
    assert material.latent_scale is not None
    frozen = Frozen({name: params[name] for name in ("codes", "joint", "prompts")}, material.latent_scale)
    table = _prompts(config, material, frozen.params)
    step = make_step(partial(loss_fn, config), steps, config.seed, ema=settings.ema, frozen=frozen)
    judge = jax.jit(partial(_judge, config))
    held = _batch(config, material, table, 0, "valid")

    def validate(state: TrainState) -> dict[str, float]:
        return {"loss": float(judge(trained(state), held, frozen))}

    return Stage(
        begin=lambda key: begin(denoiser.init(key, config), steps, settings.ema is not None),
        step=step,
        batch=lambda k: _batch(config, material, table, k, "train"),
        finish=trained,
        validate=validate if any(take.split == "valid" for take in material.takes) else None,
    )


def loss_fn(
    config: DiffuclipConfig, params: Params, batch: Window, keys: Array, step: Array, frozen: Frozen
) -> tuple[Array, dict[str, Array]]:
    """Eq. 14-16 over a batch, weighted; the perceptual terms on its first `perceptual` clips."""
    each = partial(_noise_loss, config, params, frozen)
    noises, estimates, trust = jax.vmap(each)(batch, keys)
    terms = {"noise": jnp.mean(noises)}
    weights = config.diffusion
    if weights.semantic or weights.style:
        some = max(1, round(weights.perceptual * len(keys)))
        first = jax.tree.map(lambda leaf: leaf[:some], (batch, estimates, trust))
        judged = jax.vmap(partial(_perceptual, config, frozen))(*first)
        terms |= {name: jnp.mean(value) for name, value in judged.items()}
    total = terms["noise"] + weights.semantic * terms.get("meaning", 0.0) + weights.style * terms.get("style", 0.0)
    return total, terms


def _noise_loss(
    config: DiffuclipConfig, params: Params, frozen: Frozen, clip: Window, key: Array
) -> tuple[Array, Array, Array]:
    """(Eq. 14's noise term, the latents as the network would make them, how far these can be trusted)."""
    keys = jax.random.split(key, 5)
    schedule = diffusion.schedule(config.diffusion)
    level, noisy = levels(keys[0], config, len(clip.latents))
    drawn = jax.random.normal(keys[1], clip.latents.shape)
    prompted = jax.random.bernoulli(keys[2], 1.0 - config.diffusion.dropped)
    told = conditions(frozen.params, config, clip.rhythm, clip.spoken, clip.style, prompted)
    z = diffusion.diffuse(schedule, clip.latents, drawn, level)
    found = denoiser.apply(params, config, z, level, told, keys[3])
    counted = noisy & clip.mask
    apart = losses.noise(found, drawn, counted, losses.noise_weight(config, schedule, level))
    if config.diffusion.short_steps:

        def denoise(z: Array, level: Array) -> Array:
            return denoiser.apply(params, config, z, level, told)

        again = jax.random.normal(keys[4], clip.latents.shape)
        made = losses.short_denoising(config, schedule, denoise, clip.latents, again, noisy)
        return apart, made, jnp.ones(())
    clean = jnp.where(noisy[:, None], diffusion.estimate(schedule, z, found, level), clip.latents)
    kept = schedule.alpha_bar[level.astype(jnp.int32)]
    trust = jnp.sum(jnp.where(counted, kept, 0.0)) / jnp.maximum(jnp.sum(counted), 1)
    return apart, jnp.clip(clean, -6.0, 6.0), trust


def _perceptual(
    config: DiffuclipConfig, frozen: Frozen, clip: Window, made: Float[Array, "L C"], trust: Float[Array, ""]
) -> dict[str, Array]:
    """Eq. 15 and 16 of one clip, as far as its estimate can be trusted."""
    terms, weights = {}, config.diffusion
    if weights.semantic:
        apart = losses.meaning(frozen.params, config, frozen.latent_scale, clip.latents, made, clip.mask)
        terms["meaning"] = trust * apart
    if weights.style:
        apart = losses.style(frozen.params, config, frozen.latent_scale, clip.motion, made, clip.motion_mask)
        terms["style"] = trust * apart
    return terms


def levels(key: Array, config: DiffuclipConfig, latents: int) -> tuple[Float[Array, " L"], Bool[Array, " L"]]:
    """(noise level of each latent, which are noisy): a clean context of random length, then one level for the rest.

    In a share `independent` of the windows every noisy latent has a level of its own. Without `per_token` all latents
    share one level, as the paper trains (gap 10).
    """
    settings = config.diffusion
    keys = jax.random.split(key, 4)
    shared = jax.random.randint(keys[0], (), 1, settings.steps + 1).astype(jnp.float32)
    if not settings.per_token:
        return jnp.full(latents, shared), jnp.ones(latents, bool)
    own = jax.random.randint(keys[1], (latents,), 1, settings.steps + 1).astype(jnp.float32)
    level = jnp.where(jax.random.bernoulli(keys[2], settings.independent), own, shared)
    longest = min(settings.context, latents - 1)
    noisy = jnp.arange(latents) >= jax.random.randint(keys[3], (), 0, longest + 1)
    return jnp.where(noisy, level, 0.0), noisy


def _judge(config: DiffuclipConfig, params: Params, held: Window, frozen: Frozen) -> Array:
    """The noise loss of held-out windows at fixed levels and noise, with their prompts."""
    keys = jax.random.split(jax.random.key(0), len(held.style))
    return jnp.mean(jax.vmap(partial(_noise_loss, config, params, frozen))(held, keys)[0])


def _batch(config: DiffuclipConfig, material: Material, table: "Table", k: int, split: str) -> Window:
    """Batch k: random windows of takes, drawn by their length, each under a prompt of its take."""
    settings, draw = config.learn_denoiser, np.random.default_rng([config.seed, 6, k])
    chosen = [i for i, take in enumerate(material.takes) if take.split == split] or list(range(len(material.takes)))
    long = np.array([len(material.encoded[i].latents) for i in chosen], float)
    picked = draw.choice(chosen, settings.batch, p=long / long.sum())
    length = round(settings.seconds * config.latents_hz)
    rows = []
    for i in picked.tolist():
        start = int(draw.integers(0, max(len(material.encoded[i].latents) - length, 0) + 1))
        captioned = draw.random() < config.diffusion.captioned
        prompts_of = (table.captions if captioned else table.motions)[i]
        style = prompts_of[draw.integers(len(prompts_of))]
        rows.append(
            _window(config, material.takes[i], material.encoded[i], material.motion_scale, start, length, style)
        )
    return jax.tree.map(lambda *leaves: np.stack(leaves), *rows)


def _window(
    config: DiffuclipConfig, take: Take, encoded: Encoded, motion_scale: Scale, start: int, length: int, style: Any
) -> Window:
    rate = config.codes.rate
    frames = min(length * rate, config.prompts.frames)
    latents, mask = window(encoded.latents, start, length)
    motion, motion_mask = window(take.motion[start * rate :][:frames], 0, frames)
    motion = (motion - motion_scale.mean) / motion_scale.std
    rhythm, _ = window(take.rhythm, start, length + config.denoiser.ahead)
    spoken = words_near(take.words, config, start, length)
    rows: Any = (latents, mask, rhythm, spoken, motion.astype(np.float32), motion_mask, style)
    return Window(*rows)


class Table(NamedTuple):
    """The prompts of each take."""

    motions: Sequence[Float32[np.ndarray, "K P"]]
    captions: Sequence[Float32[np.ndarray, "K P"]]


def _prompts(config: DiffuclipConfig, material: Material, params: Params) -> Table:
    """Prompt embeddings of random stretches of every take, of many lengths, and of its captions (gap 20)."""
    draw, longest = np.random.default_rng([config.seed, 5]), config.prompts.frames
    shortest = min(longest, round(SHORTEST_S / config.frame_time))
    embed = jax.jit(jax.vmap(partial(prompts.encode_motion, params["prompts"], config)))
    motions, captions = [], []
    for take in material.takes:
        rows = []
        for _ in range(STRETCHES):
            frames = int(draw.integers(shortest, longest + 1))
            start = int(draw.integers(0, max(len(take.motion) - frames, 0) + 1))
            rows.append(window(take.motion[: start + frames], start, longest))
        stretch, mask = (np.stack(column) for column in zip(*rows, strict=True))
        motions.append(np.asarray(embed(scale.apply(material.motion_scale, stretch), mask)))
        captions.append(np.asarray(prompts.embed_texts(params["prompts"], config, take.captions)))
    return Table(motions, captions)
