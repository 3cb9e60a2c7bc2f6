"""Rotations as quaternions (w, x, y, z): product, exponential, Euler angles, interpolation, sign.

Hamilton product, active rotations, radians. Every function takes any number of leading axes `*b`, keeps
the floating-point precision of its input, and has finite gradients everywhere, also at no rotation and at
half turns. Thresholds are those of the release's network side: integrated roots agree to rounding.
"""

import math

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

SMALL = 1e-5  # below this half angle (rad) exp and log are linear, as released
_LOCK = 0.9999  # |sin| of the middle Euler angle from which the half-angle form is used


def _norm(x: Float[Array, "*b n"]) -> Float[Array, "*b 1"]:
    """Euclidean norm whose gradient at zero is zero."""
    square = jnp.sum(x * x, axis=-1, keepdims=True)
    positive_square = square > 0
    return jnp.where(positive_square, jnp.sqrt(jnp.where(positive_square, square, 1.0)), 0.0)


def _split(q: Float[ArrayLike, "*b 4"]) -> tuple[Array, Array]:
    """Scalar part [*b, 1] and vector part [*b, 3]."""
    q = jnp.asarray(q)
    return q[..., :1], q[..., 1:]


def normalize(x: Float[ArrayLike, "*b n"], eps: ArrayLike = 0.0) -> Float[Array, "*b n"]:
    """`x / (|x| + eps)`; with `eps` 0 the zero vector stays zero (the release's quaternions: eps 1e-5)."""
    x = jnp.asarray(x)
    length = _norm(x) + jnp.asarray(eps, x.dtype)
    return x / jnp.where(length > 0, length, 1.0)


def multiply(q: Float[ArrayLike, "*#b 4"], p: Float[ArrayLike, "*#b 4"]) -> Float[Array, "*b 4"]:
    """Hamilton product `q p`: the rotation that turns by `p` first, then by `q`."""
    q, p = jnp.asarray(q), jnp.asarray(p)
    qw, qx, qy, qz = (q[..., i] for i in range(4))
    pw, px, py, pz = (p[..., i] for i in range(4))
    return jnp.stack(
        [
            qw * pw - qx * px - qy * py - qz * pz,
            qw * px + qx * pw + qy * pz - qz * py,
            qw * py - qx * pz + qy * pw + qz * px,
            qw * pz + qx * py - qy * px + qz * pw,
        ],
        axis=-1,
    )


def inverse(q: Float[ArrayLike, "*b 4"]) -> Float[Array, "*b 4"]:
    """Conjugate, which is the inverse of a unit quaternion."""
    w, v = _split(q)
    return jnp.concatenate([w, -v], axis=-1)


def rotate(q: Float[ArrayLike, "*#b 4"], v: Float[ArrayLike, "*#b 3"]) -> Float[Array, "*b 3"]:
    """`v` turned by the unit quaternion `q`."""
    w, axis = _split(q)
    v = jnp.asarray(v)
    twice = 2.0 * jnp.cross(axis, v)
    return v + w * twice + jnp.cross(axis, twice)


def positive(q: Float[ArrayLike, "*b 4"]) -> Float[Array, "*b 4"]:
    """The sign of `q` with w > 0, the shorter way round (w = 0 is negated, as released)."""
    q = jnp.asarray(q)
    return jnp.where(q[..., :1] > 0, q, -q)


def exp(v: Float[ArrayLike, "*b 3"]) -> Float[Array, "*b 4"]:
    """Quaternion of the half-angle vector `v`: turns about `v` by `2|v|`.

    Below `|v| = 1e-5` it is `(1, v)` divided by its norm plus 1e-5, as released: such a step shortens the
    quaternion that it multiplies by one part in 1e5.
    """
    v = jnp.asarray(v)
    half = _norm(v)
    small = half < SMALL
    safe = jnp.where(small, 1.0, half)
    full = jnp.concatenate([jnp.cos(safe), v * (jnp.sin(safe) / safe)], axis=-1)
    linear = normalize(jnp.concatenate([jnp.ones_like(half), v], axis=-1), SMALL)
    return jnp.where(small, linear, full)


