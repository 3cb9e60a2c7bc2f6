"""Many speeches under prompts of their own, performed side by side: what they are one by one, several times faster."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from zeggs_jax.diffuclip import guidance, model, sampling, tokens
from zeggs_jax.diffuclip.config import DiffuclipConfig
from zeggs_jax.diffuclip.generate import Wishes
from zeggs_jax.diffuclip.guidance import Wish
from zeggs_jax.diffuclip.model import Model
from zeggs_jax.diffuclip.sampling import Settings
from zeggs_jax.diffuclip.takes import heard
from zeggs_jax.diffuclip.tokens import Tokens
from zeggs_jax.speech import wav
from zeggs_jax.speech.transcript import Word


class Voice(NamedTuple):
    """What one body is asked to perform."""

    wave: Float[np.ndarray, " n"]  # 16 kHz
    words: Sequence[Word]
    wishes: Wishes
    seed: int


def synthesize(
    at: Model, voices: Sequence[Voice], steps: int, seam: float | None = None
) -> list[Float[np.ndarray, "L C"]]:
    """Scaled latents of each voice, as `generate.synthesize` makes them; all go on until the longest has ended."""
    config, hz = at.config, at.config.latents_hz
    counts = [max(1, int(np.ceil(len(voice.wave) / wav.RATE_HZ * hz))) for voice in voices]
    chunk, size = config.diffusion.chunk, config.diffusion.context
    settings = Settings("dpm", steps, chunk=chunk, context=size)
    window = size + chunk + config.denoiser.ahead
    rhythm = [_rhythm(voice.wave, count, max(counts) + window, hz) for voice, count in zip(voices, counts, strict=True)]
    several = len(voices[0].wishes.each[0].styles) > 1
    seam = float(config.diffusion.seam if seam is None else seam) if several else 0.0
    keys = [jax.random.split(jax.random.key(voice.seed)) for voice in voices]
    context, made = np.zeros((len(voices), size, config.latent_size), np.float32), []
    for done in range(0, max(counts), chunk):
        count = min(done, size)
        told = [_told(voice, config, done - count, size + chunk, done / hz) for voice in voices]
        spoken = tokens.stack([one for one, _ in told])
        wishes = jax.tree.map(lambda *leaves: np.stack(list(map(np.asarray, leaves))), *(wish for _, wish in told))
        audio = np.stack([own[done - count : done - count + window] for own in rhythm])
        conditions = _conditions(at.params, config, audio, spoken, wishes.styles[:, 0])
        noise = np.stack([sampling.noise_of(key[0], done, chunk, config.latent_size) for key in keys])
        draws = jax.numpy.stack([jax.random.fold_in(key[1], done) for key in keys])
        piece = _extend(
            at.params["denoiser"], config, settings, seam, context, count, noise,
            (conditions, wishes), draws,
        )  # fmt: skip
        made.append(np.asarray(piece))
        kept = np.concatenate([context[:, :count], made[-1]], axis=1)[:, -size:]
        context = np.pad(kept, ((0, 0), (0, size - kept.shape[1]), (0, 0)))
    whole = np.concatenate(made, axis=1)
    return [latents[:count] for latents, count in zip(whole, counts, strict=True)]


def _rhythm(wave: np.ndarray, latents: int, length: int, hz: float) -> Float[np.ndarray, "A 2"]:
    own = heard(np.asarray(wave, np.float32), latents, hz)
    return np.pad(own, ((0, length - len(own)), (0, 0)))


def _told(voice: Voice, config: DiffuclipConfig, first: int, length: int, now: float) -> tuple[Tokens, Wish]:
    """The words of a window, and what is wished for now."""
    holds = int(np.searchsorted(voice.wishes.times, now + 1e-6, side="right")) - 1
    return model.words_near(voice.words, config, first, length), voice.wishes.each[max(holds, 0)]


@partial(jax.jit, static_argnames="config")
def _conditions(params: Any, config: DiffuclipConfig, rhythm: Any, spoken: Any, styles: Any) -> Any:
    return jax.vmap(lambda heard, said, style: model.conditions(params, config, heard, said, style, True))(
        rhythm, spoken, styles
    )


@partial(jax.jit, static_argnames=("config", "settings", "seam"))
def _extend(
    params: Any, config: DiffuclipConfig, settings: Settings, seam: float, context: Any, count: Any, noise: Any,
    told: Any, keys: Any,
) -> Any:  # fmt: skip
    one = partial(guidance.extend, params, config, settings, seam)
    return jax.vmap(one, in_axes=(0, None, 0, 0, 0))(context, count, noise, told, keys)
