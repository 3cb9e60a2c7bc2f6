"""Two-bone analytic inverse kinematics for arms and legs: where elbow and knee go, and how the bones turn."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from zeggs_jax.geometry import quaternion

SOFT_ARM, SOFT_LEG = 3.0, 0.05  # cm


class Limb(NamedTuple):
    """World rotations of the two bones (wxyz) and the world position of the joint between them (cm)."""

    upper: Float[Array, "*b 4"]
    lower: Float[Array, "*b 4"]
    middle: Float[Array, "*b 3"]


def _across(v: Float[Array, "*b 3"], along: Float[Array, "*b 3"]) -> Float[Array, "*b 3"]:
    """Unit vector of the part of `v` orthogonal to the unit vector `along`."""
    return quaternion.normalize(v - jnp.sum(v * along, axis=-1, keepdims=True) * along, eps=1e-9)


def _columns(x: Float[Array, "*b 3"], y: Float[Array, "*b 3"], z: Float[Array, "*b 3"]) -> Float[Array, "*b 4"]:
    return quaternion.from_matrix(jnp.stack([x, y, z], axis=-1))


def _middle(
    start: Float[Array, "*b 3"],
    end: Float[Array, "*b 3"],
    pole: Float[Array, "*b 3"],
    lengths: tuple[float, float],
    soft: float,
) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 3"], Float[Array, "*b 3"]]:
    """(middle joint, reached end, unit direction in which the middle joint leaves the line between the two).

    Ends out of reach are approached, the last `soft` cm asymptotically, so that no limb snaps straight.
    """
    upper, lower = lengths
    reach = end - start
    wanted = jnp.sqrt(jnp.sum(reach * reach, axis=-1, keepdims=True))
    along = reach / wanted
    longest = 0.998 * (jnp.asarray(upper) + lower) - 0.3 * soft
    over = jnp.maximum(wanted - (longest - soft), 0.0)
    distance = jnp.where(over > 0, longest - soft * jnp.exp(-over / soft), wanted)
    distance = jnp.maximum(distance, 1.1 * jnp.abs(jnp.asarray(upper) - lower) + 6.0)
    bent = _across(pole, along)
    cosine = (jnp.square(upper) + distance**2 - jnp.square(lower)) / (2.0 * jnp.asarray(upper) * distance)
    sine = jnp.sqrt(jnp.maximum(1.0 - cosine**2, 0.0))
    return start + upper * (cosine * along + sine * bent), start + distance * along, bent


def arm(
    start: Float[Array, "*b 3"],
    end: Float[Array, "*b 3"],
    pole: Float[Array, "*b 3"],
    lengths: tuple[float, float],
    side: Float[Array, "*#b 1"],
) -> Limb:
    """An arm from the shoulder `start` to the wrist `end` (world, cm), its elbow on the side of `pole`.

    Bones rest along +X (side = 1, left) or -X (side = -1, right) and the elbow bends about Y.
    """
    elbow, wrist, bent = _middle(start, end, pole, lengths, SOFT_ARM)
    x_upper = side * quaternion.normalize(elbow - start, eps=1e-9)
    x_lower = side * quaternion.normalize(wrist - elbow, eps=1e-9)
    hinge = jnp.cross(_across(-bent, x_upper), x_upper)
    upper = _columns(x_upper, hinge, jnp.cross(x_upper, hinge))
    return Limb(upper, _columns(x_lower, hinge, jnp.cross(x_lower, hinge)), elbow)


def leg(
    start: Float[Array, "*b 3"],
    end: Float[Array, "*b 3"],
    pole: Float[Array, "*b 3"],
    lengths: tuple[float, float],
) -> Limb:
    """A leg from the hip `start` to the ankle `end` (world, cm), knee towards `pole`; bones rest along -Y."""
    knee, ankle, bent = _middle(start, end, pole, lengths, SOFT_LEG)
    y_upper = quaternion.normalize(start - knee, eps=1e-9)
    y_lower = quaternion.normalize(knee - ankle, eps=1e-9)
    hinge = jnp.cross(y_upper, _across(bent, y_upper))
    upper = _columns(hinge, y_upper, jnp.cross(hinge, y_upper))
    return Limb(upper, _columns(hinge, y_lower, jnp.cross(hinge, y_lower)), knee)
