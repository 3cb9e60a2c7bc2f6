"""Frechet distance between made and recorded gestures: of learned features (FGD), of postures, of velocities.

Published figures of other nets, windows and skeletons are not comparable with these, nor with each other. Read the
distance beside that of two halves of the truth (`between_halves`), which no motion can be expected to fall below.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from . import movement
from .feature_net import FeatureNet, embed
from .movement import Movement

SAMPLES_PER_DIMENSION = 2  # fewer do not say what a covariance is
RATE_HZ = 10.0  # at which postures are taken: neighbouring frames say the same

Samples = Float[np.ndarray, "_ _"]  # [N, D]


def distance(made: Samples, truth: Samples) -> float:
    """|m_a - m_b|^2 + tr(A + B - 2 (A B)^(1/2)) of the Gaussians through two sets of samples (Heusel et al. 2017).

    In the samples' unit squared. The trace of the square root is the sum of the singular values of R_a R_b^T, where
    A = R_a^T R_a: no product of covariances is formed and no root of a matrix taken, so that singular covariances give
    neither NaN nor a complex or negative distance. Covariances are divided by N, so giving every sample twice changes
    nothing; with numpy's N - 1 figures are larger by about 1 / N of the traces.

    Raises:
        ValueError: other dimensions, samples that are no numbers, fewer than two for every dimension.
    """
    made, truth = np.asarray(made, np.float64), np.asarray(truth, np.float64)
    if made.ndim != 2 or truth.ndim != 2 or made.shape[1] != truth.shape[1]:
        raise ValueError(f"samples of shapes {made.shape} and {truth.shape} do not fit; give [N, D] and [M, D].")
    for name, samples in (("made", made), ("true", truth)):
        needed = SAMPLES_PER_DIMENSION * samples.shape[1]
        if len(samples) < needed:
            raise ValueError(
                f"{len(samples)} {name} samples are too few for a Frechet distance of {samples.shape[1]} dimensions; "
                f"give {needed} or more, that is more or longer clips."
            )
        if not np.isfinite(samples).all():
            raise ValueError(f"the {name} samples hold NaN or infinite values; leave out the clip that they come from.")
    (mean_a, root_a), (mean_b, root_b) = _gaussian(made), _gaussian(truth)
    shared = np.linalg.svd(root_a @ root_b.T, compute_uv=False).sum()
    spread = np.square(root_a).sum() + np.square(root_b).sum() - 2.0 * shared
    return float(np.square(mean_a - mean_b).sum() + max(spread, 0.0))


def _gaussian(samples: Samples) -> tuple[Float[np.ndarray, " D"], Float[np.ndarray, "R D"]]:
    """Mean, and R with R^T R the covariance."""
    mean = samples.mean(axis=0)
    return mean, np.linalg.qr(samples - mean, mode="r") / np.sqrt(len(samples))


def gesture_distance(net: FeatureNet, made: Sequence[Movement], truth: Sequence[Movement]) -> float:
    """Frechet gesture distance (Yoon et al. 2020) on the features of a frozen net; see `distance` and `feature_net`.

    Raises:
        ValueError: also where a motion is not of the net's joints or too short for a window.
    """
    return distance(*(np.concatenate([embed(net, clip) for clip in clips]) for clips in _groups(made, truth)))


def geometric(made: Sequence[Movement], truth: Sequence[Movement]) -> float:
    """Frechet distance of postures, cm^2: positions of the major joints, taken 10 times a second (FD_g)."""
    return distance(*(np.concatenate([postures(clip) for clip in clips]) for clips in _groups(made, truth)))


def kinetic(made: Sequence[Movement], truth: Sequence[Movement]) -> float:
    """Frechet distance of velocities, (cm/s)^2: of the major joints, over tenths of a second (FD_k)."""
    return distance(*(np.concatenate([velocities(clip) for clip in clips]) for clips in _groups(made, truth)))


def postures(clip: Movement) -> Samples:
    """Positions of the major joints in the clip's heading, cm, [frames at 10 Hz, joints * 3]."""
    clip = movement.sampled(movement.in_heading(movement.checked(clip)), RATE_HZ)
    return clip.positions[:, movement.major(clip.skeleton)].reshape(len(clip.positions), -1)


