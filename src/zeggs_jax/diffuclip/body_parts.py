"""Sec. 6.3: parts of the body with latents of their own, and a prompt for each (Eq. 19)."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..motion.skeleton import Skeleton
from .config import DiffuclipConfig, Parts

WHOLE = "whole"  # the name of the one part where the body is not divided
SMOOTH = 1e-4  # of the root in Eq. 19's norm: its gradient is finite where two predictions are equal


def names(config: DiffuclipConfig) -> Parts:
    """The parts in the order of their latents: `config.parts`, or the whole body."""
    return config.parts or (WHOLE,)


def joints(skeleton: Skeleton, part: str) -> np.ndarray:
    """Numbers of the joints of a part.

    "upper" is what hangs on the hips and carries the spine, the head or a hand; "lower" is all else: the hips, the
    legs, joints above the hips. ValueError for another part, or a body whose hips or spine are not known.
    """
    if part == WHOLE:
        return np.arange(len(skeleton))
    if part not in ("upper", "lower"):
        raise ValueError(f"'{part}' is no part of the body; parts are upper and lower.")
    hips = skeleton.role("hips")
    known = [role for role in ("head", "left_hand", "right_hand") if getattr(skeleton.roles, role) is not None]
    paths = [skeleton.path(skeleton.role(role)) for role in ("spine", *known)]
    carriers = {path[path.index(hips) + 1] for path in paths if hips in path[:-1]}
    upper = [bool(carriers & set(skeleton.path(joint))) for joint in range(len(skeleton))]
    return np.flatnonzero(np.array(upper) == (part == "upper"))


def columns(skeleton: Skeleton, parts: Parts) -> tuple[np.ndarray, ...]:
    """For each part the columns of a motion frame that are its own; the root's first three are the lower body's."""
    rows = np.arange(6 * len(skeleton)).reshape(len(skeleton), 6) + 3
    root = np.arange(3)
    return tuple(
        np.concatenate([root if part != "upper" else root[:0], rows[joints(skeleton, part)].ravel()])
        for part in parts or (WHOLE,)
    )


def masks(config: DiffuclipConfig) -> Bool[np.ndarray, "O C"]:
    """M_o: which channels of Z belong to each part; every channel belongs to one."""
    parts = len(names(config))
    return np.repeat(np.eye(parts, dtype=bool), config.codes.latent, axis=1)


def combine(
    noises: Float[Array, "O L C"],
    masks: Bool[Array, "O C"] | Bool[np.ndarray, "O C"],
    gradient: Float[Array, "L C"] | None = None,
    seam: float = 0.0,
) -> Float[Array, "L C"]:
    """Eq. 19: of each part the noise predicted under its own prompt, plus `seam` times `smoothness`' gradient."""
    chosen = jnp.where(jnp.asarray(masks)[:, None, :], noises, 0.0).sum(axis=0)
    return chosen if gradient is None else chosen + seam * gradient


def smoothness(noises: Float[Array, "O L C"]) -> Float[Array, ""]:
    """Eq. 19's second term before its gradient: the distances of all ordered pairs of predictions, i != j.

    Of each distance sqrt(d^2 + eps^2) - eps is taken: 0, with gradient 0, where two parts predict the same.
    """
    first, second = np.nonzero(~np.eye(len(noises), dtype=bool))
    square = jnp.square(noises[first] - noises[second]).sum(axis=(1, 2))
    return (jnp.sqrt(square + SMOOTH**2) - SMOOTH).sum()


def predict(
    predict_each: Callable[[Float[Array, "L C"]], Float[Array, "O L C"]],
    z: Float[Array, "L C"],
    masks: Bool[Array, "O C"] | Bool[np.ndarray, "O C"],
    seam: float,
) -> Float[Array, "L C"]:
    """Eq. 19 whole, from the noise predictions of all prompts as a function of Z_n.

    With `seam` 0 (the fast form) Z_n's gradient through the network is not taken.
    """
    if seam == 0.0 or len(masks) == 1:
        return combine(predict_each(z), masks)

    def distance(z: Array) -> tuple[Array, Array]:
        noises = predict_each(z)
        return smoothness(noises), noises

    gradient, noises = jax.grad(distance, has_aux=True)(z)
    return combine(noises, masks, gradient, seam)
