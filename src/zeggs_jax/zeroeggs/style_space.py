"""Style space: blend embeddings and lay them out over time (ZeroEGGS Sec. 5.2)."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float


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


def blend(embeddings: Float[ArrayLike, "K Z"], weights: Float[ArrayLike, " K"]) -> Float[Array, " Z"]:
    """The weighted sum of K embeddings (Sec. 5.2.1). Weights outside [0, 1] extrapolate."""
    return jnp.asarray(weights) @ jnp.asarray(embeddings)


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
