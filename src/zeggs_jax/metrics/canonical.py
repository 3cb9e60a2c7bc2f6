"""Canonical correlation: how well a line through one motion can follow a line through another (Hotelling 1936).

Fitted and scored on one clip it is near 1 for any two motions of many joints; the scripts of GENEA and others fit
anew for every file. Here it is fitted on some clips and scored on others (`held_out`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .rhythm import correlation

TOLERANCE = 1e-8  # of the largest singular value: directions below have no spread
FRAMES_PER_COLUMN = 3  # fewer do not say what goes with what

Columns = Float[np.ndarray, "_ _"]  # [frames, columns]


class Canonical(NamedTuple):
    """The two directions whose projections correlate most."""

    first: Float[np.ndarray, " P"]
    second: Float[np.ndarray, " Q"]
    first_mean: Float[np.ndarray, " P"]
    second_mean: Float[np.ndarray, " Q"]
    correlation: float  # of the frames that it was fitted on


def fit(first: Columns, second: Columns) -> Canonical:
    """The first pair of canonical directions, by QR-like bases and their singular values (Bjorck and Golub 1973).

    Neither units nor any invertible mixing of the columns changes the correlation.

    Raises:
        ValueError: other numbers of frames, too few for the columns, NaN, or columns that are all constant.
    """
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    frames, columns = len(first), first.shape[1] + second.shape[1]
    if len(second) != frames:
        raise ValueError(f"got {frames} and {len(second)} frames to correlate; cut them to one length.")
    if frames < FRAMES_PER_COLUMN * columns:
        raise ValueError(
            f"{frames} frames are too few to correlate {columns} columns; give {FRAMES_PER_COLUMN * columns} or more, "
            "or fewer joints."
        )
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise ValueError("the motions to correlate hold NaN or infinite values; mend or leave out the clip.")
    means = first.mean(axis=0), second.mean(axis=0)
    (a, back_a), (b, back_b) = _basis(first - means[0]), _basis(second - means[1])
    left, values, right = np.linalg.svd(a.T @ b)
    return Canonical(back_a @ left[:, 0], back_b @ right[0], *means, float(min(values[0], 1.0)))


def score(canonical: Canonical, first: Columns, second: Columns) -> float:
    """Correlation of the projections of other frames; 0 where one of them does not move."""
    a = (np.asarray(first, np.float64) - canonical.first_mean) @ canonical.first
    b = (np.asarray(second, np.float64) - canonical.second_mean) @ canonical.second
    return correlation(a, b)


def held_out(first: Sequence[Columns], second: Sequence[Columns]) -> Float[np.ndarray, " K"]:
    """Score of every clip by directions that were fitted on the others.

    Raises:
        ValueError: fewer than two clips, other numbers of them, or what `fit` refuses.
    """
    if len(first) != len(second) or len(first) < 2:
        raise ValueError(f"got {len(first)} and {len(second)} clips to correlate; give pairs of two clips or more.")
    scores = []
    for k in range(len(first)):
        rest = [at for at in range(len(first)) if at != k]
        fitted = fit(np.concatenate([first[at] for at in rest]), np.concatenate([second[at] for at in rest]))
        scores.append(score(fitted, first[k], second[k]))
    return np.array(scores)


def _basis(centred: Columns) -> tuple[Float[np.ndarray, "N R"], Float[np.ndarray, "P R"]]:
    """Orthonormal columns that span the frames, and what makes them of the given columns."""
    left, values, right = np.linalg.svd(centred, full_matrices=False)
    kept = values > TOLERANCE * max(float(values[0]), 1e-300)
    if not kept.any() or values[0] <= 0.0:
        raise ValueError("one of the two motions stands still, so nothing correlates with it; leave it out.")
    return left[:, kept], right[kept].T / values[kept]
