"""Confidence intervals by resampling whole clips (Efron 1979); the same seed gives the same interval.

Frames and windows of one clip depend on each other, so what is drawn again is always the clip.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int

LEVEL = 0.95
DRAWS = 2000

Method = Literal["percentile", "centred"]


class Interval(NamedTuple):
    """A value and the bounds between which it lies with the given confidence."""

    value: float
    low: float
    high: float


def of_mean(values: Float[np.ndarray, " N"], seed: int, level: float = LEVEL, draws: int = DRAWS) -> Interval:
    """The mean of N clips' values with its percentile interval; a single clip has no interval (NaN bounds).

    Raises:
        ValueError: no values, one that is no number, or a level that is not between 0 and 1.
    """
    values = np.asarray(values, np.float64)
    if values.size and not np.isfinite(values).all():
        raise ValueError(f"value {int(np.argmin(np.isfinite(values)))} of {len(values)} is no number; leave it out.")
    return of_statistic(lambda index: float(values[index].mean()), len(values), seed, level, draws)


def of_statistic(
    statistic: Callable[[Int[np.ndarray, " N"]], float],
    clips: int,
    seed: int,
    level: float = LEVEL,
    draws: int = DRAWS,
    method: Method = "percentile",
) -> Interval:
    """Any `statistic` of the numbers of the clips it is computed from, with its interval.

    "percentile" takes the quantiles of the resampled values; "centred" moves them so that their mean is the value,
    which suits distances between distributions: a resample holds clips twice, so it is farther from the truth than the
    clips themselves. That the clips, too, are farther from the truth than their whole population stays in the value.

    Raises:
        ValueError: no clips, fewer than 1 draw, or a level that is not between 0 and 1.
    """
    if clips < 1:
        raise ValueError("a confidence interval of no clips is impossible; give one clip or more.")
    if not 0.0 < level < 1.0 or draws < 1:
        raise ValueError(f"level {level:g} with {draws} draws is no interval; take a level in (0, 1) and some draws.")
    value = statistic(np.arange(clips))
    if clips == 1:
        return Interval(value, float("nan"), float("nan"))
    draw = np.random.default_rng([seed, clips])
    found = [statistic(draw.integers(0, clips, clips)) for _ in range(draws)]
    bounds = np.quantile(found, [0.5 * (1.0 - level), 0.5 * (1.0 + level)])
    low, high = (bounds - (np.mean(found) - value if method == "centred" else 0.0)).tolist()
    return Interval(value, low, high)
