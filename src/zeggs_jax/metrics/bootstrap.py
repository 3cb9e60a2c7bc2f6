"""Confidence intervals by resampling whole clips (Efron 1979); the same seed gives the same interval.

Frames and windows of one clip depend on each other, so what is drawn again is always the clip. Where clips come in
strata (styles) that were chosen and not drawn, they are drawn within their stratum, so that its share stays.
"""

from collections.abc import Callable, Sequence
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


def of_mean(
    values: Float[np.ndarray, " N"],
    seed: int,
    level: float = LEVEL,
    draws: int = DRAWS,
    strata: Sequence[str | None] | None = None,
) -> Interval:
    """The mean of N clips' values with its percentile interval; a single clip has no interval (NaN bounds).

    Raises:
        ValueError: no values, one that is no number, or a level that is not between 0 and 1.
    """
    values = np.asarray(values, np.float64)
    if values.size and not np.isfinite(values).all():
        raise ValueError(f"value {int(np.argmin(np.isfinite(values)))} of {len(values)} is no number; leave it out.")
    return of_statistic(lambda index: float(values[index].mean()), len(values), seed, level, draws, strata=strata)


def of_statistic(
    statistic: Callable[[Int[np.ndarray, " N"]], float],
    clips: int,
    seed: int,
    level: float = LEVEL,
    draws: int = DRAWS,
    method: Method = "percentile",
    strata: Sequence[str | None] | None = None,
) -> Interval:
    """Any `statistic` of the numbers of the clips it is computed from, with its interval.

    "percentile" takes the quantiles of the resampled values; "centred" moves them so that their mean is the value,
    which suits distances between distributions: a resample holds clips twice, so it is farther from the truth than the
    clips themselves. That the clips, too, are farther from the truth than their whole population stays in the value.
    `strata` names each clip's; those of a single clip are drawn as one.

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
    groups = _strata(strata, clips)
    found = [statistic(np.concatenate([draw.choice(group, len(group)) for group in groups])) for _ in range(draws)]
    bounds = np.quantile(found, [0.5 * (1.0 - level), 0.5 * (1.0 + level)])
    low, high = (bounds - (np.mean(found) - value if method == "centred" else 0.0)).tolist()
    return Interval(value, low, high)


def _strata(names: Sequence[str | None] | None, clips: int) -> list[Int[np.ndarray, " _"]]:
    """Numbers of the clips of each stratum; those that are alone in theirs are together in one."""
    names = [""] * clips if names is None else [name or "" for name in names]
    if len(names) != clips:
        raise ValueError(f"got strata of {len(names)} clips for {clips} clips; give one for each.")
    labels = [name if names.count(name) > 1 else "" for name in names]
    return [np.flatnonzero([label == wanted for label in labels]) for wanted in sorted(set(labels))]
