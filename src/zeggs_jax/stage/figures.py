"""Pictures of motion: a strip of poses as SVG, instants side by side and clips one below the other."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from zeggs_jax.motion.bvh import Clip
from zeggs_jax.stage import anatomy, body, shapes
from zeggs_jax.stage.player import COLOURS, save

WEAR = {
    shapes.SKIN: "#ddb294",
    shapes.LEGS: "#555b66",
    shapes.SHOES: "#3a3d44",
    shapes.DARK: "#26272b",
    shapes.HAIR: "#4b3f39",
}
LAMP = np.array([-0.45, 0.72, 0.53])  # right, up, towards the eye
BINS = 24
STYLE = (
    "text{font:600 17px Inter,'Segoe UI',system-ui,sans-serif;fill:#3c4048}"
    "@media(prefers-color-scheme:dark){text{fill:#d5d7dc}}"
)
BLUR = '<filter id="soft" y="-80%" height="260%"><feGaussianBlur stdDeviation="2.2"/></filter>'


class Layout(NamedTuple):
    """Sizes of the strip in pixels, and the camera."""

    height: int = 230  # of one row
    width: int = 150  # of one pose
    label: int = 96  # of the column of labels
    yaw: float = 0.45  # radians, 0 sees the character from the front
    pitch: float = 0.10


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
    if not clips:
        raise ValueError("the strip of poses got no clips; give at least one.")
    if labels and len(labels) != len(clips):
        raise ValueError(f"the strip of poses got {len(labels)} labels for {len(clips)} clips; give one for each.")
    for clip in clips:
        end = len(clip.euler) * clip.frame_time
        if any(not 0 <= time <= end for time in times):
            raise ValueError(f"the strip of poses got times {list(times)}, but a clip lasts from 0 to {end:.2f} s.")
    save(path, strip(clips, labels, times, count, layout or Layout()))


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
    frames = [min(round(time / clip.frame_time), len(clip.euler) - 1) for time in instants]
    sample = anatomy.world(clip, np.linspace(0, len(clip.euler) - 1, 96).round().astype(int))
    dressed = body.dress(anatomy.at_rest(clip), sample)
    tall = max(float(np.quantile(sample.pos[..., 1].max(axis=1), 0.98)) - dressed.floor, dressed.stature)
    scale = 0.83 * layout.height / max(tall + 0.03 * dressed.stature, 1.02 * dressed.stature)
    shown = anatomy.world(clip, frames)
    view = camera(dressed.facing + layout.yaw, layout.pitch)
    wear = WEAR | {shapes.TOP: colour}
    figures = []
    for pos, mat in zip(shown.pos, shown.mat, strict=True):
        origin = np.array([pos[dressed.centre, 0], dressed.floor, pos[dressed.centre, 2]])
        figures.append(draw(shapes.pieces(dressed.parts, pos - origin, mat), scale * view, wear, used))
    return figures


def camera(yaw: float, pitch: float) -> np.ndarray:
    """[3, 3] world -> (right, up, towards the eye), for an eye at a heading (radians) far away."""
    back = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    right = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
    return np.stack([right, np.cross(back, right), back])


def draw(pieces: Sequence[shapes.Piece], view: np.ndarray, wear: dict[int, str], used: set[tuple[str, int]]) -> str:
    """A shadow on the ground, then the pieces from far to near."""
    lamp = view.T @ LAMP
    shadow = []
    for piece in pieces:
        if np.ptp(piece.points, axis=0).max() * np.linalg.norm(view[0]) > 7.0:
            fallen = piece.points - lamp * (piece.points[:, 1:2] / lamp[1])
            shadow.append(path_of(shapes.hull(on_paper(fallen, view)), 0))
    drawn = [f'<path d="{"".join(shadow)}" fill="#14161c" opacity=".2" filter="url(#soft)"/>']
    for piece in sorted(pieces, key=lambda piece: float(piece.ends.mean(axis=0) @ view[2])):
        colour = wear[piece.tone]
        points, ends = (on_paper(x, view) for x in (piece.points, piece.ends))
        along = ends[1] - ends[0]
        angle = float(np.arctan2(along[1], along[0])) if np.linalg.norm(along) > 0.05 else np.pi / 2
        bin_ = round(angle / (2.0 * np.pi) * BINS) % BINS
        angle = 2.0 * np.pi * bin_ / BINS
        used.add((colour, bin_))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        middle = ends.mean(axis=0)
        outline = path_of(shapes.hull((points - middle) @ turn), 1)
        place = f"translate({middle[0]:.1f} {middle[1]:.1f})rotate({np.degrees(angle):g})"
        drawn.append(f'<path transform="{place}" d="{outline}" fill="url(#{name_of(colour, bin_)})"/>')
    return "".join(drawn)


def on_paper(points: np.ndarray, view: np.ndarray) -> np.ndarray:
    """World points [n, 3] -> right and down on the paper [n, 2]."""
    return (points @ view.T)[:, :2] * [1.0, -1.0]


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
    """Light across a limb at an angle on the paper: the lamp shines from the upper left, in front."""
    angle = 2.0 * np.pi * bin_ / BINS
    across = np.array([-np.sin(angle), -np.cos(angle), 0.0])  # what points down the unrotated paper
    base = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    stops = []
    for offset in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        s = 0.97 * (2.0 * offset - 1.0)
        normal = s * across + np.sqrt(1.0 - s * s) * np.array([0.0, 0.0, 1.0])
        light = 0.30 + 0.12 * normal[1] + 0.78 * max(float(normal @ LAMP), 0.0)
        rgb = np.clip(np.sqrt(base**2 * light), 0.0, 1.0)
        shade = "".join(f"{round(255 * c):02x}" for c in rgb)
        stops.append(f'<stop offset="{offset:g}" stop-color="#{shade}"/>')
    name = name_of(colour, bin_)
    return f'<linearGradient id="{name}" x2="0" y2="1">{"".join(stops)}</linearGradient>'


def name_of(colour: str, bin_: int) -> str:
    """Name of a gradient."""
    return f"g{colour[1:]}{bin_}"
