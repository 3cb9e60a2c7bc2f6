"""Small SVG drawings of a report: a value with its interval, distributions, where gestures reach; colours by CSS."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

NOTHING = 1e-9  # what rounding leaves of a zero
Cell = Mapping[str, Any]  # "value", "low" and "high", which may be None


def interval(cells: Mapping[str, Cell], truth: str, colours: Mapping[str, str], width: int = 240) -> str:
    """One measure: a dot and a whisker for each group below each other, the truth as a line and a band behind."""
    numbers = [cell[key] for cell in cells.values() for key in ("value", "low", "high") if cell[key] is not None]
    low, high = min(numbers), max(numbers)
    room = 0.06 * (high - low) or max(abs(high), 1.0) * 0.1
    low, high = low - room, high + room

    def x(value: float) -> float:
        return round(6 + (width - 12) * (value - low) / (high - low), 1)

    made = [group for group in cells if group != truth]
    height = max(10 * len(made), 10) + 8
    parts = [f'<line class="axis" x1="6" x2="{width - 6}" y1="{height - 1.5}" y2="{height - 1.5}"/>']
    if own := cells.get(truth):
        if own["low"] is not None:
            left, right = x(own["low"]), x(own["high"])
            parts.append(
                f'<rect class="band" x="{left}" y="1" width="{max(right - left, 1):g}" height="{height - 3}"/>'
            )
        at = x(own["value"])
        parts.append(f'<line class="own" x1="{at}" x2="{at}" y1="1" y2="{height - 2}"/>')
    for row, group in enumerate(made):
        cell, y = cells[group], 8 + 10 * row
        style = f'style="color:{colours[group]}"'
        if cell["low"] is not None:
            parts.append(f'<path {style} class="whisker" d="M{x(cell["low"])} {y}H{x(cell["high"])}"/>')
        parts.append(f'<circle {style} class="dot" cx="{x(cell["value"])}" cy="{y}" r="3.6"/>')
    return _svg(width, height, parts, "plot", "values and intervals of the groups")


def histogram(
    edges: Sequence[float], shares: Mapping[str, Sequence[float]], truth: str, colours: Mapping[str, str], unit: str
) -> str:
    """Shares of bins: the truth as a filled area, each group as a line; the last bin is all above the last edge.

    Heights are square roots of shares, as the Hellinger distance compares them, so that rare speeds are seen.
    """
    width, height, left, foot = 420, 210, 8, 30
    top = max(max(values) for values in shares.values()) ** 0.5 * 1.06 or 1.0
    step = (width - 2 * left) / len(edges)

    def outline(values: Sequence[float]) -> str:
        ys = [round((height - foot) * (1.0 - value**0.5 / top), 1) for value in values]
        return "".join(f"L{left + step * k:.1f} {y}H{left + step * (k + 1):.1f}" for k, y in enumerate(ys))

    ground = height - foot
    parts = [f'<path class="area" d="M{left} {ground}{outline(shares[truth])}V{ground}z"/>']
    for group, values in shares.items():
        if group != truth:
            path = "M" + outline(values)[1:]
            parts.append(f'<path class="curve" style="color:{colours[group]}" d="{path}"/>')
    parts.append(f'<line class="axis" x1="{left}" x2="{width - left}" y1="{ground}" y2="{ground}"/>')
    for value in ticks(float(edges[-1])):
        at = left + step * (len(edges) - 1) * value / edges[-1]
        parts.append(f'<line class="axis" x1="{at:.1f}" x2="{at:.1f}" y1="{ground}" y2="{ground + 4}"/>')
        parts.append(f'<text x="{at:.1f}" y="{ground + 16}" text-anchor="middle">{number(value)}</text>')
    parts.append(f'<text x="{width - left}" y="{ground + 28}" text-anchor="end">{escape(unit)}</text>')
    return _svg(width, height, parts, "histogram", f"distribution in {unit}")


def ticks(top: float, count: int = 5) -> list[float]:
    """Round numbers from 0 to `top`, about `count` of them."""
    rough = top / count
    size = 10.0 ** np.floor(np.log10(rough))
    step = next(size * k for k in (1, 2, 5, 10) if size * k >= rough)
    return [step * k for k in range(int(top / step + 1e-9) + 1)]


def coverage(rows: Sequence[str], outline: Sequence[str], levels: int, colour: str, crop: tuple[int, int]) -> str:
    """A map of digits, rows from the ground up: darker where more clips reach; a line around what the truth covers.

    `crop` is (columns left out at either side, rows shown).
    """
    grid, own = (np.array([list(map(int, row)) for row in text]) for text in (rows, outline))
    aside, tall = crop
    grid, own = grid[:tall, aside : grid.shape[1] - aside][::-1], own[:tall, aside : own.shape[1] - aside][::-1]
    parts = []
    for level in range(1, levels + 1):
        if runs := _runs(grid == level):
            parts.append(f'<path style="color:{colour}" class="cover" fill-opacity="{level / levels:.2f}" d="{runs}"/>')
    parts.append(f'<path class="edge" d="{_edges(own > levels // 2)}"/>')
    return _svg(grid.shape[1], grid.shape[0], parts, "map", "where gestures of the group reach, from the front")


def _runs(mask: np.ndarray) -> str:
    """Horizontal runs of cells as rectangles of one path."""
    found = []
    for y, row in enumerate(mask):
        turns = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(int), [0]])))
        found += [f"M{a} {y}h{b - a}v1h{a - b}z" for a, b in zip(turns[::2], turns[1::2], strict=True)]
    return "".join(found)


def _edges(mask: np.ndarray) -> str:
    """Sides of cells between what is inside and what is not."""
    framed = np.pad(mask, 1).astype(int)
    flat, upright = np.argwhere(np.diff(framed, axis=0)[:, 1:-1]), np.argwhere(np.diff(framed, axis=1)[1:-1])
    return "".join([*(f"M{x} {y}h1" for y, x in flat.tolist()), *(f"M{x} {y}v1" for y, x in upright.tolist())])


def number(value: float | int | None) -> str:
    """Three digits, thousands apart."""
    if value is None:
        return ""
    if abs(value) >= 1000:
        return f"{value:,.0f}".replace(",", "\u202f")
    if abs(value) < 5e-4:
        return "0" if abs(value) < NOTHING else f"{value:.0e}".replace("e-0", "e-")
    return f"{value:.3g}" if abs(value) >= 0.1 else f"{value:.3f}"


def _svg(width: int, height: int, parts: Sequence[str], name: str, label: str) -> str:
    return (
        f'<svg class="{name}" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(label)}">'
        f"{''.join(parts)}</svg>"
    )
