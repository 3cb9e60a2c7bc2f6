"""The rounded shapes a body is made of: ellipses strung on a line, each fixed to a joint, the ends rounded off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from zeggs_jax.stage.anatomy import Sample, unit

SKIN, TOP, LEGS, SHOES, DARK = range(5)
"""Tones: which colour a shape takes; the page and the strip of poses hold the colours themselves."""

Outline = Sequence[tuple[float, float]]  # (place along a limb, half-width as a share of the stature)


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
    """A shape between two ellipses fixed to one joint; a size is (half-width, half-depth, cap) or one radius."""
    bone = np.asarray(end) - np.asarray(start)
    length = float(np.linalg.norm(bone))
    along = unit(bone) if length > 1e-9 else unit(np.cross(side, [0.0, 1.0, 0.0]) + 1e-6)
    sizes = [(size,) * 3 if np.isscalar(size) else tuple(size) for size in (start_size, end_size)]
    slope = (sizes[1][0] - sizes[0][0]) / length if length > 1e-9 else 0.0
    side = across(np.asarray(side), along)
    return Part(
        tone, tuple(Station(joint, at, side, along, *size, slope) for at, size in zip((start, end), sizes, strict=True))
    )


def across(side: np.ndarray, along: np.ndarray) -> np.ndarray:
    """The direction nearest to `side` that is at right angles to `along`."""
    straight = side - along * (side @ along)
    if np.linalg.norm(straight) < 1e-3:
        straight = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    return unit(straight)


def measure(outline: Outline, place: float, scale: float) -> tuple[float, float]:
    """Half-width of an outline at a place, and its growth per unit of place, smoothed over its corners."""
    width = float(np.interp(place, *zip(*outline, strict=True)))
    before, after = np.interp([place - 0.05, place + 0.05], *zip(*outline, strict=True))
    return scale * width, scale * float(after - before) / 0.1


def places_along(knots: Sequence[float], low: float, high: float) -> list[float]:
    """The two ends and the corners of an outline between them."""
    return [low, *(knot for knot in knots if low + 0.02 < knot < high - 0.02), high]


def lowest(parts: Sequence[Part], sample: Sample) -> np.ndarray:
    """[F] world height of the lowest point of some shapes in every frame of a sample."""
    low = np.full(len(sample.pos), np.inf)
    for station in (station for part in parts for station in part.stations):
        height = sample.pos[:, station.joint, 1] + sample.mat[:, station.joint, 1] @ station.centre
        low = np.minimum(low, height - min(station.width, station.depth))
    return low


def rings(part: Part, mat: np.ndarray, pos: np.ndarray, around: int) -> np.ndarray:
    """[S, 3 * around, 3] points on the skin near every station in world, for joints at `mat [J, 3, 3]`, `pos [J, 3]`."""
    turn = 2.0 * np.pi * np.arange(around) / around
    found = []
    for k, s in enumerate(part.stations):
        end = (k == len(part.stations) - 1) - (k == 0)
        deep = np.cross(s.along, s.side)
        ring = np.cos(turn)[:, None] * s.side * s.width + np.sin(turn)[:, None] * deep * s.depth
        local = [s.centre + np.cos(a) * ring + end * np.sin(a) * s.cap * s.along for a in (0.0, 0.7, 1.3)]
        found.append(pos[s.joint] + np.concatenate(local) @ mat[s.joint].T)
    return np.stack(found)
