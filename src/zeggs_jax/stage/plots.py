"""Plots on paper: one look for all of them, the map of the style space (ZeroEGGS Fig. 8a), and files in one piece.

matplotlib is imported when something is drawn, not before. Sizes are inches as in a paper's columns.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN, PAGE = 3.4, 7.0  # inches: the width of a column and of a page
NAMED = 24  # clips: so many styles of one clip each are named on a map
FORMATS = (".png", ".svg", ".pdf")
DPI = 300
INK, SOFT, PALE = "#2b2f36", "#8a9099", "#d9dce1"  # text and lines, what is minor, grids
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#b3509a", "#d99a00", "#4aa8e0")  # after Okabe and Ito: colour-blind safe
MARKERS = ("o", "^", "s", "D")
LOOK: dict[Any, Any] = {
    "font.family": "DejaVu Sans", "font.size": 7.0, "axes.labelsize": 7.0, "axes.titlesize": 7.5,
    "xtick.labelsize": 6.5, "ytick.labelsize": 6.5, "legend.fontsize": 6.5, "mathtext.fontset": "dejavusans",
    "text.color": INK, "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK, "axes.edgecolor": SOFT,
    "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6, "xtick.major.size": 2.5,
    "ytick.major.size": 2.5, "axes.spines.top": False, "axes.spines.right": False, "axes.titleweight": "bold",
    "axes.titlelocation": "left", "axes.titlepad": 5.0, "axes.grid": False, "grid.color": PALE, "grid.linewidth": 0.5,
    "axes.axisbelow": True, "lines.linewidth": 1.2, "lines.solid_capstyle": "round", "legend.frameon": False,
    "svg.fonttype": "none", "svg.hashsalt": "zeggs", "figure.facecolor": "white", "savefig.facecolor": "white",
}  # fmt: skip


@contextmanager
def sheet(path: str | Path, width: float, height: float) -> Iterator[Figure]:
    """A figure of `width` x `height` inches to draw on; at the end it is written to `path`, whole or not at all.

    Raises ValueError for a name that does not end in .png, .svg or .pdf, OSError where it cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"'{path}' is no name for a picture; give one that ends in {', '.join(FORMATS)}.")
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(LOOK):
        figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
        figure.get_layout_engine().set(w_pad=0.03, h_pad=0.03)  # pyright: ignore
        yield figure
        _write(path, figure)


def _write(path: Path, figure: Figure) -> None:
    """The figure as a file; a PNG gets a palette, a third of the size without a visible difference."""
    kind, drawn = path.suffix.lower()[1:], io.BytesIO()
    dates: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {"Software": None}}
    figure.savefig(drawn, format=kind, metadata=dates[kind])
    if kind == "png":
        from PIL import Image

        image = (
            Image.open(drawn).convert("RGB").quantize(255, method=Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE)
        )
        drawn = io.BytesIO()
        image.save(drawn, format="png", optimize=True, dpi=(DPI, DPI))
    partial = path.with_name(f".{path.name}.part")
    try:
        partial.write_bytes(drawn.getvalue())
        os.replace(partial, path)
    except OSError as error:
        raise OSError(f"picture '{path}' cannot be written: {error.strerror}.") from error


