"""SRGR, semantic-relevance gesture recall: joints near the truth, counted where words have meaning (BEAT, Sec. 7.2)."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .meaning import Said

SPAN = (-0.2, 0.8)  # s around a word's time in which its gesture is to be seen
THRESHOLD_CM = 10.0


def semantic_weights(said: Sequence[Said], frames: int, rate_hz: float | int) -> Float[np.ndarray, " T"]:
    """1 while a word's gesture is to be seen, 0 elsewhere: the semantic score that BEAT's annotators gave by hand."""
    time, weights = np.arange(frames) / rate_hz, np.zeros(frames)
    for one in said:
        weights[(time >= one.time + SPAN[0]) & (time <= one.time + SPAN[1])] = 1.0
    return weights


def srgr(
    made: Float[np.ndarray, "_ _ 3"],
    truth: Float[np.ndarray, "_ _ 3"],
    weights: Float[np.ndarray, " _"],
    threshold: float | int = THRESHOLD_CM,
) -> float:
    """Semantic-relevance gesture recall (BEAT, Liu et al. 2022): PCK weighted by the semantic score, 0..1.

    Both motions are places of the same joints in the same frames, [T, J, 3] in cm; the scores are [T]. The share of
    joints that are within `threshold` cm of the truth's (Euclidean, relative to the first joint), mean over frames
    weighted by `weights`. The truth gets 1. Releases of BEAT's code differ in norm, unit and factor, so numbers compare
    only with numbers of this function.

    Raises:
        ValueError: other shapes, weights that are negative or all 0.
    """
    made, truth, weights = (np.asarray(a, np.float64) for a in (made, truth, weights))
    if made.shape != truth.shape or weights.shape != made.shape[:1]:
        raise ValueError(
            f"got motions of shapes {made.shape} and {truth.shape} and {weights.shape} weights; give the same frames "
            "and joints, one weight for each frame."
        )
    if not weights.size or weights.min() < 0.0 or weights.sum() <= 0.0:
        raise ValueError("the semantic scores are negative or all 0; give clips that say something.")
    way = (made - made[:, :1]) - (truth - truth[:, :1])
    near = (np.linalg.norm(way, axis=-1) < threshold).mean(axis=1)
    return float(weights @ near / weights.sum())
