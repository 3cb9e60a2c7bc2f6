"""A body for any skeleton: shapes fastened to its joints, thick where people are thick.

Thicknesses are shares of the stature, read off along each limb's own length: a skeleton with 22 joints and
one with 83 come out equally stout.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.stage.anatomy import Anatomy, Limb, Sample, study, unit
from zeggs_jax.stage.extremities import foot, hand
from zeggs_jax.stage.shapes import (
    DARK,
    HAIR,
    LEGS,
    SKIN,
    TOP,
    Outline,
    Part,
    Station,
    across,
    lowest,
    pill,
    places_along,
)

# The place is 0 at the shoulder or hip, 1 at the elbow or knee, 2 at the end.
ARM = Outline((0.0, 0.35, 1.0, 1.25, 2.0), (0.0325, 0.0285, 0.0220, 0.0240, 0.0150))
LEG = Outline((0.0, 0.40, 1.0, 1.30, 2.0), (0.0485, 0.0460, 0.0315, 0.0345, 0.0210))
# The place is 0 at the pelvis, 0.89 at the height of the shoulders, 1 where the neck begins.
HEIGHTS = (0.03, 0.1, 0.25, 0.4, 0.55, 0.7, 0.8, 0.88, 0.95, 1.0)
TRUNK_WIDTH = Outline(HEIGHTS, (0.0935, 0.0915, 0.083, 0.0785, 0.083, 0.0895, 0.088, 0.075, 0.050, 0.0375))
TRUNK_DEPTH = Outline(HEIGHTS, (0.0670, 0.0660, 0.0605, 0.058, 0.062, 0.067, 0.0665, 0.060, 0.046, 0.038))
NECK = Outline((0.9, 1.0, 1.1), (0.0335, 0.0320, 0.0310))


class Body(NamedTuple):
    """The shapes of one body and its measures, in the skeleton's length unit."""

    parts: tuple[Part, ...]
    stature: float
    floor: float  # world height of the ground under the soles
    facing: float  # mean heading about world y, radians; 0 looks along +z
    centre: int  # the joint that a camera follows


def dress(skeleton: Skeleton, sample: Sample) -> Body:
    """Shapes for a skeleton; where hands, feet and head are not known by name, plain bones."""
    body = study(skeleton, sample)
    parts = tuple(figure(body) if body.limbs else sticks(body))
    floor = float(np.quantile(lowest(parts, sample), 0.03)) if parts else 0.0
    return Body(parts, body.stature, floor, body.facing, body.spine[0] if body.spine else 0)


def figure(body: Anatomy) -> Iterator[Part]:
    """All shapes of a recognised body."""
    yield pelvis(body)
    yield from spine(body)
    yield from head(body)
    for side in ("left", "right"):
        arm, leg = body.limbs[f"{side}_hand"], body.limbs[f"{side}_foot"]
        yield collar(body, arm)
        yield from limb(body, arm, ARM, TOP)
        yield from hand(body, arm)
        yield from limb(body, leg, LEG, LEGS)
        yield from foot(body, leg.joints[-1])


def limb(body: Anatomy, chain: Limb, outline: Outline, tone: int) -> Iterator[Part]:
    """Round shapes along an arm or leg; twist joints on the way do not change its outline."""
    upper, lower = chain.joints[chain.start : chain.middle + 1], chain.joints[chain.middle :]
    for joints, first in ((upper, 0.0), (lower, 1.0)):
        along = lengths_along(body, joints)
        whole = max(float(along[-1]), 1e-9)
        for (joint, child), (a, b) in zip(pairwise(joints), pairwise(along), strict=True):
            if b - a < 1e-3 * body.stature:
                continue
            way = unit(body.skeleton.offsets[child])
            side = across(body.left[joint], way)
            stations = []
            for place in places_along(first + a / whole, first + b / whole, 0.25):
                width, growth = outline.at(place, body.stature)
                at = way * ((place - first) * whole - a)
                stations.append(Station(joint, at, side, way, width, width, width, growth / whole))
            yield Part(tone, tuple(stations))


def lengths_along(body: Anatomy, joints: Sequence[int]) -> np.ndarray:
    """The way along the bones from the first of some joints to each of them."""
    bones = np.linalg.norm(body.skeleton.offsets[list(joints[1:])], axis=1)
    return np.concatenate([[0.0], np.cumsum(bones)])


def spine_places(body: Anatomy) -> tuple[np.ndarray, float]:
    """The place of every joint of the spine, fitted to the shoulders' height; the length of one place."""
    along = lengths_along(body, body.spine)
    shoulders, _ = middle_of(body, "left_hand", "right_hand")
    unit_length = float(np.clip(np.linalg.norm(shoulders), 0.15 * body.stature, 0.4 * body.stature)) / 0.89
    return along / unit_length, unit_length


def middle_of(body: Anatomy, *roles: str) -> tuple[np.ndarray, float]:
    """The middle [3] between both shoulders or hips in the pelvis' frame, and how far they are from it."""
    limbs = [body.limbs[role] for role in roles]
    one, other = (body.sample.seen_from(body.spine[0], limb.joints[limb.start]) for limb in limbs)
    return 0.5 * (one + other), 0.5 * float(np.linalg.norm(one - other))


