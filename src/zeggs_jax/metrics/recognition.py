"""Style recognition by the nearest centroid of kinematic statistics, and what the same gets of the truth."""

from collections.abc import Sequence
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


class Recognition(NamedTuple):
    """How often made clips are recognised as the style they were made in, and what that is worth."""

    accuracy: float  # share of the made clips
    truth: float  # share of the recorded clips, each by centroids made without it: what can be expected at best
    chance: float  # share that guessing the most frequent style of the made clips gets
    recognised: tuple[str, ...]  # the style of each made clip, as recognised
    right: tuple[bool, ...]  # of each made clip


def judge(
    truth: Float[np.ndarray, "N S"],
    truth_styles: Sequence[str],
    made: Float[np.ndarray, "M S"],
    made_styles: Sequence[str],
) -> Recognition:
    """Recognises made clips by the recorded ones, and the recorded ones by each other.

    `truth` and `made` hold `kinematic.style_statistics` of each clip.

    Raises:
        ValueError: clips without a style, a style of which fewer than two clips are recorded, fewer than two styles.
    """
    if not len(made) or len(made) != len(made_styles):
        raise ValueError(f"got {len(made)} made clips and {len(made_styles)} styles; give some, one style each.")
    own = own_accuracy(truth, truth_styles)
    if missing := sorted(set(made_styles) - set(truth_styles)):
        raise ValueError(f"no recorded clip shows the style '{missing[0]}'; give two or more that do.")
    centroids = fit(np.asarray(truth, np.float64), list(truth_styles))
    recognised = tuple(nearest(centroids, row) for row in np.asarray(made, np.float64))
    right = tuple(found == style for found, style in zip(recognised, made_styles, strict=True))
    most = max(list(made_styles).count(style) for style in made_styles)
    return Recognition(float(np.mean(right)), own, most / len(made), recognised, right)


def own_accuracy(statistics: Float[np.ndarray, "N S"], styles: Sequence[str]) -> float:
    """Share of clips that are recognised by centroids made without them; see `own`."""
    return float(np.mean([seen == style for seen, style in zip(own(statistics, styles), styles, strict=True)]))


def own(statistics: Float[np.ndarray, "N S"], styles: Sequence[str]) -> tuple[str, ...]:
    """The style that each clip is taken for by centroids made without it.

    Raises:
        ValueError: rows and styles that do not fit, statistics that are no numbers, a style of which there are fewer
            than two clips, or fewer than two styles.
    """
    statistics = np.asarray(statistics, np.float64)
    if len(statistics) != len(styles) or not np.isfinite(statistics).all():
        raise ValueError(
            f"got statistics of {len(statistics)} recorded clips and {len(styles)} styles; give one row of numbers "
            "for each style."
        )
    if single := sorted({style for style in styles if list(styles).count(style) < 2}):
        raise ValueError(f"only one recorded clip shows the style '{single[0]}'; give two or more of each style.")
    seen = []
    for k in range(len(styles)):
        others = [other for at, other in enumerate(styles) if at != k]
        seen.append(nearest(fit(np.delete(statistics, k, axis=0), others), statistics[k]))
    return tuple(seen)