def velocities(clip: Movement) -> Samples:
    """Their changes over a tenth of a second, cm/s."""
    return np.diff(postures(clip), axis=0) * RATE_HZ


class Moments(NamedTuple):
    """What a Frechet distance needs of one clip's samples, so that drawing clips again and again costs little."""

    count: int
    mean: Float[np.ndarray, " D"]
    scatter: Float[np.ndarray, "D D"]  # sum over samples of the outer product of what is left after the mean


class Normal(NamedTuple):
    """A Gaussian: its mean, and R with R^T R its covariance."""

    mean: Float[np.ndarray, " D"]
    root: Float[np.ndarray, "D D"]


def moments(samples: Samples) -> Moments:
    """Count, mean and scatter of one clip's samples; ValueError where one is no number."""
    samples = np.asarray(samples, np.float64)
    if not np.isfinite(samples).all():
        raise ValueError("samples hold NaN or infinite values; leave out the clip that they come from.")
    apart = samples - (mean := samples.mean(axis=0))
    return Moments(len(samples), mean, apart.T @ apart)


def normal(clips: Sequence[Moments]) -> Normal:
    """The Gaussian through all samples of some clips, each as often as it is given.

    Raises:
        ValueError: fewer than two samples for every dimension.
    """
    counts = np.array([clip.count for clip in clips], np.float64)
    means = np.stack([clip.mean for clip in clips])
    needed, total = SAMPLES_PER_DIMENSION * means.shape[1], int(counts.sum())
    if total < needed:
        raise ValueError(
            f"{total} samples are too few for a Frechet distance of {means.shape[1]} dimensions; "
            f"give {needed} or more, that is more or longer clips."
        )
    mean = counts @ means / total
    apart = (means - mean) * np.sqrt(counts)[:, None]
    covariance = (np.sum([clip.scatter for clip in clips], axis=0) + apart.T @ apart) / total
    values, vectors = np.linalg.eigh(covariance)
    return Normal(mean, np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)


def between(made: Normal, truth: Normal) -> float:
    """`distance` of the samples that two Gaussians go through, to about 1e-8 of their traces."""
    shared = np.linalg.svd(made.root @ truth.root.T, compute_uv=False).sum()
    spread = np.square(made.root).sum() + np.square(truth.root).sum() - 2.0 * shared
    return float(np.square(made.mean - truth.mean).sum() + max(spread, 0.0))


def between_halves(
    clips: Sequence[Moments], seed: int, strata: Sequence[str | None] | None = None, draws: int = 20
) -> float:
    """Mean distance between two random halves of the clips: what the truth has from itself.

    `strata` are the clips' styles: each is split in half, so that both halves show the same styles. Halves are smaller
    than the whole, so this is an upper bound of what sampling alone makes.

    Raises:
        ValueError: fewer than two clips, strata that do not fit, or too few samples in a half.
    """
    strata = [None] * len(clips) if strata is None else list(strata)
    if len(clips) < 2 or len(strata) != len(clips):
        raise ValueError(f"halves need two clips or more and a stratum for each, got {len(clips)} and {len(strata)}.")
    draw = np.random.default_rng(seed)
    found = []
    for _ in range(draws):
        order = sorted(draw.permutation(len(clips)).tolist(), key=lambda k: str(strata[k]))  # stable: random within
        found.append(between(*(normal([clips[k] for k in order[side::2]]) for side in (0, 1))))
    return float(np.mean(found))


def _groups(made: Sequence[Movement], truth: Sequence[Movement]) -> tuple[list[Movement], list[Movement]]:
    if not made or not truth:
        raise ValueError(f"got {len(made)} made and {len(truth)} true motions to compare; give one or more of each.")
    both = movement.alike([*made, *truth])
    return both[: len(made)], both[len(made) :]
