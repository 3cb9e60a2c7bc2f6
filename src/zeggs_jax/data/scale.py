"""Mean and standard deviation as a pytree: what the networks see and give is scaled, everything else is in cm, s, rad."""

from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float


class Scale(NamedTuple):
    """Statistics of one kind of vector; `std` may be one number for all columns."""

    mean: Float[ArrayLike, " n"]
    std: Float[ArrayLike, " n"] | Float[ArrayLike, ""]


class Scales(NamedTuple):
    """All statistics that a model carries, by the release's conventions (prepare.py computes them).

    speech:   one std for all 81 columns, so that the mels stay tiny (ZeroEGGS release, not the paper)
    pose_in:  6 + 15J + 3 columns (pose vector, gaze); one std per group of columns
    pose_out: 6 + 15J columns; one std per column, 0 where a column is constant
    """

    speech: Scale
    pose_in: Scale
    pose_out: Scale


def apply(scale: Scale, x: Float[ArrayLike, "*b n"]) -> Float[Array, "*b n"]:
    """Physical values -> scaled values. A column of std 0 gives infinities: `pose_out` is only ever inverted."""
    x = jnp.asarray(x)
    return (x - jnp.broadcast_to(scale.mean, x.shape)) / jnp.broadcast_to(scale.std, x.shape)


def invert(scale: Scale, x: Float[ArrayLike, "*b n"]) -> Float[Array, "*b n"]:
    """Scaled values -> physical values."""
    x = jnp.asarray(x)
    return x * jnp.broadcast_to(scale.std, x.shape) + jnp.broadcast_to(scale.mean, x.shape)
