"""Gesture area coverage: the area in front of which a body gestures (Tonoli et al. 2024, "Gesture Area Coverage")."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .movement import Movement, alike, checked, in_heading, major, sampled

SIDE = 200.0  # cm: the square from -100 to 100 across and 0 to 200 up
CELL = 0.5  # cm
RATE_HZ = 6.0  # poses drawn per second: every 5th frame at 30 Hz

Grid = Bool[np.ndarray, "R R"]


class Coverage(NamedTuple):
    """Areas that two motions cover, relative to the truth's own area."""

    dice: float  # 2 |both| / (|made| + |truth|): 1 is the same area, 0 none in common
    area: float  # of the made motion; 1 is as large as the truth's
    beyond: float  # covered by the made motion only
    missing: float  # covered by the truth only


def occupied(movement: Movement) -> Grid:
    """Cells that a bone of the body crosses, seen from the front; rows from the ground up, columns along x.

    Constants of the source: 200 cm square, cells of 0.5 cm, 6 poses a second. Unlike there, the body is first turned
    to its mean heading and set over the middle, fingers and bone ends are left out, and what is outside is cut off
    rather than drawn on the edge.

    Raises:
        ValueError: no frames, NaN, a skeleton without hips or hands.
    """
    movement = in_heading(checked(movement, 1))
    skeleton = movement.skeleton
    poses = sampled(movement, min(RATE_HZ, movement.rate_hz)).positions[..., :2]
    children = [joint for joint in major(skeleton) if joint != skeleton.role("hips")]
    start, end = poses[:, [skeleton.parents[joint] for joint in children]], poses[:, children]
    longest = np.linalg.norm(end - start, axis=-1).max()
    share = np.linspace(0.0, 1.0, int(2.0 * longest / CELL) + 2)[:, None, None, None]
    return _mark(start + share * (end - start))


def _mark(points: Float[np.ndarray, "*b 2"]) -> Grid:
    cells: Int[np.ndarray, "n 2"] = np.floor((points.reshape(-1, 2) + np.array([SIDE / 2, 0.0])) / CELL).astype(int)
    size = round(SIDE / CELL)
    inside = cells[((cells >= 0) & (cells < size)).all(axis=1)]
    grid = np.zeros((size, size), bool)
    grid[inside[:, 1], inside[:, 0]] = True
    return grid


def area(grid: Grid) -> float:
    """Covered area, cm^2."""
    return float(grid.sum() * CELL**2)


def compare(made: Movement, truth: Movement) -> Coverage:
    """The area that a made motion covers against the recorded one's.

    Raises:
        ValueError: another skeleton or rate, no frames, NaN, or a truth of which nothing is inside the square.
    """
    made, truth = alike([made, truth], 1, ["the made motion", "the truth"])
    return of_grids(occupied(made), occupied(truth))


def of_grids(made: Grid, truth: Grid) -> Coverage:
    """The comparison of two areas, each the union over all frames of one or more clips."""
    true = int(truth.sum())
    if not true:
        raise ValueError(
            f"nothing of the truth is in the square of {SIDE:g} cm above the ground; give positions in cm, y up."
        )
    both = int((made & truth).sum())
    count = int(made.sum())
    return Coverage(2.0 * both / (count + true), count / true, (count - both) / true, (true - both) / true)
