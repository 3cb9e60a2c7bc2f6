"""Style recognition by the nearest centroid of kinematic statistics."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Centroids(NamedTuple):
    """One point per style, in statistics standardised over all the clips it was made from."""

    names: tuple[str, ...]
    points: Float[np.ndarray, "K S"]
    mean: Float[np.ndarray, " S"]
    spread: Float[np.ndarray, " S"]


def fit(statistics: Float[np.ndarray, "N S"], styles: list[str]) -> Centroids:
    """Centroids of N clips' statistics, scaled by the pooled spread within styles.

    Raises:
        ValueError: fewer than two styles.
    """
    names = tuple(sorted(set(styles)))
    if len(names) < 2:
        raise ValueError(f"recognition needs two styles or more, got {len(names)}.")
    label = np.array([names.index(style) for style in styles])
    mean = statistics.mean(axis=0)
    points = np.stack([statistics[label == k].mean(axis=0) for k in range(len(names))])
    within = np.sqrt(((statistics - points[label]) ** 2).mean(axis=0))
    spread = within + 0.05 * statistics.std(axis=0) + 1e-6
    return Centroids(names, (points - mean) / spread, mean, spread)


def nearest(centroids: Centroids, statistics: Float[np.ndarray, " S"]) -> str:
    """The name of the closest centroid."""
    z = (statistics - centroids.mean) / centroids.spread
    return centroids.names[int(np.linalg.norm(centroids.points - z, axis=1).argmin())]