def space(
    path: str | Path,
    points: Float[ArrayLike, "N 2"],
    labels: Sequence[str],
    shares: Sequence[float] = (),
    marked: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Writes the map of a style space (Fig. 8a): N clips by their first two principal components, by style.

    `points` are in standard deviations; a label of a single clip is drawn as a small grey dot without its name, unless
    all labels are so and few.
    `shares` of the variance stand at the axes (0 to 1); `marked` are places to point out, by name.

    Raises ValueError where points and labels do not fit or hold NaN, or the name is none of a picture's.
    """
    with sheet(path, 1.4 * COLUMN, 1.2 * COLUMN) as figure:
        scatter(figure.add_subplot(), points, labels, shares, marked)


def scatter(
    axes: Axes,
    points: Float[ArrayLike, "N 2"],
    labels: Sequence[str],
    shares: Sequence[float] = (),
    marked: Mapping[str, ArrayLike] | None = None,
) -> None:
    """`space` drawn on axes that are there."""
    places = np.asarray(points, np.float64)
    if len(places) != len(labels) or not len(places) or not np.isfinite(places).all():
        raise ValueError(
            f"the map got {len(places)} points and {len(labels)} labels; give one finite point for each label."
        )
    stars = {name: np.asarray(at, np.float64) for name, at in (marked or {}).items()}
    names = sorted({label for label in labels if list(labels).count(label) > 1})
    if not names and len(labels) <= NAMED:
        names = sorted(set(labels))
    alone = np.array([label not in names for label in labels])
    axes.axhline(0.0, color=PALE, linewidth=0.5, zorder=0)
    axes.axvline(0.0, color=PALE, linewidth=0.5, zorder=0)
    axes.scatter(*places[alone].T, s=5, color="#c3c7ce", linewidths=0, zorder=1)
    groups: dict[str, tuple[np.ndarray, str]] = {}
    for k, name in enumerate(names):
        group = places[[label == name for label in labels]]
        colour, marker = COLOURS[k % len(COLOURS)], MARKERS[k // len(COLOURS) % len(MARKERS)]
        _ellipse(axes, group, colour)
        axes.scatter(*group.T, s=11, color=colour, marker=marker, edgecolors="white", linewidths=0.35, zorder=3)
        groups[name] = (group.mean(axis=0), colour)
    for name, at in stars.items():
        axes.scatter(*at, s=75, color="#ffd23f", marker="*", edgecolors=INK, linewidths=0.7, zorder=6)
        groups[name] = (at, INK)
    for number, which in enumerate(("x", "y")):
        share = f" ({100 * shares[number]:.0f} % of the variance)" if number < len(shares) else ""
        axes.set(**{f"{which}label": f"component {number + 1}, standard deviations{share}"})
    axes.margins(0.08)
    axes.set_aspect("equal", adjustable="datalim")
    every = np.concatenate([places, *(at[None] for at in stars.values())])
    _name(axes, groups, every)


def _ellipse(axes: Axes, group: np.ndarray, colour: str) -> None:
    """The area within two standard deviations of a style's clips, in a pale tint."""
    if len(group) < 4:
        return
    from matplotlib.patches import Ellipse

    variance, turn = np.linalg.eigh(np.cov(group.T))
    width, height = (4.0 * np.sqrt(np.maximum(variance, 1e-6))).tolist()
    angle = float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0])))
    axes.add_patch(Ellipse(group.mean(axis=0).tolist(), width, height, angle=angle, facecolor=colour, alpha=0.13,
                           linewidth=0, zorder=2))  # fmt: skip


def _name(axes: Axes, groups: Mapping[str, tuple[np.ndarray, str]], every: np.ndarray) -> None:
    """Every group's name beside it, where it covers least; the places are tried from near to far."""
    from matplotlib import patheffects

    figure: Any = axes.figure
    figure.draw_without_rendering()
    dots, scale = axes.transData.transform(every), figure.dpi / 72.0
    frame = axes.get_window_extent()
    taken: list[np.ndarray] = []
    for name, (centre, colour) in groups.items():
        middle = axes.transData.transform(centre)
        size = scale * np.array([4.3 * len(name), 8.0])  # of the text in pixels, about
        best, least = middle, np.inf
        for far in (5.0, 8.0, 12.0, 17.0, 23.0):
            for angle in np.radians([90, 270, 0, 180, 45, 135, 225, 315]):
                way = np.array([np.cos(angle), np.sin(angle)])
                at = middle + way * (scale * far + 0.5 * size * np.abs(way))
                low, high = at - 0.5 * size, at + 0.5 * size
                covered = np.sum(np.all((dots > low) & (dots < high), axis=1))
                overlap = sum(bool(np.all(np.minimum(high, t[1]) > np.maximum(low, t[0]))) for t in taken)
                outside = bool(np.any(low < frame.min) or np.any(high > frame.max))
                cost = covered + 30.0 * overlap + 100.0 * outside + 0.15 * far
                if cost < least:
                    best, least = at, cost
        taken.append(np.stack([best - 0.5 * size, best + 0.5 * size]))
        text = axes.annotate(
            name,
            tuple(centre),
            tuple((best - middle) / scale), textcoords="offset points", ha="center", va="center", color=colour,
            fontweight="bold", fontsize=6.8, zorder=7,
        )  # fmt: skip
        text.set_path_effects([patheffects.withStroke(linewidth=1.8, foreground="white")])
