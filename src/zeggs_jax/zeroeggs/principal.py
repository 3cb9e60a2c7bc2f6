"""Principal components of a library of styles, moved in units of their spread (ZeroEGGS Sec. 5.2.2, Fig. 8)."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float


class Principal(NamedTuple):
    """The K directions along which N embeddings spread, widest first; K is their rank, at most min(N - 1, Z)."""

    mean: Float[Array, " Z"]
    axes: Float[Array, "K Z"]  # orthonormal; the largest entry of each is positive
    std: Float[Array, " K"]  # of the embeddings along each axis (over N - 1), as lengths in the style space
    share: Float[Array, " K"]  # of their variance; sums to 1


def principal(points: Float[ArrayLike, "N Z"]) -> Principal:
    """The principal components of a library's embeddings (`library.points`).

    Raises:
        ValueError: fewer than 3 points, or all in one place: they have no directions.
    """
    points = jnp.asarray(points)
    check_points(points, "principal components")
    found = _fit(points)
    noise = found.std[0] * max(points.shape) * jnp.finfo(points.dtype).eps
    rank = int((found.std > noise).sum())
    return Principal(found.mean, found.axes[:rank], found.std[:rank], found.share[:rank])


@jax.jit
def _fit(points: Float[Array, "N Z"]) -> Principal:
    """All directions, those without spread among them."""
    mean = points.mean(0)
    _, singular, axes = jnp.linalg.svd(points - mean[None], full_matrices=False)
    largest = jnp.take_along_axis(axes, jnp.abs(axes).argmax(1, keepdims=True), axis=1)
    variance = singular**2
    return Principal(mean, axes * jnp.sign(largest), singular / (len(points) - 1) ** 0.5, variance / variance.sum())


@jax.jit
def coordinates(components: Principal, z: Float[ArrayLike, " Z"]) -> Float[Array, " K"]:
    """Where an embedding lies along each component, in standard deviations from the mean."""
    return components.axes @ (jnp.asarray(z) - components.mean) / components.std


@jax.jit
def restore(components: Principal, along: Float[ArrayLike, " K"]) -> Float[Array, " Z"]:
    """The embedding with these coordinates: projected back into the style space (Sec. 5.2.2)."""
    return components.mean + (jnp.asarray(along) * components.std) @ components.axes


def move(components: Principal, z: Float[ArrayLike, " Z"], amounts: Mapping[int, ArrayLike]) -> Float[Array, " Z"]:
    """An embedding moved along components, numbered from 1, by so many standard deviations each.

    What of it lies outside the components' span stays. ValueError: a component that is not there.
    """
    moved = jnp.asarray(z)
    for number, amount in amounts.items():
        check_component(number, len(components.std))
        moved = moved + jnp.asarray(amount) * components.std[number - 1] * components.axes[number - 1]
    return moved


def check_component(number: int, count: int) -> None:
    """ValueError where there is no component of this number, counted from 1."""
    if not 1 <= number <= count:
        raise ValueError(f"component {number} was asked for, but the library has components 1 to {count}.")


def check_points(points: Float[Array, "N Z"], what: str, least: int = 3) -> None:
    """ValueError for points that have no `what`: fewer than `least`, all in one place, or not finite."""
    reason = lacking(points, least)
    if reason:
        raise ValueError(f"a library of {reason} has no {what}; embed {least} or more clips that differ.")


def lacking(points: Float[Array, "N Z"], least: int = 3) -> str:
    """What these points are, where they are too few, all in one place or not finite; else ''."""
    count = len(points)
    if count < least:
        return "1 embedding" if count == 1 else f"{count} embeddings"
    if not np.isfinite(np.asarray(points)).all():
        return "embeddings that are not finite"
    return "" if np.ptp(np.asarray(points), axis=0).max() > 0.0 else f"{count} equal embeddings"
