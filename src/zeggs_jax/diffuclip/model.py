"""GestureDiffuCLIP as a whole (Fig. 2): its parameters, and what turns speech, words and prompts into conditions."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..data import scale
from ..data.scale import Scale
from ..motion.skeleton import Skeleton
from ..speech.transcript import Word
from . import denoiser, joint_embedding, prompts, tokens, vqvae
from .config import DiffuclipConfig
from .denoiser import Conditions
from .stages.stage import Encoded, Take
from .tokens import Reader, Tokens

Params = Any
PADDING = 256  # frames; clips are encoded at few lengths
MARGIN_S = 1.0  # words this long before and after a window are heard with it


class Model(NamedTuple):
    """All that generation needs."""

    config: DiffuclipConfig
    params: Params  # codes, joint, prompts, denoiser
    motion_scale: Scale  # of the columns of a motion frame
    latent_scale: Scale  # of the channels of Z
    skeleton: Skeleton


def init(key: Array, config: DiffuclipConfig, skeleton: Skeleton) -> Params:
    """All components with drawn parameters."""
    keys = jax.random.split(key, 4)
    return {
        "codes": vqvae.init(keys[0], config, skeleton),
        "joint": joint_embedding.init(keys[1], config),
        "prompts": prompts.init(keys[2], config, skeleton),
        "denoiser": denoiser.init(keys[3], config),
    }


def encode_takes(
    params: Params, config: DiffuclipConfig, motion_scale: Scale, takes: Sequence[Take]
) -> tuple[Scale, list[Encoded]]:
    """The latents of all takes under frozen codes, scaled; the scale is of the takes of the split 'train' (gap 2)."""
    raw = [_encode(params, config, motion_scale, take.motion) for take in takes]
    seen = np.concatenate([z for (z, _, _), take in zip(raw, takes, strict=True) if take.split == "train"])
    z_scale = Scale(seen.mean(axis=0), np.maximum(seen.std(axis=0), 1e-4))
    whiten = partial(scale.apply, z_scale)
    return z_scale, [Encoded(np.asarray(whiten(z)), np.asarray(whiten(zq)), codes) for z, zq, codes in raw]


def _encode(
    params: Params, config: DiffuclipConfig, motion_scale: Scale, motion: Float[np.ndarray, "T D"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(Z, quantised Z, codes) of one motion; its last frame is repeated up to a length that others have too."""
    latents = -(-len(motion) // config.codes.rate)
    padded = np.pad(motion, ((0, -len(motion) % PADDING), (0, 0)), mode="edge")
    made = _encode_padded(params, config, motion_scale, padded)
    return tuple(np.asarray(x)[:latents] for x in made)  # type: ignore[return-value]


@partial(jax.jit, static_argnames="config")
def _encode_padded(
    params: Params, config: DiffuclipConfig, motion_scale: Scale, motion: Float[Array, "T D"]
) -> tuple[Array, Array, Array]:
    z = vqvae.encode(params, config, scale.apply(motion_scale, motion))
    return z, *vqvae.quantise(params, config, z)


def latents_of(model: Model, motion: Float[np.ndarray, "T D"]) -> Float[np.ndarray, "L C"]:
    """Scaled Z of a motion (`representation.encode`)."""
    z, _, _ = _encode(model.params["codes"], model.config, model.motion_scale, motion)
    return np.asarray(scale.apply(model.latent_scale, z))


def motion_of(model: Model, latents: Float[np.ndarray, "L C"]) -> Float[np.ndarray, "T D"]:
    """The motion that scaled latents stand for: quantised, decoded, unscaled."""
    rate = model.config.codes.rate
    padded = np.pad(latents, ((0, -len(latents) % (PADDING // rate)), (0, 0)), mode="edge")
    codes = model.params["codes"]
    return np.asarray(_decode_padded(codes, model.config, model.latent_scale, model.motion_scale, padded))[
        : len(latents) * rate
    ]


@partial(jax.jit, static_argnames="config")
def _decode_padded(
    params: Params, config: DiffuclipConfig, z_scale: Scale, motion_scale: Scale, latents: Float[Array, "L C"]
) -> Float[Array, "T D"]:
    return scale.invert(motion_scale, decode(params, config, z_scale, latents))


def decode(
    params: Params, config: DiffuclipConfig, z_scale: Scale, latents: Float[Array, "L C"]
) -> Float[Array, "T D"]:
    """Scaled latents to scaled motion: quantised, with a straight-through gradient, and decoded (Sec. 4)."""
    quantised, _ = vqvae.quantise(params, config, scale.invert(z_scale, latents))
    return vqvae.decode(params, config, quantised)


def words_near(
    words: Sequence[Word], config: DiffuclipConfig, start: int, latents: int, reader: Reader | None = None
) -> Tokens:
    """The words of a window of latents, a second around it; `times` in s from the window's first latent."""
    hz = config.latents_hz
    near = tokens.between(words, start / hz - MARGIN_S, (start + latents) / hz + MARGIN_S)
    return tokens.tokenize(near, config.joint, reader or joint_embedding.reader(config.joint), start / hz)


def conditions(
    params: Params,
    config: DiffuclipConfig,
    rhythm: Float[Array, "A 2"],
    spoken: Tokens,
    style: Float[Array, " P"],
    prompted: Any,
) -> Conditions:
    """What the denoiser is told of a window: its audio (`ahead` latents longer), words with saliency, and prompt."""
    text = joint_embedding.encode_text(params["joint"], config, spoken)
    weights = joint_embedding.saliency(
        text.words, text.pooled, spoken.mask, config.joint.saliency, config.joint.sharpness
    )
    return Conditions(
        rhythm,
        text.words,
        weights,
        jnp.asarray(spoken.times) * config.latents_hz,
        jnp.asarray(spoken.mask),
        style,
        jnp.asarray(prompted),
    )
