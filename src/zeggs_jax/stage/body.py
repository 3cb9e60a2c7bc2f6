"""A body for any skeleton: shapes fastened to its joints, thick where people are thick.

Thicknesses are shares of the stature, read off along each limb's own length: a skeleton with 22 joints and one with 83
come out equally stout.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.stage.anatomy import Anatomy, Limb, Sample, study, unit
from zeggs_jax.stage.extremities import foot, hand
from zeggs_jax.stage.shapes import (
    DARK,
    LEGS,
    SKIN,
    TOP,
    Outline,
    Part,
    Station,
    across,
    lowest,
    measure,
    pill,
    places_along,
)

# The place is 0 at the shoulder or hip, 1 at the elbow or knee, 2 at the end.
ARM = ((0.0, 0.0325), (0.35, 0.0285), (1.0, 0.0220), (1.25, 0.0240), (2.0, 0.0150))
LEG = ((0.0, 0.0515), (0.40, 0.0465), (1.0, 0.0315), (1.30, 0.0345), (2.0, 0.0210))
# The place is 0 at the pelvis, 0.89 at the height of the shoulders, 1 where the neck begins.
TRUNK_WIDTH = ((0.03, 0.0935), (0.1, 0.0915), (0.25, 0.0830), (0.4, 0.0785), (0.55, 0.0830), (0.7, 0.0895),
               (0.8, 0.0880), (0.88, 0.0750), (0.95, 0.0500), (1.0, 0.0375))  # fmt: skip
TRUNK_DEPTH = ((0.03, 0.0670), (0.1, 0.0660), (0.25, 0.0605), (0.4, 0.0580), (0.55, 0.0620), (0.7, 0.0670),
               (0.8, 0.0665), (0.88, 0.0600), (0.95, 0.0460), (1.0, 0.0380))  # fmt: skip
NECK = ((0.9, 0.0335), (1.0, 0.0320), (1.1, 0.0310))


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
        along = np.cumsum([0.0, *(np.linalg.norm(body.skeleton.offsets[j]) for j in joints[1:])])
        whole = max(float(along[-1]), 1e-9)
        for joint, child, a, b in zip(joints, joints[1:], along, along[1:], strict=False):
            if b - a < 1e-3 * body.stature:
                continue
            way = unit(body.skeleton.offsets[child])
            side = across(body.left[joint], way)
            stations = []
            for place in places_along([p for p, _ in outline], first + a / whole, first + b / whole):
                width, growth = measure(outline, place, body.stature)
                at = way * ((place - first) * whole - a)
                stations.append(Station(joint, at, side, way, width, width, width, growth / whole))
            yield Part(tone, tuple(stations))


def spine_places(body: Anatomy) -> np.ndarray:
    """The place of every joint of the spine, scaled so that the shoulders sit where the shoulders are."""
    along = np.cumsum([0.0, *(np.linalg.norm(body.skeleton.offsets[j]) for j in body.spine[1:])])
    arms = [body.limbs[role] for role in ("left_hand", "right_hand")]
    shoulders = np.mean([body.sample.seen_from(body.spine[0], arm.joints[arm.start]) for arm in arms], axis=0)
    return 0.89 * along / float(np.clip(np.linalg.norm(shoulders), 0.15 * body.stature, 0.4 * body.stature))


def spine(body: Anatomy) -> Iterator[Part]:
    """Trunk and neck: one skin each, whose ellipses turn with the joints they sit on."""
    places = spine_places(body)
    for (width_of, depth_of), tone, cap in (((TRUNK_WIDTH, TRUNK_DEPTH), TOP, 0.45), ((NECK, NECK), SKIN, 1.0)):
        first, last = width_of[0][0], 1.0 if tone == TOP else places[-1]
        stations = []
        for joint, child, a, b in zip(body.spine, body.spine[1:], places, places[1:], strict=False):
            low, high = max(a, first), min(b, last)
            if b - a < 1e-3 or high - low < 1e-3:
                continue
            ends = places_along([p for p, _ in width_of], low, high)
            for place in ends if high == last else ends[:-1]:  # the last ellipse of a bone is the next one's first
                width, growth = measure(width_of, place, body.stature)
                depth, _ = measure(depth_of, place, body.stature)
                at, up = body.skeleton.offsets[child] * (place - a) / (b - a), body.up[joint]
                slope = growth * (b - a) / float(np.linalg.norm(body.skeleton.offsets[child]))
                stations.append(Station(joint, at, across(body.left[joint], up), up, width, depth, cap * depth, slope))
        if len(stations) > 1:
            yield Part(tone, tuple(stations))


def pelvis(body: Anatomy) -> Part:
    """Trousers between the legs, under the hem of the top."""
    joint, size = body.spine[0], body.stature
    legs = [body.limbs[role] for role in ("left_foot", "right_foot")]
    hips = [body.sample.seen_from(joint, leg.joints[leg.start]) for leg in legs]
    middle, half = np.mean(hips, axis=0), 0.5 * float(np.linalg.norm(hips[0] - hips[1]))
    low, high = middle - 0.005 * size * body.front[joint], middle + 0.04 * size * body.up[joint]
    return pill(joint, LEGS, low, high, body.left[joint], (half + 0.018 * size, 0.057 * size, 0.042 * size),
                (0.086 * size, 0.060 * size, 0.03 * size))  # fmt: skip


def collar(body: Anatomy, arm: Limb) -> Part:
    """From beside the neck down to the shoulder joint, moving with the collar bone where there is one."""
    first, size = arm.joints[0], body.stature
    base = first if arm.start else body.skeleton.parents[first]
    shoulder = body.sample.seen_from(base, arm.joints[arm.start])
    neck_joint = next((j for j, place in zip(body.spine, spine_places(body), strict=True) if place > 0.9), body.spine[-1])
    neck = body.sample.seen_from(base, neck_joint)
    return pill(base, TOP, neck + 0.36 * (shoulder - neck), shoulder, body.front[base], 0.0355 * size, 0.0335 * size)


def head(body: Anatomy) -> Iterator[Part]:
    """Skull, jaw, nose, eyes and ears: enough to see where the character looks."""
    joint, size = body.spine[-1], body.stature
    axes = size * np.stack([body.left[joint], body.up[joint], body.front[joint]])

    def shape(tone, start, end, start_size, end_size):
        sizes = [tuple(size * s for s in measures) for measures in (start_size, end_size)]
        return pill(joint, tone, np.array(start) @ axes, np.array(end) @ axes, body.left[joint], *sizes)

    yield shape(SKIN, (0, 0.028, 0.002), (0, 0.047, 0.001), (0.0435, 0.053, 0.043), (0.0425, 0.052, 0.040))
    yield shape(SKIN, (0, 0.014, 0.020), (0, -0.026, 0.032), (0.036, 0.036, 0.03), (0.0205, 0.0195, 0.015))
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
