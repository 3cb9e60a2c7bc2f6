"""How far a made motion is from the recorded one: APE, AVE and PCK.

They ask for the one motion that was recorded; a good gesture that is another one scores badly. Compare them with
the score of the mean pose, never alone.
"""

import numpy as np
from jaxtyping import Float

from .movement import Movement, from_hips, pair

WITHIN = 10.0  # cm: the threshold of 0.1 m that PantoMatrix (BEAT) uses for its recall of joints


def errors(made: Movement, truth: Movement, centred: bool = True) -> Float[np.ndarray, "T J"]:
    """Distance of every joint from the recorded one, cm; `centred` measures both from their own hips.

    Raises:
        ValueError: the motions differ in skeleton, rate or length, are empty, or hold NaN.
    """
    made, truth = pair(made, truth, 1)
    if centred:
        made, truth = from_hips(made), from_hips(truth)
    return np.linalg.norm(made.positions - truth.positions, axis=-1)


def ape(made: Movement, truth: Movement, centred: bool = True) -> float:
    """Average position error, cm: the mean distance over frames and joints (Gesticulator, Kucherenko et al. 2020).

    With `centred` the hips' own error of zero does not count.
    """
    return float(_others(errors(made, truth, centred), made, centred).mean())


def ave(made: Movement, truth: Movement, centred: bool = True) -> float:
    """Average variance error, cm^2: mean over joints of the distance between the variances over time of x, y, z.

    Variances are divided by T - 1 (Ghosh et al. 2021). It does not see when a motion happens, only how much there is.
    """
    made, truth = pair(made, truth, 2)
    if centred:
        made, truth = from_hips(made), from_hips(truth)
    apart = made.positions.var(axis=0, ddof=1) - truth.positions.var(axis=0, ddof=1)
    return float(_others(np.linalg.norm(apart, axis=-1), made, centred).mean())


def pck(made: Movement, truth: Movement, within: float = WITHIN, centred: bool = True) -> float:
    """Share of joints and frames nearer than `within` (cm) to the recorded ones (percentage of correct keypoints)."""
    return float((_others(errors(made, truth, centred), made, centred) < within).mean())


def _others(values: Float[np.ndarray, "*T J"], movement: Movement, centred: bool) -> Float[np.ndarray, "*T K"]:
    """The joints that count: without the hips where all is measured from them."""
    return np.delete(values, movement.skeleton.role("hips"), axis=-1) if centred else values
