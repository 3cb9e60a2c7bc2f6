"""What a stage of training is to the loop, and what it learns from: the takes of a corpus and their latents."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import optax
from jaxtyping import Array, Float32, Int32, Shaped
from numpy import ndarray

from ...data.scale import Scale
from ...motion.skeleton import Skeleton
from ...speech.transcript import Word
from ...training.step import Step, TrainState
from ..config import DiffuclipConfig, StageConfig

Params = Any


class Take(NamedTuple):
    """One clip of a corpus, its frames cut to a multiple of the codes' rate."""

    name: str
    style: str
    split: str  # train or valid
    motion: Float32[ndarray, "T D"]  # representation.encode, not scaled
    rhythm: Float32[ndarray, "L 2"]  # onset strength and amplitude at the latents' rate
    words: tuple[Word, ...]  # () without a transcript
    captions: tuple[str, ...]  # sentences that describe how the body moves; of the label where the corpus has none


class Encoded(NamedTuple):
    """A take in latents, as the frozen codes see it."""

    latents: Float32[ndarray, "L C"]  # Z, scaled to unit variance
    quantised: Float32[ndarray, "L C"]  # the quantised Z, on the same scale
    codes: Int32[ndarray, "L Q"]  # index of each quantiser of each part


class Material(NamedTuple):
    """All that a stage may read; `encoded` is empty before the codes are learnt."""

    takes: Sequence[Take]
    motion_scale: Scale  # mean and std of the columns of a motion frame
    skeleton: Skeleton
    encoded: Sequence[Encoded] = ()
    latent_scale: Scale | None = None


class Stage(NamedTuple):
    """One stage: how it begins, its update, its batches, and what of its state the model keeps."""

    begin: Callable[[Array], TrainState]  # from a random key
    step: Step
    batch: Callable[[int], Any]  # batch k, a function of (seed, k); numpy arrays, made in a thread
    finish: Callable[[TrainState], Params]  # the component's parameters, as the model holds them
    validate: Callable[[TrainState], dict[str, float]] | None = None  # "loss" and more, on the split valid


Make = Callable[[DiffuclipConfig, Material, dict[str, Params]], Stage]
"""(config, material, the components learnt so far) -> the stage; every file of this room has a `stage` of this kind."""


def optimiser(config: StageConfig) -> optax.GradientTransformation:
    """AdamW with a linear warm-up, then a cosine down to a tenth of the rate; gradients clipped by their length."""
    rate = optax.warmup_cosine_decay_schedule(
        0.0, config.learning_rate, config.warmup, max(config.steps, config.warmup + 1), 0.1 * config.learning_rate
    )
    steps = optax.adamw(rate, weight_decay=config.weight_decay)
    return steps if config.clip_norm is None else optax.chain(optax.clip_by_global_norm(config.clip_norm), steps)


def window(rows: Shaped[ndarray, "T n"], start: int, length: int) -> tuple[ndarray, ndarray]:
    """(rows [length, n] from `start` on, zeros beyond the end; mask [length])."""
    import numpy as np

    piece = rows[max(start, 0) : start + length]
    mask = np.zeros(length, bool)
    mask[: len(piece)] = True
    return np.pad(piece, ((0, length - len(piece)), (0, 0))), mask
