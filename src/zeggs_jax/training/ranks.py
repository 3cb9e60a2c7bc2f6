"""How high the right one ranks among many: of a matrix of similarities, the place of each row's own column."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray


def ranks(similarity: Float[ndarray, "N N"]) -> Float[ndarray, " N"]:
    """Of each row the place of its own column (the diagonal) by falling similarity, from 1 on.

    Columns that are as similar as the own one count half: a matrix of equal numbers gives (N + 1) / 2, chance's mean.

    Raises:
        ValueError: numbers that are not finite.
    """
    similarity = np.asarray(similarity)
    if not np.isfinite(similarity).all():
        raise ValueError("some similarities are not finite; look for vectors of zeros or broken weights.")
    own = np.diagonal(similarity)[:, None]
    return 1.0 + (similarity > own).sum(1) + 0.5 * ((similarity == own).sum(1) - 1)


def recall(places: Float[ndarray, " N"], k: int) -> float:
    """R@k: the share of places among the first k."""
    return float((places <= k).mean())
