"""Bodies on a plot's axes: the strip of poses of `figures.py` beside curves, in one figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from zeggs_jax.motion.bvh import Clip
from zeggs_jax.stage import shapes
from zeggs_jax.stage.drawing import STOPS, WEAR, Facet, Layout, facets, lit, shadows, stage, turned

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHADE = 66  # of the layout's units, for the shadow of the last body
BANDS = 10  # of light across a limb
SOFTNESS = (0.0, 2.0, 4.5, 7.5)  # of the shadow's edge: widths of the lines around it


def bare(axes: Axes, columns: int, rows: int, layout: Layout) -> None:
    """Axes without frame on which a grid of bodies stands, in the layout's units, y down."""
    axes.set(xlim=(0, columns * layout.width + SHADE), ylim=(rows * layout.height, 0), aspect="equal")
    axes.axis("off")


def line_up(
    axes: Axes, clip: Clip, instants: Sequence[float], colour: str, layout: Layout, row: int = 0, column: int = 0
) -> None:
    """One body for each instant in seconds, side by side in a row of axes made by `bare`, from a column on."""
    staged = stage(clip, instants, layout)
    for number, pieces in enumerate(staged.poses):
        place = np.array([(column + number + 0.5) * layout.width, (row + 0.94) * layout.height])
        body(axes, pieces, staged.view, place, WEAR | {shapes.TOP: colour})


def body(axes: Axes, pieces: Sequence[shapes.Piece], view: np.ndarray, place: np.ndarray, wear: dict[int, str]) -> None:
    """One body standing at a place, with its shadow, from far to near.

    Each piece is a pile of shapes, every next one cut shorter across the limb and in the next colour of the light, so
    that no seam shows between them.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    shadow = Path.make_compound_path(*(Path(np.vstack([s, s[:1]]) + place, closed=True) for s in shadows(pieces, view)))
    for width in SOFTNESS:
        axes.add_patch(PathPatch(shadow, facecolor="#14161c", edgecolor="#14161c", alpha=0.05, linewidth=0.3 * width))
    outlines, colours = [], []
    for facet in facets(pieces, view):
        for outline, colour in bands(facet, wear[facet.tone]):
            outlines.append(outline + place)
            colours.append(colour)
    axes.add_collection(PolyCollection(outlines, facecolors=colours, edgecolors="none", antialiaseds=True))


def bands(facet: Facet, colour: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Outlines [n, 2] on the paper and their colours [3]: the whole piece, then ever less of it to either side."""
    across = facet.outline[:, 1]
    top, height = float(across.min()), float(np.ptp(across))
    count = int(np.clip(round(height / 1.2), 2, BANDS))
    shades = lit(colour, facet.bin_)
    colours = [np.array([np.interp((k + 0.5) / count, STOPS, shades[:, c]) for c in range(3)]) for k in range(count)]
    middle = count // 2
    found = [(facet.outline, colours[middle])]
    for k in range(middle + 1, count):
        found.append((cut(facet.outline, top + height * k / count, 1.0), colours[k]))
    for k in range(middle - 1, -1, -1):
        found.append((cut(facet.outline, top + height * (k + 1) / count, -1.0), colours[k]))
    return [(outline @ turned(facet.bin_).T + facet.middle, shade) for outline, shade in found]


def cut(outline: np.ndarray, level: float, side: float) -> np.ndarray:
    """The part of a convex outline [n, 2] whose second coordinate is above a number (side 1) or below it (-1)."""
    apart = side * (outline[:, 1] - level)
    kept = []
    for a, b, here, there in zip(outline, np.roll(outline, -1, axis=0), apart, np.roll(apart, -1), strict=True):
        if here >= 0:
            kept.append(a)
        if (here >= 0) != (there >= 0):
            kept.append(a + here / (here - there) * (b - a))
    return np.array(kept)
