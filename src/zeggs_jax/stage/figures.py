"""Pictures of motion: a strip of poses as SVG, instants side by side and clips one below the other."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from zeggs_jax.motion.bvh import Clip
from zeggs_jax.stage import shapes
from zeggs_jax.stage.drawing import BINS, STOPS, WEAR, Layout, facets, lit, shadows, stage
from zeggs_jax.stage.player import COLOURS, save

STYLE = (
    "text{font:600 17px Inter,'Segoe UI',system-ui,sans-serif;fill:#3c4048}"
    "@media(prefers-color-scheme:dark){text{fill:#d5d7dc}}"
)
BLUR = '<filter id="soft" y="-80%" height="260%"><feGaussianBlur stdDeviation="2.2"/></filter>'


def pose_strip(
    path: str | Path,
    clips: Clip | Sequence[Clip],
    labels: Sequence[str] = (),
    times: Sequence[float] = (),
    count: int = 7,
    layout: Layout | None = None,
) -> None:
    """Write an SVG with one row for each clip and one pose for each time.

    `times` are seconds, the same for all rows; left out, `count` instants spread over each clip. Raises
    ValueError without clips, with labels or times that do not fit; OSError where it cannot be written.
    """
    clips = [clips] if isinstance(clips, Clip) else list(clips)
    check(clips, labels, times)
    save(path, strip(clips, labels, times, count, layout or Layout()))


def check(clips: Sequence[Clip], labels: Sequence[str], times: Sequence[float]) -> None:
    """ValueError without clips, or with labels or times that do not fit them."""
    if not clips:
        raise ValueError("the strip of poses got no clips; give at least one.")
    if labels and len(labels) != len(clips):
        raise ValueError(f"the strip of poses got {len(labels)} labels for {len(clips)} clips; give one for each.")
    for clip in clips:
        end = len(clip.euler) * clip.frame_time
        if any(not 0 <= time <= end for time in times):
            raise ValueError(f"the strip of poses got times {list(times)}, but a clip lasts from 0 to {end:.2f} s.")


def strip(clips: Sequence[Clip], labels: Sequence[str], times: Sequence[float], count: int, layout: Layout) -> str:
    """The SVG text of `pose_strip`."""
    columns, left = len(times) or count, layout.label if any(labels) else 0
    used: set[tuple[str, int]] = set()
    rows = []
    for number, clip in enumerate(clips):
        instants = times or [(k + 0.5) / count * len(clip.euler) * clip.frame_time for k in range(count)]
        y = (number + 0.93) * layout.height
        if left:
            text = html.escape(labels[number])
            rows.append(f'<text x="4" y="{(number + 0.55) * layout.height:.0f}">{text}</text>')
        for column, figure in enumerate(row(clip, instants, COLOURS[number % len(COLOURS)], layout, used)):
            rows.append(f'<g transform="translate({left + (column + 0.5) * layout.width:g} {y:g})">{figure}</g>')
    width, height = left + columns * layout.width, len(clips) * layout.height
    title = html.escape("Poses: " + ", ".join(labels) if labels else "A strip of poses")
    gradients = "".join(gradient(colour, bin_) for colour, bin_ in sorted(used))
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    head = f"<title>{title}</title><style>{STYLE}</style><defs>{gradients}{BLUR}</defs>"
    body = "".join(rows)
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img">{head}{body}</svg>\n'


def row(clip: Clip, instants: Sequence[float], colour: str, layout: Layout, used: set[tuple[str, int]]) -> list[str]:
    """One drawing for each instant, standing on y = 0 around x = 0."""
    staged = stage(clip, instants, layout)
    wear = WEAR | {shapes.TOP: colour}
    return [draw(pieces, staged.view, wear, used) for pieces in staged.poses]


def draw(pieces: Sequence[shapes.Piece], view: np.ndarray, wear: dict[int, str], used: set[tuple[str, int]]) -> str:
    """A shadow on the ground, then the pieces from far to near."""
    shadow = "".join(path_of(outline, 0) for outline in shadows(pieces, view))
    drawn = [f'<path d="{shadow}" fill="#14161c" opacity=".2" filter="url(#soft)"/>']
    for facet in facets(pieces, view):
        colour = wear[facet.tone]
        used.add((colour, facet.bin_))
        turn = 360.0 * facet.bin_ / BINS
        place = f"translate({facet.middle[0]:.1f} {facet.middle[1]:.1f})rotate({turn:g})"
        outline = path_of(facet.outline, 1)
        drawn.append(f'<path transform="{place}" d="{outline}" fill="url(#{name_of(colour, facet.bin_)})"/>')
    return "".join(drawn)


def path_of(points: np.ndarray, digits: int) -> str:
    """A closed path, every point relative to the one before."""
    whole = np.rint(points * 10**digits).astype(int)
    steps = np.diff(whole, axis=0)
    steps = steps[np.any(steps != 0, axis=1)]

    def short(value: int) -> str:
        return f"{value / 10**digits:g}"

    start, *rest = (f"{short(x)} {short(y)}" for x, y in (whole[0].tolist(), *steps.tolist()))
    return f"M{start}l{' '.join(rest)}z"


def gradient(colour: str, bin_: int) -> str:
    """The light across a limb as an SVG gradient."""
    stops = []
    for offset, rgb in zip(STOPS, lit(colour, bin_), strict=True):
        shade = "".join(f"{round(255 * c):02x}" for c in rgb)
        stops.append(f'<stop offset="{offset:g}" stop-color="#{shade}"/>')
    name = name_of(colour, bin_)
    return f'<linearGradient id="{name}" x2="0" y2="1">{"".join(stops)}</linearGradient>'


def name_of(colour: str, bin_: int) -> str:
    """Name of a gradient."""
    return f"g{colour[1:]}{bin_}"
