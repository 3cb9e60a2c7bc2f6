"""Hands with the fingers a skeleton has, and feet whose soles lie flat on the ground when the foot does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from zeggs_jax.stage.anatomy import Anatomy, Limb, unit
from zeggs_jax.stage.shapes import SHOES, SKIN, Part, across, pill


def hand(body: Anatomy, arm: Limb) -> Iterator[Part]:
    """A palm and its fingers; a mitten where the skeleton has no fingers."""
    joint, size, skeleton = arm.joints[-1], body.stature, body.skeleton
    bases = [child for child, parent in enumerate(skeleton.parents) if parent == joint]
    bases = [base for base in bases if np.linalg.norm(skeleton.offsets[base]) > 0.005 * size]
    chains = [finger(skeleton.parents, base) for base in bases]
    thumbs = [chain for chain in chains if "thumb" in skeleton.names[chain[0]].lower()]
    fingers = [chain for chain in chains if chain not in thumbs]
    if len(fingers) < 3:
        yield from mitten(body, arm)
        return
    knuckles = np.stack([skeleton.offsets[chain[0]] for chain in fingers])
    reach, spread = knuckles.mean(axis=0), knuckles - knuckles.mean(axis=0)
    side = unit(spread[np.argmax(np.linalg.norm(spread, axis=1))])
    half = 0.5 * float(np.ptp(spread @ side)) + 0.0055 * size
    wrist, end = (0.0175 * size, 0.013 * size, 0.012 * size), (half, 0.0085 * size, 0.008 * size)
    yield pill(joint, SKIN, 0.12 * reach, 0.93 * reach, side, wrist, end)
    tipped = min(len(chain) for chain in fingers) >= 4
    for chain in fingers:
        yield from digit(body, chain, 0.0056, 0.0043, tipped)
    for chain in thumbs:
        base = skeleton.offsets[chain[0]]
        yield pill(joint, SKIN, 0.35 * base, base, side, 0.012 * size, 0.0085 * size)
        yield from digit(body, chain, 0.0078, 0.0055, tipped)


def finger(parents: Sequence[int], joint: int) -> list[int]:
    """The joints of one finger, from its base to its tip."""
    chain = [joint]
    while following := [child for child, parent in enumerate(parents) if parent == chain[-1]]:
        chain.append(following[0])
    return chain


def digit(body: Anatomy, chain: Sequence[int], thick: float, thin: float, tipped: bool) -> Iterator[Part]:
    """The bones of one finger; a last one is added where the skeleton stops at the last knuckle."""
    offsets, size = body.skeleton.offsets, body.stature
    bones = [(parent, offsets[child]) for parent, child in pairwise(chain)]
    if not tipped:
        bones.append((chain[-1], 0.8 * (offsets[chain[-1]] if len(chain) > 1 else 0.4 * offsets[chain[0]])))
    radius = size * np.linspace(thick, thin, len(bones) + 1)
    for (joint, bone), start, end in zip(bones, radius[:-1], radius[1:], strict=True):
        if np.linalg.norm(bone) > 1e-3 * size:
            yield pill(joint, SKIN, np.zeros(3), bone, body.front[joint], float(start), float(end))


def mitten(body: Anatomy, arm: Limb) -> Iterator[Part]:
    """A hand without finger joints: palm, closed fingers and a thumb towards the front."""
    joint, size = arm.joints[-1], body.stature
    along = unit(-body.sample.seen_from(joint, arm.joints[arm.middle]))
    side = across(body.front[joint], along)
    wrist, palm = size * np.array([0.0165, 0.0135, 0.012]), size * np.array([0.023, 0.0115, 0.011])
    tip = size * np.array([0.0145, 0.0075, 0.009])
    yield pill(joint, SKIN, 0.006 * size * along, 0.05 * size * along, side, wrist, palm)
    yield pill(joint, SKIN, 0.05 * size * along, 0.092 * size * along, side, palm, tip)
    thumb = (along * 0.018 + side * 0.016) * size, (along * 0.048 + side * 0.034) * size
    yield pill(joint, SKIN, *thumb, side, 0.0115 * size, 0.0068 * size)


def foot(body: Anatomy, ankle: int) -> Iterator[Part]:
    """A shoe; the frames in which the foot is lowest say which way is down, however its ankle is turned."""
    size, sample, offsets = body.stature, body.sample, body.skeleton.offsets
    below = [joint for joint, parent in enumerate(body.skeleton.parents) if parent == ankle]
    toe = next((joint for joint in below if np.linalg.norm(offsets[joint]) > 0.03 * size), None)
    height = sample.pos[:, ankle, 1] + sample.pos[:, ankle if toe is None else toe, 1]
    planted = height <= np.quantile(height, 0.3)
    down_world = np.broadcast_to([0.0, -1.0, 0.0], sample.pos[:, 0].shape)
    down = unit(sample.into(ankle, down_world, planted))
    ahead = 0.085 * size * body.front[ankle] if toe is None else offsets[toe]
    forward = across(ahead, down)
    ball = float(np.clip(ahead @ forward, 0.06 * size, 0.11 * size))
    drop = 0.048 * size if toe is None else float(np.clip(ahead @ down + 0.0135 * size, 0.036 * size, 0.075 * size))
    side = np.cross(down, forward)

    def at(ahead: float, below: float) -> np.ndarray:
        return forward * ahead + down * below

    shin, instep = 0.0225 * size, size * np.array([0.0215, 0.018, 0.016])
    heel, sole = size * np.array([0.0205, 0.0165, 0.018]), size * np.array([0.0265, 0.0135, 0.014])
    tip, level = size * np.array([0.0215, 0.0115, 0.018]), drop - 0.0135 * size
    yield pill(ankle, SHOES, at(0.0, 0.1 * drop), at(0.7 * ball, drop - 0.024 * size), side, shin, instep)
    yield pill(ankle, SHOES, at(-0.016 * size, drop - 0.0165 * size), at(ball, level), side, heel, sole)
    if toe is None:
        yield pill(ankle, SHOES, at(ball, level), at(ball + 0.032 * size, level + 0.002 * size), side, sole, tip)
        return
    toe_down = unit(sample.into(toe, down_world, planted))
    ahead_world = sample.mat[:, ankle] @ forward
    toe_forward = across(sample.into(toe, ahead_world, planted), toe_down)
    low = toe_down * np.clip(level - ahead @ down, 0.0, 0.02 * size)
    yield pill(toe, SHOES, low, low + toe_forward * 0.032 * size, np.cross(toe_down, toe_forward), sole, tip)
