"""The style space's algebra (ZeroEGGS Sec. 5.2): mix, exaggerate, transfer, walk, vary and lay out embeddings.

An embedding is one point z[Z] of the style space; a sequence has one for every frame, [T, Z]. Each function is pure
and takes single embeddings: `jax.vmap` it over many. Where a library's points lie, and along which directions they
spread, is the matter of `principal.py` and `cloud.py`, whose names this file hands on.
"""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .cloud import Cloud, cloud, nearest, outlying
from .principal import Principal, check_points, coordinates, lacking, move, principal, restore
from .style_encoder import StyleDistribution, sample_style

__all__ = [
    "Cloud",
    "Principal",
    "arc",
    "blend",
    "boundaries",
    "check_points",
    "check_shares",
    "cloud",
    "coordinates",
    "hold",
    "intensify",
    "lacking",
    "line",
    "move",
    "nearest",
    "outlying",
    "principal",
    "prior",
    "restore",
    "stitch",
    "transfer",
    "vary",
]

OPPOSITE = 0.02  # 1 + cos of an angle: below it (from 168.5 degrees on) an arc passes into the line


def blend(embeddings: Float[ArrayLike, "K Z"], weights: Float[ArrayLike, " K"] | Sequence[float]) -> Float[Array, " Z"]:
    """The weighted sum of K embeddings (Sec. 5.2.1). Weights outside [0, 1] extrapolate."""
    return jnp.asarray(weights) @ jnp.asarray(embeddings)


def intensify(style: Float[ArrayLike, " Z"], centre: Float[ArrayLike, " Z"], amount: ArrayLike) -> Float[Array, " Z"]:
    """centre + amount (style - centre): 0 is the centre, 1 the style to the bit, more exaggerates it."""
    style = jnp.asarray(style)
    return style + (jnp.asarray(amount) - 1.0) * (style - jnp.asarray(centre))


def transfer(
    style: Float[ArrayLike, " Z"], to: Float[ArrayLike, " Z"], away: Float[ArrayLike, " Z"]
) -> Float[Array, " Z"]:
    """style + (to - away): what tells `to` from `away`, given to another style."""
    return jnp.asarray(style) + (jnp.asarray(to) - jnp.asarray(away))


@partial(jax.jit, static_argnames="steps")
def line(a: Float[ArrayLike, " Z"], b: Float[ArrayLike, " Z"], steps: int) -> Float[Array, "N Z"]:
    """`steps` embeddings evenly along the straight way, from `a` to `b` to the bit (Fig. 7); ValueError below 2."""
    weights = _weights(steps)
    return jax.vmap(lambda w: (1.0 - w) * jnp.asarray(a) + w * jnp.asarray(b))(weights)


@partial(jax.jit, static_argnames="steps")
def arc(
    a: Float[ArrayLike, " Z"], b: Float[ArrayLike, " Z"], steps: int, centre: Float[ArrayLike, " Z"]
) -> Float[Array, "N Z"]:
    """`steps` embeddings from `a` to `b` about `centre`, by equal angles; ValueError below 2 steps.

    Two points at one distance from the centre keep it all the way, where the line would come nearer to it (White,
    "Sampling Generative Networks", 2016). As the angle goes to 0 the arc becomes the line; opposite points span no
    plane, so that near 180 degrees it passes over into the line.
    """
    centre = jnp.asarray(centre)
    u, v = jnp.asarray(a) - centre, jnp.asarray(b) - centre
    lengths = jnp.linalg.norm(u) * jnp.linalg.norm(v)
    cosine = jnp.where(lengths > 0.0, jnp.clip(u @ v / jnp.where(lengths > 0.0, lengths, 1.0), -1.0, 1.0), 1.0)
    curved = jnp.clip((1.0 + cosine) / OPPOSITE, 0.0, 1.0)  # 1: the arc, 0: the line
    turns = jnp.arccos(jnp.maximum(cosine, OPPOSITE / 2 - 1.0)) / jnp.pi

    def share(w: Array) -> Array:  # sin(w angle) / sin(angle), which is w for the angle 0
        return curved * w * jnp.sinc(w * turns) / jnp.sinc(turns) + (1.0 - curved) * w

    return jax.vmap(lambda w: centre + share(1.0 - w) * u + share(w) * v)(_weights(steps))


@partial(jax.jit, static_argnames="count")
def vary(key: Array, distribution: StyleDistribution, count: int, temperature: ArrayLike = 1.0) -> Float[Array, "N Z"]:
    """`count` samples of one style (Sec. 3.3); temperature 0 gives its mean every time, more spreads them wider."""
    return jax.vmap(lambda k: sample_style(k, distribution, temperature))(jax.random.split(key, count))


@partial(jax.jit, static_argnames=("size", "count"))
def prior(key: Array, size: int, count: int, temperature: ArrayLike = 1.0) -> Float[Array, "N Z"]:
    """`count` styles of nobody: draws from N(0, temperature^2), towards which the divergence pulls (Eq. 2)."""
    return jnp.asarray(temperature) * jax.random.normal(key, (count, size))


def hold(embedding: Float[ArrayLike, " Z"], frames: int) -> Float[Array, "T Z"]:
    """One embedding for every frame."""
    return jnp.tile(jnp.asarray(embedding)[None], (frames, 1))


def boundaries(shares: Sequence[float], frames: int) -> list[int]:
    """Where each style ends, in frames: truncated running sums, the last one at `frames` (as released)."""
    ends, end = [], 0
    for share in shares:
        end = int(end + share * frames)
        ends.append(end)
    ends[-1] = frames
    return ends


def stitch(embeddings: Float[ArrayLike, "K Z"], shares: Sequence[float], frames: int) -> Float[Array, "T Z"]:
    """K embeddings one after the other, each for its share of the frames, switched hard (as released)."""
    spans = np.diff([0, *boundaries(shares, frames)])
    return jnp.repeat(jnp.asarray(embeddings), jnp.asarray(spans), axis=0, total_repeat_length=frames)


def check_shares(shares: Sequence[float], styles: int, what: str) -> tuple[float, ...]:
    """The shares as floats: one per style, finite, summing to 1 (to 1e-3).

    Raises:
        ValueError: their number or their sum does not fit; `what` names them in the sentence.
    """
    values = tuple(float(share) for share in shares)
    if len(values) != styles:
        raise ValueError(f"got {len(values)} {what} for {styles} styles; give one for each style.")
    if not all(np.isfinite(values)) or abs(sum(values) - 1.0) > 1e-3:
        raise ValueError(f"the {what} {values} sum to {sum(values):g}; give numbers that sum to 1.")
    return values


def _weights(steps: int) -> Float[Array, " N"]:
    if steps < 2:
        raise ValueError(f"a way of {steps} steps has no two ends; ask for at least 2.")
    return jnp.linspace(0.0, 1.0, steps)
