"""How much motions differ: between clips (diversity), between samples for one speech (multimodality), within (L1)."""

import numpy as np
from jaxtyping import Float

from .movement import Movement, checked


def diversity(features: Float[np.ndarray, "N D"]) -> float:
    """Mean Euclidean distance between the features of two different clips, over all pairs (AIST++, Li et al. 2021).

    In the features' unit. All pairs are taken, none are drawn: the value needs no seed. Of every clip given twice it
    is (2 N - 2) / (2 N - 1) of what it is of the clips given once.

    Raises:
        ValueError: fewer than two clips, or a feature that is no number.
    """
    features = _finite(features)
    if len(features) < 2:
        raise ValueError(f"diversity compares clips, got {len(features)}; give two or more.")
    count = len(features)
    apart = [np.linalg.norm(features[k + 1 :] - features[k], axis=-1).sum() for k in range(count - 1)]
    return float(np.sum(apart) / (count * (count - 1) / 2))


def multimodality(features: Float[np.ndarray, "S M D"]) -> float:
    """Mean distance between M samples for the same speech, averaged over S speeches; 0 where all samples are one.

    Raises:
        ValueError: fewer than two samples, no speech, or a feature that is no number.
    """
    if not len(features):
        raise ValueError("multimodality needs the samples of one speech or more, got none.")
    return float(np.mean([diversity(samples) for samples in _finite(features)]))


def l1(movement: Movement) -> float:
    """Mean |x - mean of the clip| over frames, joints and axes, cm: how far the body goes from its mean pose.

    EMAGE's L1Div is the same summed over joints and axes instead, in metres: this times 3 J / 100. Measured from the
    hips (`movement.from_hips`) it does not count where the body goes. The positions given are not changed.
    """
    positions = checked(movement, 1).positions
    return float(np.abs(positions - positions.mean(axis=0, keepdims=True)).mean())


def _finite(features: np.ndarray) -> np.ndarray:
    features = np.asarray(features, np.float64)
    if not np.isfinite(features).all():
        raise ValueError("a feature is NaN or infinite; leave out the clip that it comes from.")
    return features