def log(q: Float[ArrayLike, "*b 4"]) -> Float[Array, "*b 3"]:
    """Half-angle vector of the unit quaternion `q`, up to pi long; inverse of `exp`."""
    w, v = _split(q)
    length = _norm(v)
    small = length < SMALL
    safe = jnp.where(small, 1.0, length)
    return jnp.where(small, v, v * (jnp.arctan2(safe, w) / safe))


def from_scaled_axis(v: Float[ArrayLike, "*b 3"]) -> Float[Array, "*b 4"]:
    """Quaternion that turns about `v` by `|v|` radians (the release's `from_helical`)."""
    return exp(jnp.asarray(v) * 0.5)


def to_scaled_axis(q: Float[ArrayLike, "*b 4"]) -> Float[Array, "*b 3"]:
    """Rotation axis times angle in radians (the release's `to_helical`)."""
    return 2.0 * log(q)


def between(a: Float[ArrayLike, "*#b 3"], b: Float[ArrayLike, "*#b 3"]) -> Float[Array, "*b 4"]:
    """Quaternion, not normalised, of the shortest turn from `a` to `b`; zero where they are opposite."""
    a, b = jnp.asarray(a), jnp.asarray(b)
    dot = jnp.sum(a * b, axis=-1, keepdims=True)
    return jnp.concatenate([_norm(a) * _norm(b) + dot, jnp.cross(a, b)], axis=-1)


def unroll(q: Float[ArrayLike, "T *b 4"]) -> Float[Array, "T *b 4"]:
    """Signs chosen along the first axis so that none is opposite to the one before; the first one stays."""
    q = jnp.asarray(q)
    dot = jnp.sum(q[1:] * q[:-1], axis=-1, keepdims=True)
    step = jnp.concatenate([jnp.ones_like(q[:1, ..., :1]), jnp.where(dot < 0, -1.0, 1.0).astype(q.dtype)])
    return q * jnp.cumprod(step, axis=0)


def slerp(
    q: Float[ArrayLike, "*#b 4"], p: Float[ArrayLike, "*#b 4"], t: Float[ArrayLike, "*#b"]
) -> Float[Array, "*b 4"]:
    """Constant-speed turn from `q` (t = 0) to `p` (t = 1); no sign is chosen: see `unroll`."""
    q, p, t = jnp.asarray(q), jnp.asarray(p), jnp.asarray(t)[..., None]
    angle = 2.0 * jnp.arctan2(_norm(q - p), jnp.maximum(_norm(q + p), 1e-12))
    sine = jnp.sin(angle)
    small = sine < SMALL
    safe = jnp.where(small, 1.0, sine)
    from_q = jnp.where(small, 1.0 - t, jnp.sin((1.0 - t) * angle) / safe)
    from_p = jnp.where(small, t, jnp.sin(t * angle) / safe)
    return from_q * q + from_p * p


def from_euler(angles: Float[ArrayLike, "*b 3"], order: str) -> Float[Array, "*b 4"]:
    """Euler angles, one column per letter of `order`: "zyx" is `q_z q_y q_x`, the x turn applied first."""
    _axes(order)
    angles = jnp.asarray(angles)
    cosine, sine = jnp.cos(0.5 * angles), jnp.sin(0.5 * angles)
    zero = jnp.zeros_like(cosine[..., 0])
    turns = [
        jnp.stack([cosine[..., i]] + [sine[..., i] if letter == axis else zero for axis in "xyz"], axis=-1)
        for i, letter in enumerate(order)
    ]
    return multiply(turns[0], multiply(turns[1], turns[2]))


