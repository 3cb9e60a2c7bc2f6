"""The denoiser (Sec. 6.1, Fig. 6): a causal transformer from noisy latents, audio, words and a prompt to the noise.

Conditions come in at three places, as in the paper: audio joined to the input, words by semantics-aware attention
(Eq. 12), the prompt by AdaIN, here as an adaptive layer norm, since statistics over time would show a causal network
the future (gap 8). Without a prompt its gamma is 1 and its beta 0 exactly.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ..nn.layers import Dense
from ..speech.rhythm import SIZE as RHYTHM
from . import diffusion
from .attention import CausalAttention, Past, SemanticsAttention, Words
from .config import DiffuclipConfig

EPS = 1e-5  # of the layer norms
LEVEL_CHANNELS = 128  # sinusoids that a level is told by
ADAIN_GAIN = 0.2  # at first a prompt changes little


class Conditions(NamedTuple):
    """What the motion of a window is made from."""

    rhythm: Float[Array, "A 2"]  # onsets and amplitude of the window's latents and of `ahead` latents after them
    words: Float[Array, "S D"]  # of the joint embedding
    saliency: Float[Array, " S"]
    times: Float[Array, " S"]  # of the words' middles, in latents from the window's first
    word_mask: Bool[Array, " S"]
    style: Float[Array, " P"]  # the prompt
    prompted: Bool[ArrayLike, ""]  # False: no prompt, whatever `style` holds


class Memory(NamedTuple):
    """What the network keeps of latents before a chunk, so that they are not computed again at every step."""

    layers: tuple[Past, ...]
    seen: Bool[Array, " P"]  # which of them are there


@partial(jax.jit, static_argnames="config")
def init(key: Array, config: DiffuclipConfig) -> Any:
    """Drawn parameters, a plain dict."""
    z, level = jnp.zeros((1, config.latent_size)), jnp.zeros(1)
    return Denoiser(config).init(key, z, level, nothing(config, 1), level)["params"]


def nothing(config: DiffuclipConfig, latents: int) -> Conditions:
    """Conditions of silence, without words and prompt."""
    words = config.joint.words
    return Conditions(
        rhythm=jnp.zeros((latents + config.denoiser.ahead, RHYTHM)),
        words=jnp.zeros((words, config.joint.width)),
        saliency=jnp.zeros(words),
        times=jnp.zeros(words),
        word_mask=jnp.zeros(words, bool),
        style=jnp.zeros(config.prompts.size),
        prompted=jnp.zeros((), bool),
    )


def apply(
    params: Any,
    config: DiffuclipConfig,
    noisy: Float[Array, "L C"],
    level: Float[ArrayLike, "*L"],
    conditions: Conditions,
    key: Array | None = None,
) -> Float[Array, "L C"]:
    """The noise in latents of one window, each at its own `level` of 0 to N; with a `key`, under dropout.

    A latent's noise follows from it, the latents before it, the audio up to `ahead` latents after it, all words and
    the prompt.

    Raises:
        ValueError: audio of another length than the latents and `ahead` more.
    """
    at = jnp.arange(len(noisy), dtype=jnp.float32)
    return _run(params, config, noisy, level, conditions, at, key=key)[0]


def remember(
    params: Any,
    config: DiffuclipConfig,
    context: Float[Array, "P C"],
    level: Float[ArrayLike, "*P"],
    conditions: Conditions,
    seen: Bool[Array, " P"],
) -> Memory:
    """The memory of a context at latents 0..P-1 of a window, for `apply_after`; latents not `seen` are left out.

    Those must come after the others. `conditions` hold at least the audio of the context and `ahead` latents more.
    """
    at, reach = jnp.arange(len(context), dtype=jnp.float32), len(context) + config.denoiser.ahead
    told = conditions._replace(rhythm=conditions.rhythm[:reach])
    return Memory(_run(params, config, context, level, told, at)[1], seen)


def apply_after(
    params: Any,
    config: DiffuclipConfig,
    noisy: Float[Array, "K C"],
    level: Float[ArrayLike, "*K"],
    conditions: Conditions,
    start: ArrayLike,
    memory: Memory,
) -> Float[Array, "K C"]:
    """As `apply`, of latents `start`..start+K-1 behind a context that is remembered: same noise, less work.

    `conditions.rhythm` is that of the chunk and `ahead` latents more; the words' times count from the window's first.
    """
    at = jnp.asarray(start, jnp.float32) + jnp.arange(len(noisy), dtype=jnp.float32)
    return _run(params, config, noisy, level, conditions, at, memory)[0]


def _run(
    params: Any,
    config: DiffuclipConfig,
    noisy: Float[Array, "L C"],
    level: Float[ArrayLike, "*L"],
    conditions: Conditions,
    at: Float[Array, " L"],
    memory: Memory | None = None,
    key: Array | None = None,
) -> tuple[Float[Array, "L C"], tuple[Past, ...]]:
    latents, ahead = len(noisy), config.denoiser.ahead
    if len(conditions.rhythm) != latents + ahead:
        raise ValueError(
            f"audio of {len(conditions.rhythm)} latents came with {latents} noisy ones; expected {latents + ahead}, "
            f"{ahead} more, since every latent hears that far ahead."
        )
    level = jnp.broadcast_to(jnp.asarray(level, jnp.float32), (latents,))
    rngs = None if key is None else {"dropout": key}
    found: Any = Denoiser(config).apply(
        {"params": params}, noisy, level, conditions, at, memory, key is None, rngs=rngs
    )
    made, layers = found
    if config.denoiser.output == "noise":
        return made, layers
    schedule = diffusion.schedule(config.diffusion)
    return diffusion.noise_of(schedule, noisy, made, level), layers


def _sinusoids(x: Float[Array, " L"], channels: int) -> Float[Array, "L channels"]:
    rates = jnp.exp(jnp.arange(channels // 2) * (-math.log(10000.0) / (channels // 2)))
    angles = x[:, None] * rates[None, :]
    return jnp.concatenate([jnp.sin(angles), jnp.cos(angles)], axis=-1)


def _norm(x: Float[Array, "L E"]) -> Float[Array, "L E"]:
    """Layer norm over channels without gain and offset."""
    centred = x - x.mean(-1, keepdims=True)
    return centred * jax.lax.rsqrt(jnp.square(centred).mean(-1, keepdims=True) + EPS)


class AdaIN(nn.Module):
    """Channels normalised, then gamma and beta of the prompt; without a prompt gamma 1 and beta 0."""

    @nn.compact
    def __call__(
        self, x: Float[Array, "L E"], style: Float[Array, " H"], prompted: Bool[ArrayLike, ""]
    ) -> Float[Array, "L E"]:
        made = Dense(2 * x.shape[-1], gain=ADAIN_GAIN, zero_bias=True, name="modulation")(style)
        gamma, beta = jnp.split(jnp.where(prompted, made, 0.0), 2)
        return _norm(x) * (1.0 + jnp.broadcast_to(gamma, x.shape)) + jnp.broadcast_to(beta, x.shape)


class Block(nn.Module):
    """Self-attention, attention to words, AdaIN and a feed-forward network, each added to its input."""

    config: DiffuclipConfig

    @nn.compact
    def __call__(
        self,
        x: Float[Array, "L E"],
        at: Float[Array, " L"],
        words: Words,
        style: Float[Array, " H"],
        prompted: Bool[ArrayLike, ""],
        past: Past | None,
        seen: Bool[Array, " P"] | None,
        deterministic: bool,
    ) -> tuple[Float[Array, "L E"], Past]:
        sizes, width = self.config.denoiser, x.shape[-1]
        drop = nn.Dropout(sizes.dropout, deterministic=deterministic)
        attend = CausalAttention(sizes.heads, sizes.dropout, name="attention")
        attended, own = attend(nn.LayerNorm(EPS, name="attention_norm")(x), at, past, seen, deterministic)
        x = x + drop(attended)
        if sizes.transcript:
            heard = SemanticsAttention(sizes.heads, sizes.word_times, name="words")
            x = x + drop(heard(nn.LayerNorm(EPS, name="words_norm")(x), at, words))
        if sizes.style == "adain":
            normal = AdaIN(name="adain")(x, style, prompted)
        else:
            normal = nn.LayerNorm(EPS, name="norm")(x)
        inner = jax.nn.gelu(Dense(4 * width, gain=1.0, zero_bias=True, name="widen")(normal))
        return x + drop(Dense(width, gain=1.0, zero_bias=True, name="narrow")(inner)), own


class Denoiser(nn.Module):
    """Fig. 6; its output is the noise, or the velocity that the noise follows from."""

    config: DiffuclipConfig

    @nn.compact
    def __call__(
        self,
        noisy: Float[Array, "L C"],
        level: Float[Array, " L"],
        told: Conditions,
        at: Float[Array, " L"],
        memory: Memory | None = None,
        deterministic: bool = True,
    ) -> tuple[Float[Array, "L C"], tuple[Past, ...]]:
        config, sizes, latents = self.config, self.config.denoiser, len(noisy)
        audio = [told.rhythm[k : k + latents] for k in range(sizes.ahead + 1)]
        style = told.style
        inputs = [noisy, *audio]
        if sizes.style == "concatenated":
            known = jnp.where(told.prompted, jnp.concatenate([style, jnp.ones(1)]), 0.0)
            inputs.append(jnp.broadcast_to(known, (latents, len(known))))
        else:
            style = jax.nn.silu(Dense(config.prompts.size, gain=1.0, name="style")(style))
        x = Dense(sizes.width, gain=1.0, zero_bias=True, name="input")(jnp.concatenate(inputs, axis=-1))
        of_level = _sinusoids(level * (1000.0 / config.diffusion.steps), LEVEL_CHANNELS)
        of_level = jax.nn.silu(Dense(sizes.width, gain=1.0, name="level_in")(of_level))
        x = x + Dense(sizes.width, gain=1.0, name="level_out")(of_level)
        words = Words(told.words, told.saliency, told.times, told.word_mask)
        layers = []
        for k in range(sizes.layers):
            past, seen = (None, None) if memory is None else (memory.layers[k], memory.seen)
            block = Block(config, name=f"block{k}")
            x, own = block(x, at, words, style, told.prompted, past, seen, deterministic)
            layers.append(own)
        x = nn.LayerNorm(EPS, name="norm")(x)
        return Dense(config.latent_size, gain=0.1, zero_bias=True, name="output")(x), tuple(layers)
