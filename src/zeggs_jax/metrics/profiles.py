"""What a report draws: how often joints are how fast, and where gestures of a group are seen from the front."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from . import coverage, kinematic, movement
from .movement import Movement

ORDERS: dict[str, kinematic.Order] = {"speed": 1, "acceleration": 2, "jerk": 3}
MERGED = 4  # cells of 0.5 cm to the side of one cell of a map
LEVELS = 9


def histograms(groups: Mapping[str, Sequence[Movement]], truth: str) -> dict[str, Any]:
    """Of speed, acceleration and jerk of the major joints: edges of bins, and the share of each bin in every group.

    The last bin is all that is above the last edge, the 99th percentile of the group called `truth`. A derivative of
    which the truth has none is left out.
    """
    joints = movement.major(groups[truth][0].skeleton)
    found = {}
    for name, order in ORDERS.items():
        try:
            edges = kinematic.edges_of(groups[truth], order, joints)
        except ValueError:
            continue
        counts = {group: _counted(clips, order, edges, joints) for group, clips in groups.items()}
        shares = {group: np.round(count / count.sum(), 6).tolist() for group, count in counts.items()}
        found[name] = {"edges": np.round(edges, 4).tolist(), "shares": shares}
    return found


def _counted(
    clips: Sequence[Movement], order: kinematic.Order, edges: Float[np.ndarray, " B"], joints: Sequence[int]
) -> Float[np.ndarray, " B"]:
    return np.sum([kinematic.histogram(clip, order, edges, joints) for clip in clips], axis=0)


def maps(groups: Mapping[str, Sequence[Movement]]) -> dict[str, Any]:
    """Per group the share of its clips whose body covers each cell of the square before it (`coverage.occupied`).

    Rows from the ground up, each a text of one digit a cell: 0 none, 9 all of the clips.
    """
    return {
        "cell_cm": coverage.CELL * MERGED,
        "side_cm": coverage.SIDE,
        "levels": LEVELS,
        "rows": {group: _levels(clips) for group, clips in groups.items()},
    }


def _levels(clips: Sequence[Movement]) -> list[str]:
    size = round(coverage.SIDE / coverage.CELL) // MERGED
    covered = [coverage.occupied(clip).reshape(size, MERGED, size, MERGED).any(axis=(1, 3)) for clip in clips]
    levels = np.ceil(LEVELS * np.mean(covered, axis=0) - 1e-9).astype(int)
    return ["".join(map(str, row)) for row in levels.tolist()]