def spine(body: Anatomy) -> Iterator[Part]:
    """Trunk and neck: one skin each, whose ellipses turn with the joints they sit on."""
    places, length = spine_places(body)
    hips, half = middle_of(body, "left_foot", "right_foot")
    hem = float(np.clip((hips @ body.up[body.spine[0]] + 0.030 * body.stature) / length, 0.0, 0.3))
    wider = max(0.0, (half / body.stature + 0.036) / 0.092 - 1.0)  # over hips that stand wide apart
    for (width_of, depth_of), tone, cap, first, last in (
        ((TRUNK_WIDTH, TRUNK_DEPTH), TOP, 0.4, hem, 1.0),
        ((NECK, NECK), SKIN, 0.3, 0.96, places[-1]),
    ):
        stations = []
        for (joint, child), (a, b) in zip(pairwise(body.spine), pairwise(places), strict=True):
            low, high = max(a, first), min(b, last)
            if b - a < 1e-3 or high - low < 1e-3:
                continue
            ends = places_along(low, high, 0.14)
            for place in ends if high == last else ends[:-1]:  # a bone's last is the next one's first
                width, growth = width_of.at(place, body.stature)
                depth, _ = depth_of.at(place, body.stature)
                width *= 1.0 + wider * max(0.0, 1.0 - place / 0.35)
                at, up = body.skeleton.offsets[child] * (place - a) / (b - a), body.up[joint]
                side = across(body.left[joint], up)
                stations.append(Station(joint, at, side, up, width, depth, cap * depth, growth / length))
        if len(stations) > 1:
            yield Part(tone, tuple(stations))


def pelvis(body: Anatomy) -> Part:
    """Trousers between the legs, under the hem of the top."""
    joint, size, up = body.spine[0], body.stature, body.up[body.spine[0]]
    middle, half = middle_of(body, "left_foot", "right_foot")
    bone = body.skeleton.offsets[body.spine[1]]
    waist = middle + 0.042 * size * up
    waist = bone * float(np.clip(waist @ up / max(bone @ up, 1e-6), 0.0, 1.0)) if waist @ up > 0 else waist
    low = middle + 0.004 * size * up - 0.004 * size * body.front[joint]
    return pill(joint, LEGS, low, waist, body.left[joint], (half + 0.018 * size, 0.056 * size, 0.042 * size),
                (0.082 * size, 0.056 * size, 0.02 * size))  # fmt: skip


def collar(body: Anatomy, arm: Limb) -> Part:
    """From beside the neck down to the shoulder joint, moving with the collar bone where there is one."""
    first, size = arm.joints[0], body.stature
    base = first if arm.start else body.skeleton.parents[first]
    shoulder = body.sample.seen_from(base, arm.joints[arm.start])
    places, length = spine_places(body)
    above = int(np.argmax(places > 0.9)) if places[-1] > 0.9 else len(places) - 1
    neck = body.sample.seen_from(base, body.spine[above]) - body.up[base] * (places[above] - 0.95) * length
    start = neck + 0.45 * (shoulder - neck)
    return pill(base, TOP, start, shoulder, body.front[base], 0.031 * size, 0.0335 * size)


def head(body: Anatomy) -> Iterator[Part]:
    """Skull, jaw, nose, eyes and ears: enough to see where the character looks."""
    joint, size = body.spine[-1], body.stature
    axes = size * np.stack([body.left[joint], body.up[joint], body.front[joint]])

    def shape(tone, start, end, start_size, end_size):
        sizes = [tuple(size * s for s in measures) for measures in (start_size, end_size)]
        return pill(joint, tone, np.array(start) @ axes, np.array(end) @ axes, body.left[joint], *sizes)

    yield shape(SKIN, (0, 0.028, 0.002), (0, 0.047, 0.001), (0.0435, 0.053, 0.043), (0.0425, 0.052, 0.040))
    yield shape(HAIR, (0, 0.030, -0.011), (0, 0.056, 0.0005), (0.0452, 0.0500, 0.034), (0.0445, 0.0530, 0.0375))
    yield shape(SKIN, (0, 0.016, 0.016), (0, -0.018, 0.026), (0.0375, 0.038, 0.03), (0.0255, 0.0235, 0.022))
    yield shape(SKIN, (0, 0.018, 0.055), (0, 0.002, 0.063), (0.0045, 0.005, 0.005), (0.0075, 0.007, 0.006))
    for x in (1, -1):
        eye, ear = 0.0175 * x, 0.0435 * x
        yield shape(DARK, (eye, 0.0215, 0.0475), (eye, 0.0245, 0.0475), (0.0058,) * 3, (0.0058,) * 3)
        yield shape(SKIN, (ear, 0.006, -0.004), (ear, 0.02, -0.008), (0.004, 0.008, 0.006), (0.0045, 0.0105, 0.007))


def sticks(body: Anatomy) -> Iterator[Part]:
    """Plain bones for a skeleton that is not recognised as a body."""
    for joint, parent in enumerate(body.skeleton.parents):
        bone = body.skeleton.offsets[joint]
        length = float(np.linalg.norm(bone))
        if parent >= 0 and length > 1e-3 * body.stature:
            radius = float(np.clip(0.12 * length, 0.005 * body.stature, 0.022 * body.stature))
            yield pill(parent, TOP, np.zeros(3), bone, np.eye(3)[np.argmin(np.abs(bone))], radius, 0.8 * radius)
