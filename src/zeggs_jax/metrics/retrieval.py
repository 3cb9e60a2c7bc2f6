"""Retrieval between two sides of one space: how often the right one is among the first k, against chance."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from ..training.ranks import ranks, recall

AT = (1, 5, 10)


class Direction(NamedTuple):
    """One way: from each row's side to the columns'."""

    recalls: tuple[float, ...]  # R@1, R@5, R@10: shares of 0 to 1
    median: float  # rank of the right one


class Retrieval(NamedTuple):
    """Both ways, and what picking at random gets."""

    there: Direction  # rows ask, columns answer
    back: Direction
    chance: tuple[float, ...]  # R@1, R@5, R@10
    median: float  # of chance
    count: int  # candidates


def recalls(similarity: Float[ndarray, "N M"]) -> Retrieval:
    """R@1, 5 and 10 and the median rank both ways, of N pairs; row i belongs to column i.

    Raises:
        ValueError: no pairs, a matrix that is not square, numbers that are not finite.
    """
    similarity = np.asarray(similarity)
    if similarity.ndim != 2 or similarity.shape[0] != similarity.shape[1] or not len(similarity):
        raise ValueError(f"got similarities of shape {similarity.shape}; give one row and one column for each pair.")
    count = len(similarity)
    there, back = (_direction(matrix) for matrix in (similarity, similarity.T))
    return Retrieval(there, back, tuple(min(k / count, 1.0) for k in AT), (count + 1) / 2, count)


def _direction(similarity: Float[ndarray, "N N"]) -> Direction:
    places = ranks(similarity)
    return Direction(tuple(recall(places, k) for k in AT), float(np.median(places)))


def nearest(similarity: Float[ndarray, "N M"], k: int) -> list[list[int]]:
    """For each row the k columns that are most similar, the most similar first (Fig. 5)."""
    return np.argsort(-np.asarray(similarity), axis=1, kind="stable")[:, :k].tolist()


def top_share(weights: Sequence[Float[ndarray, " _"]], wanted: Sequence[Sequence[int]]) -> tuple[float, float]:
    """(share of the wanted words among the top-weighted of their sentence, the same for equal weights).

    Of a sentence of S words with m wanted ones, the m with the largest weights are taken; weights that tie share the
    places. Equal weights find m / S of them.

    Raises:
        ValueError: no wanted word anywhere, or a word beyond its sentence.
    """
    found = even = total = 0.0
    for row, picked in zip(weights, wanted, strict=True):
        many = len(set(picked))
        if not many:
            continue
        if max(picked) >= len(row) or min(picked) < 0:
            raise ValueError(f"word {max(picked)} is wanted of a sentence of {len(row)} words; count from 0.")
        found += _taken(np.asarray(row), sorted(set(picked)))
        even += many * many / len(row)
        total += many
    if not total:
        raise ValueError("no sentence has a wanted word; give some that have.")
    return found / total, even / total


def _taken(row: Float[ndarray, " S"], picked: list[int]) -> float:
    """How many of the picked are among the len(picked) largest; of those that tie at the edge, their even share."""
    edge = np.sort(row)[-len(picked)]
    above, at = row > edge, row == edge
    places = (len(picked) - above.sum()) / at.sum()
    return float(above[picked].sum() + places * at[picked].sum())
