"""Walks through the style space: the motion at every step, what it shows, and how steadily that follows the walk."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy import stats

import posture
import truth
from zeggs_jax.metrics.factors import Ruler
from zeggs_jax.motion import features
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.features import Motion
from zeggs_jax.zeroeggs.model import Model, decode, encode_speech

STEADY = 0.95  # rank correlation from which a walk counts as monotone
DIFFER = 0.05  # share of a factor's span: two styles closer than this are taken for equal in it

Values = Mapping[str, Sequence[float]]  # one for every step, by the name of what is measured


class Stage(NamedTuple):
    """What walks are performed by, and to which speeches."""

    model: Model
    spectra: dict[str, Float[Array, "T F"]]
    ruler: Ruler | None  # None: the styles' factors are not known


def perform(stage: Stage, speech: str, styles: Float[Array, "N ..."], starts: Sequence[Motion | None]) -> list[Clip]:
    """One speech in N styles [N, Z], or in N with one for every frame [N, T, Z], each from its own first pose.

    All at once: that is several times cheaper than one after the other. ValueError where a first pose is missing.
    """
    if any(start is None for start in starts):
        raise ValueError("the library has no first pose to start from; embed its clips with 'zeggs embed'.")
    model, spectrum = stage.model, stage.spectra[speech]
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


def walk(stage: Stage, points: Float[Array, "N Z"], start: Motion | None) -> dict[str, Values]:
    """What every step shows, means over the speeches: `measures`, and `factors` where they are known."""
    performed = [perform(stage, speech, points, [start] * len(points)) for speech in stage.spectra]
    found: dict[str, Values] = {"measures": {}, "factors": {}}
    for clips in zip(*performed, strict=True):
        add(found["measures"], [posture.measured(clip) for clip in clips])
        if stage.ruler is not None:
            add(found["factors"], [truth.recovered(stage.ruler, clip)._asdict() for clip in clips])
    return found


def add(found: Values, rows: Sequence[Mapping[str, float]]) -> None:
    """Appends the mean of the rows, by name."""
    for name in rows[0]:
        found.setdefault(name, []).append(float(np.mean([row[name] for row in rows])))  # pyright: ignore


def rank(values: Sequence[float]) -> float:
    """Spearman's rank correlation with the steps; 0 where nothing moves."""
    if np.ptp(values) == 0.0:
        return 0.0
    ordered = stats.rankdata(values)
    return float(np.corrcoef(np.arange(len(ordered)), ordered)[0, 1])


def ranks(values: Values) -> dict[str, float]:
    """The same of every measure."""
    return {name: rank(row) for name, row in values.items()}


def towards(start: Sequence[float], end: Sequence[float]) -> dict[str, float]:
    """By factor, +1 or -1: the way from one style's factors to another's; those in which they agree are left out."""
    change = (np.asarray(end) - np.asarray(start)) / truth.SPAN
    return {name: float(np.sign(c)) for name, c in zip(truth.NAMES, change, strict=True) if abs(c) >= DIFFER}


def steady(found: Mapping[str, float], way: Mapping[str, float]) -> list[str]:
    """What moves monotonically, and the right way."""
    return [name for name, sign in way.items() if found[name] * sign >= STEADY]
