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
SIZE = 200_000  # bytes of a PNG, above which it gets fewer colours, then fewer dots
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
    """The figure as a file; a PNG gets a palette, half the size without a visible difference, and is kept small."""
    kind, drawn = path.suffix.lower()[1:], io.BytesIO()
    dates: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {"Software": None}}
    figure.savefig(drawn, format=kind, metadata=dates[kind])
    if kind == "png":
        from PIL import Image

        image = Image.open(drawn).convert("RGB")
        for colours, dpi in ((255, DPI), (128, DPI), (80, DPI), (128, 240), (80, 200), (64, 150)):
            size = (round(image.width * dpi / DPI), round(image.height * dpi / DPI))
            fewer = image if dpi == DPI else image.resize(size, Image.Resampling.LANCZOS)
            small = fewer.quantize(colours, method=Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE)
            drawn = io.BytesIO()
            small.save(drawn, format="png", optimize=True, dpi=(dpi, dpi))
            if drawn.tell() < SIZE:
                break
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
    marked: Mapping[str, ArrayLike | Sequence[float]] | None = None,
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
    marked: Mapping[str, ArrayLike | Sequence[float]] | None = None,
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
        share = f" ({100 * shares[number]:.0f} % of variance)" if number < len(shares) else ""
        axes.set(**{f"{which}label": f"PC{number + 1}, standard deviations{share}"})
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
        best, least, leader = middle, np.inf, None
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
                    leader = {"arrowstyle": "-", "color": colour, "linewidth": 0.5, "shrinkA": 0} if far > 10 else None
        taken.append(np.stack([best - 0.5 * size, best + 0.5 * size]))
        for halo in (True, False):  # the halo is a drawing, the name itself stays text in an SVG
            text = axes.annotate(
                name, tuple(centre), tuple((best - middle) / scale), textcoords="offset points", ha="center",
                va="center", color="white" if halo else colour, fontweight="bold", fontsize=6.8, zorder=7,
                arrowprops=leader if halo else None,
            )  # fmt: skip
            if halo:
                text.set_path_effects([patheffects.withStroke(linewidth=1.8, foreground="white")])


def ramp(count: int) -> list[tuple[float, float, float]]:
    """`count` colours from blue over grey to vermilion, for values from low to high."""
    stops = np.array([[0.0, 0.447, 0.698], [0.63, 0.65, 0.68], [0.835, 0.369, 0.0]])
    at = np.linspace(0.0, 2.0, count)
    mixed = np.stack([np.interp(at, (0.0, 1.0, 2.0), stops[:, c]) for c in range(3)], axis=1)
    return [(r, g, b) for r, g, b in mixed.tolist()]


def ridges(axes: Axes, samples: Sequence[ArrayLike], names: Sequence[str], label: str) -> None:
    """Distributions [n] one above the other, each a smoothed density of the same area, from the lowest row up."""
    values = [np.asarray(sample, np.float64) for sample in samples]
    low, high = min(float(np.quantile(v, 0.005)) for v in values), max(float(np.quantile(v, 0.995)) for v in values)
    grid = np.linspace(low, high, 300)
    densities = [_density(value, grid) for value in values]
    for k, (density, colour) in reversed(list(enumerate(zip(densities, ramp(len(values)), strict=True)))):
        heights = k + 1.7 * density / max(d.max() for d in densities)
        axes.fill_between(grid, k, heights, color=colour, alpha=0.55, linewidth=0, zorder=len(values) - k)
        axes.plot(grid, heights, color=colour, linewidth=0.9, zorder=len(values) - k)
        axes.plot([values[k].mean()] * 2, [k, k + 0.35], color=INK, linewidth=0.9, zorder=len(values) + 1)
    axes.set(yticks=range(len(names)), yticklabels=names, xlabel=label, xlim=(low, high), ylim=(-0.15, None))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def _density(values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Smoothed density of samples on a grid; of equal samples, a narrow bell."""
    from scipy import stats

    least = 0.01 * (grid[-1] - grid[0])
    if values.std() > least:
        return stats.gaussian_kde(values)(grid)
    return stats.norm.pdf(grid, values.mean(), least)


def heat(
    axes: Axes,
    values: Float[ArrayLike, "R C"],
    rows: Sequence[str],
    columns: Sequence[str],
    weight: Float[ArrayLike, "R C"] | None = None,
) -> None:
    """A table of rank correlations, coloured from -1 to 1, with the numbers in it; `weight` 0 to 1 fades the colour."""
    from matplotlib.colors import LinearSegmentedColormap

    table = np.asarray(values, np.float64)
    colours = LinearSegmentedColormap.from_list("signs", ["#0072b2", "#ffffff", "#d55e00"])
    shown = table if weight is None else table * np.asarray(weight, np.float64)
    axes.imshow(shown, cmap=colours, vmin=-1.15, vmax=1.15, aspect="auto")
    for (row, column), value in np.ndenumerate(table):
        ink = "white" if abs(shown[row, column]) > 0.7 else INK
        number = f"{value:+.2f}".replace("-", "\u2212")
        axes.text(column, row, number, ha="center", va="center", fontsize=5.2, color=ink)
    axes.set_xticks(range(len(columns)), columns)
    axes.set_yticks(range(len(rows)), rows)
    axes.tick_params(length=0)
    axes.xaxis.tick_top()
    for spine in axes.spines.values():
        spine.set_visible(False)
