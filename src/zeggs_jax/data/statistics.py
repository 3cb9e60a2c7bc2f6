"""Mean and variance of rows that come a block at a time: the moments of two blocks merge into those of both."""

from collections.abc import Iterable
from functools import reduce
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Moments(NamedTuple):
    """Of some rows of n columns, in float64; in what order and in which blocks they came does not matter."""

    count: int
    mean: Float[np.ndarray, " n"]
    squares: Float[np.ndarray, " n"]  # sum of squared distances from the mean


def moments(rows: Float[np.ndarray, "T n"]) -> Moments:
    """Of one block, in two passes over it."""
    rows = rows.astype(np.float64)
    mean = rows.mean(axis=0)
    return Moments(len(rows), mean, np.square(rows - mean).sum(axis=0))


def merge(a: Moments, b: Moments) -> Moments:
    """Of the rows of both (Chan, Golub and LeVeque 1979); a column that is constant in both stays exactly so."""
    count, apart = a.count + b.count, b.mean - a.mean
    mean = a.mean + apart * (b.count / count)
    return Moments(count, mean, a.squares + b.squares + apart**2 * (a.count * b.count / count))


def total(blocks: Iterable[np.ndarray]) -> Moments:
    """Of the rows of all blocks [T, n], at least one."""
    return reduce(merge, (moments(block) for block in blocks))
