"""Stage 2, the gesture encoder (Sec. 5): stretches of latents are covered up, their codes are to be told (gap 5)."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Bool, Float, Int
from numpy import ndarray

from ...nn.layers import Dense
from ...training.step import TrainState, begin, make_step, trained
from .. import joint_embedding
from ..config import DiffuclipConfig
from .stage import Material, Params, Stage, optimiser, window

SPANS = (2, 4)  # latents covered up in one stretch, at least and at most


class Masked(NamedTuple):
    """A window of a take with some latents covered up."""

    quantised: Float[Array | ndarray, "L C"]
    mask: Bool[Array | ndarray, " L"]
    hidden: Bool[Array | ndarray, " L"]
    codes: Int[Array | ndarray, "L Q"]


class Head(nn.Module):
    """A vector of the joint space -> the logits of each quantiser's codes."""

    quantisers: int
    codes: int

    @nn.compact
    def __call__(self, x: Float[Array, "L D"]) -> Float[Array, "L Q K"]:
        logits = Dense(self.quantisers * self.codes, gain=1.0, zero_bias=True, name="logits")(x)
        return logits.reshape(len(x), self.quantisers, self.codes)


def stage(config: DiffuclipConfig, material: Material, params: dict[str, Params]) -> Stage:
    """The stage; `material` holds the encoded takes. It leaves the component's gesture encoder, pretrained."""
    settings, steps = config.learn_gestures, optimiser(config.learn_gestures)
    averaged = settings.ema is not None
    judge = jax.jit(partial(loss_fn, config))
    validating = any(take.split == "valid" for take in material.takes)
    held = batch(config, material, 0, "valid") if validating else None

    def validate(state: TrainState) -> dict[str, float]:
        keys = jax.random.split(jax.random.key(0), settings.batch)
        loss, terms = judge(trained(state), held, keys, None)
        return {"loss": float(loss), **{name: float(value) for name, value in terms.items()}}

    return Stage(
        begin=lambda key: begin(init(key, config), steps, averaged),
        step=make_step(partial(loss_fn, config), steps, config.seed, ema=settings.ema),
        batch=lambda k: batch(config, material, k, "train"),
        finish=lambda state: {**params.get("joint", {}), "gesture": trained(state)["gesture"]},
        validate=validate if validating else None,
    )


def init(key: Array, config: DiffuclipConfig) -> Params:
    """The gesture encoder and the head that tells codes."""
    keys = jax.random.split(key)
    width = jnp.zeros((1, config.joint.width))
    gesture = joint_embedding.init_gesture(keys[0], config)
    return {"gesture": gesture, "head": _head(config).init(keys[1], width)["params"]}


def _head(config: DiffuclipConfig) -> Head:
    return Head(config.codes.quantisers * max(len(config.parts), 1), config.codes.codes)


def loss_fn(
    config: DiffuclipConfig, params: Params, clips: Masked, keys: Array, step: Any
) -> tuple[Array, dict[str, Array]]:
    """Cross-entropy of the codes of the covered latents, and how often the right one is the first guess.

    With `step` None nothing is dropped.
    """

    def each(clip: Masked, key: Array) -> tuple[Array, Array]:
        drop = None if step is None else key
        vectors = joint_embedding.encode_gesture(params, config, clip.quantised, clip.mask, clip.hidden, drop).latents
        logits = jnp.asarray(_head(config).apply({"params": params["head"]}, vectors))
        told = jax.nn.log_softmax(logits)
        right = jnp.take_along_axis(told, clip.codes[..., None], axis=-1)[..., 0]
        first = told.argmax(-1) == clip.codes
        return -right.mean(-1), first.mean(-1)

    apart, first = jax.vmap(each)(clips, keys)
    counted = clips.hidden & clips.mask
    total = jnp.maximum(counted.sum(), 1)
    loss, accuracy = (jnp.where(counted, x, 0.0).sum() / total for x in (apart, first))
    return loss, {"accuracy": accuracy}


def batch(config: DiffuclipConfig, material: Material, k: int, split: str) -> Masked:
    """Batch k: random windows of takes, drawn by their length, a share `masked` of each covered up in stretches."""
    settings, draw = config.learn_gestures, np.random.default_rng([config.seed, 2, k])
    chosen = [one for one, take in zip(material.encoded, material.takes, strict=True) if take.split == split]
    length = min(round(settings.seconds * config.latents_hz), config.joint.latents)
    long = np.array([len(one.latents) for one in chosen], float)
    rows = []
    for i in draw.choice(len(chosen), settings.batch, p=long / long.sum()):
        start = int(draw.integers(0, max(len(chosen[i].latents) - length, 0) + 1))
        quantised, mask = window(chosen[i].quantised, start, length)
        codes, _ = window(chosen[i].codes, start, length)
        rows.append(Masked(quantised, mask, covered(draw, length, config.joint.masked), codes))
    return jax.tree.map(lambda *leaves: np.stack(leaves), *rows)


def covered(draw: np.random.Generator, length: int, share: float) -> Bool[np.ndarray, " L"]:
    """Which latents are covered up: stretches of 2 to 4 until the share is reached, at least one."""
    hidden = np.zeros(length, bool)
    while hidden.sum() < max(share * length, 1):
        start = int(draw.integers(0, length))
        hidden[start : start + int(draw.integers(SPANS[0], SPANS[1] + 1))] = True
    return hidden
