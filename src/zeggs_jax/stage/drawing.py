"""Bodies on paper: seen by a camera, cut into convex outlines from far to near, each lit across its limb."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from zeggs_jax.motion.bvh import Clip
from zeggs_jax.stage import anatomy, body, shapes

WEAR = {
    shapes.SKIN: "#ddb294",
    shapes.LEGS: "#555b66",
    shapes.SHOES: "#3a3d44",
    shapes.DARK: "#26272b",
    shapes.HAIR: "#4b3f39",
}
LAMP = np.array([-0.45, 0.72, 0.53])  # right, up, towards the eye
BINS = 24
STOPS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)


class Layout(NamedTuple):
    """Sizes of the strip in pixels, and the camera."""

    height: int = 230  # of one row
    width: int = 150  # of one pose
    label: int = 96  # of the column of labels
    yaw: float = 0.45  # radians, 0 sees the character from the front
    pitch: float = 0.10


class Staged(NamedTuple):
    """Bodies at some instants, each over the origin, and the camera that looks at them."""

    poses: list[list[shapes.Piece]]
    view: np.ndarray  # [3, 3] world -> paper (right, up) and towards the eye, in the layout's units


def stage(clip: Clip, instants: Sequence[float], layout: Layout) -> Staged:
    """The bodies of a clip at instants in seconds, as tall as the layout's rows allow."""
    frames = [min(round(time / clip.frame_time), len(clip.euler) - 1) for time in instants]
    sample = anatomy.world(clip, np.linspace(0, len(clip.euler) - 1, 96).round().astype(int))
    dressed = body.dress(anatomy.at_rest(clip), sample)
    tall = max(float(np.quantile(sample.pos[..., 1].max(axis=1), 0.98)) - dressed.floor, dressed.stature)
    scale = 0.83 * layout.height / max(tall + 0.03 * dressed.stature, 1.02 * dressed.stature)
    shown = anatomy.world(clip, frames)
    poses = []
    for pos, mat in zip(shown.pos, shown.mat, strict=True):
        origin = np.array([pos[dressed.centre, 0], dressed.floor, pos[dressed.centre, 2]])
        poses.append(shapes.pieces(dressed.parts, pos - origin, mat))
    return Staged(poses, scale * camera(dressed.facing + layout.yaw, layout.pitch))


def camera(yaw: float, pitch: float) -> np.ndarray:
    """[3, 3] world -> (right, up, towards the eye), for an eye at a heading (radians) far away."""
    back = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    right = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
    return np.stack([right, np.cross(back, right), back])


class Facet(NamedTuple):
    """The outline of one piece on the paper, in a frame whose x axis runs along the limb."""

    tone: int
    middle: np.ndarray  # [2] on the paper, right and down
    bin_: int  # the limb's angle on the paper in turns / BINS, for its light
    outline: np.ndarray  # [n, 2] convex


def facets(pieces: Sequence[shapes.Piece], view: np.ndarray) -> list[Facet]:
    """The outlines of all pieces, from far to near."""
    found = []
    for piece in sorted(pieces, key=lambda piece: float(piece.ends.mean(axis=0) @ view[2])):
        points, ends = (on_paper(x, view) for x in (piece.points, piece.ends))
        along, middle = ends[1] - ends[0], ends.mean(axis=0)
        angle = float(np.arctan2(along[1], along[0])) if np.linalg.norm(along) > 0.05 else np.pi / 2
        bin_ = round(angle / (2.0 * np.pi) * BINS) % BINS
        found.append(Facet(piece.tone, middle, bin_, shapes.hull((points - middle) @ turned(bin_))))
    return found


def turned(bin_: int) -> np.ndarray:
    """[2, 2] rotation of the paper by a bin's angle; rows times this are turned back."""
    angle = 2.0 * np.pi * bin_ / BINS
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def shadows(pieces: Sequence[shapes.Piece], view: np.ndarray) -> list[np.ndarray]:
    """[n, 2] outlines on the paper of what the larger pieces throw on the ground."""
    lamp, least = view.T @ LAMP, 7.0 / np.linalg.norm(view[0])
    large = (piece.points for piece in pieces if np.ptp(piece.points, axis=0).max() > least)
    return [shapes.hull(on_paper(points - lamp * (points[:, 1:2] / lamp[1]), view)) for points in large]


def on_paper(points: np.ndarray, view: np.ndarray) -> np.ndarray:
    """World points [n, 3] -> right and down on the paper [n, 2]."""
    return (points @ view.T)[:, :2] * [1.0, -1.0]


def lit(colour: str, bin_: int) -> np.ndarray:
    """[S, 3] colours from 0 to 1 at STOPS across a limb at an angle: the lamp shines from the upper left, in front."""
    angle = 2.0 * np.pi * bin_ / BINS
    across = np.array([-np.sin(angle), -np.cos(angle), 0.0])  # what points down the unrotated paper
    base = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    s = 0.97 * (2.0 * np.array(STOPS)[:, None] - 1.0)
    normal = s * across + np.sqrt(1.0 - s * s) * np.array([0.0, 0.0, 1.0])
    light = 0.30 + 0.12 * normal[:, 1] + 0.78 * np.maximum(normal @ LAMP, 0.0)
    return np.clip(np.sqrt(base**2 * light[:, None]), 0.0, 1.0)
