"""Where the styles of a library lie: how far out another one is, and which are nearest to it."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from .principal import check_points

SHRINKAGE = 0.1  # share of the isotropic part: directions without spread count, but not without end


class Cloud(NamedTuple):
    """N embeddings as a Gaussian, and how far from its mean the farthest of them lies."""

    mean: Float[Array, " Z"]
    whitening: Float[Array, "Z Z"]  # inverse Cholesky factor of the covariance: whitened points have unit spread
    radius: Float[Array, ""]  # largest whitened distance of the N


def cloud(points: Float[ArrayLike, "N Z"], shrinkage: float | int = SHRINKAGE) -> Cloud:
    """The cloud of a library's embeddings (`library.points`), for `outlying`.

    The covariance is (1 - shrinkage) S + shrinkage tr(S) / Z I (Ledoit & Wolf 2004, at a fixed share), so that it is
    regular for any number of points.

    Raises:
        ValueError: fewer than 3 points, or all in one place.
    """
    points = jnp.asarray(points)
    check_points(points, "spread")
    return _fit(points, shrinkage)


@jax.jit
def _fit(points: Float[Array, "N Z"], shrinkage: ArrayLike) -> Cloud:
    mean, size = points.mean(0), points.shape[1]
    apart = points - mean[None]
    covariance = apart.T @ apart / (len(points) - 1)
    shrunk = (1.0 - shrinkage) * covariance + shrinkage * jnp.trace(covariance) / size * jnp.eye(size)
    whitening = jnp.linalg.inv(jnp.linalg.cholesky(shrunk))
    return Cloud(mean, whitening, jnp.linalg.norm(apart @ whitening.T, axis=1).max())


@jax.jit
def outlying(cloud: Cloud, z: Float[ArrayLike, " Z"]) -> Float[Array, ""]:
    """Mahalanobis distance from the cloud's mean, in units of its farthest point: 0 the mean, up to 1 inside."""
    return jnp.linalg.norm(cloud.whitening @ (jnp.asarray(z) - cloud.mean)) / cloud.radius


@partial(jax.jit, static_argnames="count")
def nearest(
    points: Float[ArrayLike, "N Z"], z: Float[ArrayLike, " Z"], count: int
) -> tuple[Int[Array, " k"], Float[Array, " k"]]:
    """Indices and Euclidean distances of the min(count, N) points nearest to `z`, nearest first."""
    apart = jnp.asarray(points) - jnp.asarray(z)[None]
    distances = jnp.linalg.norm(apart, axis=1)
    near, indices = jax.lax.top_k(-distances, min(count, len(distances)))
    return indices, -near