def to_euler(q: Float[ArrayLike, "*b 4"], order: str) -> Float[Array, "*b 3"]:
    """Euler angles of `q`, one column per letter of `order`: outer two in [-pi, pi], middle in [-pi/2, pi/2].

    Away from gimbal lock these are the release's formulas (also for quaternions that are not quite unit).
    Within 0.8 degrees of it half-angle sums and differences (Bernardes and Viollet 2022) stay accurate.
    """
    i, j, k, sign = _axes(order)
    q = jnp.asarray(q)
    w, a, b, c = q[..., 0], q[..., 1 + i], q[..., 1 + j], q[..., 1 + k]
    sine = 2.0 * (w * b + sign * a * c)
    locked = jnp.abs(sine) > _LOCK
    first = _atan2(2.0 * (w * a - sign * b * c), 1.0 - 2.0 * (a * a + b * b))
    middle = jnp.arcsin(jnp.where(locked, 0.0, sine))
    last = _atan2(2.0 * (w * c - sign * a * b), 1.0 - 2.0 * (b * b + c * c))
    half_sum, half_difference = _atan2(a + sign * c, w + b), _atan2(a - sign * c, w - b)
    above = _norm(jnp.stack([w + b, a + c * sign], axis=-1))[..., 0]
    below = _norm(jnp.stack([w - b, a - c * sign], axis=-1))[..., 0]
    near_lock = jnp.stack(
        [
            _wrap(half_sum + half_difference),
            2.0 * _atan2(above, below) - 0.5 * math.pi,
            _wrap(sign * (half_sum - half_difference)),
        ],
        axis=-1,
    )
    return jnp.where(locked[..., None], near_lock, jnp.stack([first, middle, last], axis=-1))


def _axes(order: str) -> tuple[int, int, int, float]:
    """Axis numbers of an order, and +1 where it is cyclic (xyz, yzx, zxy), -1 otherwise."""
    if sorted(order) != ["x", "y", "z"]:
        raise ValueError(f"Euler order {order!r} is not one of xyz, xzy, yxz, yzx, zxy, zyx.")
    i, j, k = ("xyz".index(letter) for letter in order)
    return i, j, k, 1.0 if (j - i) % 3 == 1 else -1.0


def _atan2(y: Array, x: Array) -> Array:
    """arctan2 with a finite (zero) gradient at the origin."""
    origin = (x == 0) & (y == 0)
    return jnp.where(origin, 0.0, jnp.arctan2(y, jnp.where(origin, 1.0, x)))


def _wrap(angle: Array) -> Array:
    """The same angle in [-pi, pi], for angles within a turn of it."""
    turns = jnp.where(angle > math.pi, 1.0, jnp.where(angle < -math.pi, -1.0, 0.0))
    return angle - 2.0 * math.pi * turns


def to_matrix(q: Float[ArrayLike, "*b 4"]) -> Float[Array, "*b 3 3"]:
    """Rotation matrix of a unit quaternion; its columns are the turned axes."""
    q = jnp.asarray(q)
    w, x, y, z = (q[..., i] for i in range(4))
    entries = [
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    ]  # fmt: skip
    return jnp.stack(entries, axis=-1).reshape(*q.shape[:-1], 3, 3)


def from_matrix(m: Float[ArrayLike, "*b 3 3"]) -> Float[Array, "*b 4"]:
    """Unit quaternion of a rotation matrix, by the largest of four forms (Shepperd 1978).

    With a positive trace w is positive, otherwise the component of the largest diagonal entry, as released.
    """
    m = jnp.asarray(m)
    xx, xy, xz, yx, yy, yz, zx, zy, zz = (m[..., i, j] for i in range(3) for j in range(3))
    by_w = jnp.stack([1.0 + xx + yy + zz, zy - yz, xz - zx, yx - xy], axis=-1)
    by_x = jnp.stack([zy - yz, 1.0 + xx - yy - zz, yx + xy, xz + zx], axis=-1)
    by_y = jnp.stack([xz - zx, yx + xy, 1.0 - xx + yy - zz, zy + yz], axis=-1)
    by_z = jnp.stack([yx - xy, xz + zx, zy + yz, 1.0 - xx - yy + zz], axis=-1)
    turning = jnp.where(((yy > xx) & (yy >= zz))[..., None], by_y, by_z)
    turning = jnp.where(((xx >= yy) & (xx >= zz))[..., None], by_x, turning)
    return normalize(jnp.where((xx + yy + zz > 0)[..., None], by_w, turning))
