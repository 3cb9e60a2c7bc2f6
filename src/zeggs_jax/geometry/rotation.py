"""Rotations as two axes, the networks' form: the turned x and y axis, to and from matrices and quaternions.

Axes are stored as rows, `[..., 0, :]` the turned x axis and `[..., 1, :]` the turned y axis (ZeroEGGS Sec.
3.1); they are the first two columns of the rotation matrix. Predicted axes need not be orthogonal.
"""

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from zeggs_jax.geometry import quaternion

_EPS = 1e-10


def axes_to_matrix(xy: Float[ArrayLike, "*b 2 3"]) -> Float[Array, "*b 3 3"]:
    """Rotation matrix whose first column has the direction of the x axis; y is made orthogonal to it.

    Always the last axis is crossed; the release crosses the first axis of length 3, wrong for a batch of 3.
    """
    xy = jnp.asarray(xy)
    x, toward_y = xy[..., 0, :], xy[..., 1, :]
    z = jnp.cross(x, toward_y)
    y = jnp.cross(z, x)
    return jnp.stack([quaternion.normalize(axis, _EPS) for axis in (x, y, z)], axis=-1)


def matrix_to_axes(m: Float[ArrayLike, "*b 3 3"]) -> Float[Array, "*b 2 3"]:
    """The first two columns of a rotation matrix, as rows."""
    return jnp.swapaxes(jnp.asarray(m)[..., :2], -1, -2)


def quaternion_to_axes(q: Float[ArrayLike, "*b 4"]) -> Float[Array, "*b 2 3"]:
    """The x and y axis turned by `q`."""
    return matrix_to_axes(quaternion.to_matrix(q))


def axes_to_quaternion(xy: Float[ArrayLike, "*b 2 3"]) -> Float[Array, "*b 4"]:
    """Unit quaternion of two axes, made orthogonal first."""
    return quaternion.from_matrix(axes_to_matrix(xy))
