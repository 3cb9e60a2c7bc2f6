"""The rounded shapes of a body: ellipses strung on a line, each fixed to a joint, the ends rounded off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from zeggs_jax.stage.anatomy import Sample, unit

SKIN, TOP, LEGS, SHOES, DARK, HAIR = range(6)
"""Tones: which colour a shape takes; the page and the strip of poses hold the colours themselves."""


class Outline(NamedTuple):
    """Half-widths, as shares of the stature, at places along a limb."""

    places: tuple[float, ...]
    widths: tuple[float, ...]

    def at(self, place: float, scale: float) -> tuple[float, float]:
        """Half-width at a place, the corners smoothed, and its growth per unit of place."""
        near = np.linspace(-0.08, 0.08, 9)
        before, width, after = (
            float(np.mean(np.interp(near + x, self.places, self.widths))) for x in (place - 0.04, place, place + 0.04)
        )
        return scale * width, scale * (after - before) / 0.08


class Station(NamedTuple):
    """One ellipse of a shape, in the frame of its joint and the skeleton's length unit."""

    joint: int
    centre: np.ndarray  # [3]
    side: np.ndarray  # [3] the direction of its width
    along: np.ndarray  # [3] towards the next station
    width: float  # half of it
    depth: float  # half of it, across `side` and `along`
    cap: float  # height of the rounded end, used at the first and the last station
    slope: float  # growth of the half-width per length there, for the shading


class Part(NamedTuple):
    """One shape: a smooth skin over two or more ellipses, which may follow different joints."""

    tone: int
    stations: tuple[Station, ...]


def pill(joint: int, tone: int, start, end, side, start_size, end_size) -> Part:
    """A shape between two ellipses fixed to one joint; sizes are (width, depth, cap) or a radius."""
    bone = np.asarray(end) - np.asarray(start)
    length = float(np.linalg.norm(bone))
    along = unit(bone) if length > 1e-9 else unit(np.cross(side, [0.0, 1.0, 0.0]) + 1e-6)
    sizes = [np.broadcast_to(np.asarray(size, float), 3) for size in (start_size, end_size)]
    slope = float(sizes[1][0] - sizes[0][0]) / length if length > 1e-9 else 0.0
    side = across(np.asarray(side), along)
    ends = []
    for at, (width, depth, cap) in zip((start, end), sizes, strict=True):
        ends.append(Station(joint, np.asarray(at), side, along, float(width), float(depth), float(cap), slope))
    return Part(tone, tuple(ends))


def across(side: np.ndarray, along: np.ndarray) -> np.ndarray:
    """The direction nearest to `side` that is at right angles to `along`."""
    straight = side - along * (side @ along)
    if np.linalg.norm(straight) < 1e-3:
        straight = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    return unit(straight)


def places_along(low: float, high: float, step: float) -> list[float]:
    """Evenly spaced places from `low` to `high`, about `step` apart."""
    return np.linspace(low, high, max(2, round((high - low) / step) + 1)).tolist()


def lowest(parts: Sequence[Part], sample: Sample) -> np.ndarray:
    """[F] world height of the lowest point of some shapes in every frame of a sample."""
    low = np.full(len(sample.pos), np.inf)
    for station in (station for part in parts for station in part.stations):
        height = sample.pos[:, station.joint, 1] + sample.mat[:, station.joint, 1] @ station.centre
        low = np.minimum(low, height - min(station.width, station.depth))
    return low


class Piece(NamedTuple):
    """What lies between two neighbouring ellipses of a shape; its outline is the hull of its points."""

    tone: int
    ends: np.ndarray  # [2, 3] centres of the two ellipses, world
    points: np.ndarray  # [n, 3] points of the skin, world


def pieces(parts: Sequence[Part], pos: np.ndarray, mat: np.ndarray, around: int = 10) -> list[Piece]:
    """All shapes cut at their ellipses, for joints at `pos [J, 3]` turned by `mat [J, 3, 3]`."""
    found = []
    for part in parts:
        rings = [ring(part, k, around) for k in range(len(part.stations))]
        placed = [pos[s.joint] + r @ mat[s.joint].T for s, r in zip(part.stations, rings, strict=True)]
        centres = [pos[s.joint] + mat[s.joint] @ s.centre for s in part.stations]
        for k in range(len(placed) - 1):
            points = placed[k : k + 2]
            if k + 2 < len(placed):  # a little overlap hides the joint
                points.append(placed[k + 1] + 0.2 * (placed[k + 2][:around] - placed[k + 1]))
            found.append(Piece(part.tone, np.stack(centres[k : k + 2]), np.concatenate(points)))
    return found


def ring(part: Part, number: int, around: int) -> np.ndarray:
    """[n, 3] points on one ellipse of a shape, and on the rounded end if it has one."""
    s, turn = part.stations[number], 2.0 * np.pi * np.arange(around) / around
    deep = np.cross(s.along, s.side)
    ellipse = np.cos(turn)[:, None] * s.side * s.width + np.sin(turn)[:, None] * deep * s.depth
    end = (number == len(part.stations) - 1) - (number == 0)
    tilts = (0.0, 0.6, 1.15) if end else (0.0,)
    return np.concatenate([s.centre + np.cos(a) * ellipse + end * np.sin(a) * s.cap * s.along for a in tilts])


def hull(points: np.ndarray) -> np.ndarray:
    """Convex hull of points in the plane [n, 2], one way round."""
    order = points[np.lexsort((points[:, 1], points[:, 0]))].tolist()
    whole: list[list[float]] = []
    for way in (order, order[::-1]):
        half: list[list[float]] = []
        for x, y in way:
            while len(half) > 1:
                (ax, ay), (bx, by) = half[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                    break
                half.pop()
            half.append([x, y])
        whole += half[:-1]
    return np.array(whole or order[:1])
