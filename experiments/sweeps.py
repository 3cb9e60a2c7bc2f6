"""Walks through the style space: many styles performed at once, what they show, how steadily it follows the walk."""

from collections.abc import Mapping, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

import instrument
import truth
from instrument import Instrument
from zeggs_jax.motion import features
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.features import Motion
from zeggs_jax.zeroeggs.model import Model, decode, encode_speech

STEADY = 0.95  # rank correlation from which a walk counts as monotone
DIFFER = 0.05  # share of a factor's span: two styles closer than this are taken for equal in it
FACTOR = "factor: "  # how measures that are factors begin

Row = Mapping[str, float]  # what one step shows, by the name of the measure


def perform(
    model: Model, spectrum: ArrayLike, styles: Float[Array, "N ..."], starts: Sequence[Motion | None]
) -> list[Clip]:
    """One speech in N styles [N, Z], or in N with one for every frame [N, T, Z], each from its own first pose.

    All at once: that is several times cheaper than one after the other. ValueError where a first pose is missing.
    """
    if any(start is None for start in starts):
        raise ValueError("the library has no first pose to start from; embed its clips with 'zeggs embed'.")
    spectrum = jnp.asarray(spectrum)
    first = jax.tree.map(lambda *x: jnp.stack([one[0] for one in x]), *(start.pose for start in starts if start))
    gaze = jnp.stack([jnp.asarray(start.gaze) for start in starts if start])
    held = jnp.repeat(styles[:, None], len(spectrum), axis=1) if styles.ndim == 2 else styles
    made = _perform(model.params, model.config, model.scales, first, spectrum, held, gaze)
    poses = [jax.tree.map(lambda x, k=k: x[k], made) for k in range(len(held))]
    return [features.decode(one, model.skeleton, model.config.frame_time) for one in poses]


@partial(jax.jit, static_argnames="config")
def _perform(params, config, scales, first, spectrum, styles, gaze):
    speech = encode_speech(params, config, scales, spectrum)

    def one(pose, style, look):
        return decode(params, config, scales, pose, speech, style, jnp.broadcast_to(look, (len(style), 3)))

    return jax.vmap(one)(first, styles, gaze)


def walk(at: Instrument, points: Float[Array, "N Z"], start: Motion | None) -> list[dict[str, float]]:
    """What every step shows, means over the speeches."""
    performed = [perform(at.model, heard, points, [start] * len(points)) for heard in at.speeches.values()]
    return [instrument.measure(at, clips) for clips in zip(*performed, strict=True)]


def towards(start: Sequence[float], end: Sequence[float]) -> dict[str, float]:
    """By factor, +1 or -1: the way from one style's factors to another's; those in which they agree are left out."""
    change = (np.asarray(end) - np.asarray(start)) / truth.SPAN
    return {name: float(np.sign(c)) for name, c in zip(truth.NAMES, change, strict=True) if abs(c) >= DIFFER}


def steady(found: Row, way: Row) -> list[str]:
    """The factors that move monotonically, and the right way; `found` has the rank correlation of every measure."""
    return [name for name, sign in way.items() if found[FACTOR + name] * sign >= STEADY]


def moving(found: Row) -> list[str]:
    """The direct measures that move monotonically, either way."""
    return [name for name, rho in found.items() if not name.startswith(FACTOR) and abs(rho) >= STEADY]
