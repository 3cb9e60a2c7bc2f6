"""A small talking body with hands and feet, made here, for the tests of the stage."""

import numpy as np
import pytest

from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.skeleton import Skeleton

BONES = {
    "Hips": ("", (0, 92, 0)), "Spine": ("Hips", (0, 12, -1)), "Chest": ("Spine", (0, 22, 0)),
    "Neck": ("Chest", (0, 24, 1)), "Head": ("Neck", (0, 10, 1)),
    **{
        side + name: (parent if parent in ("Chest", "Hips") else side + parent, (x * sign, y, z))
        for side, sign in (("Left", 1), ("Right", -1))
        for name, parent, (x, y, z) in (
            ("Shoulder", "Chest", (3, 17, 0)), ("Arm", "Shoulder", (13, 0, 0)),
            ("ForeArm", "Arm", (28, 0, 0)),
            ("Hand", "ForeArm", (25, 0, 0)), ("HandThumb1", "Hand", (4, -2, 3)),
            ("HandThumb2", "HandThumb1", (3, 0, 2)),
            ("HandIndex1", "Hand", (9, 0, 2)), ("HandIndex2", "HandIndex1", (4, 0, 0)),
            ("HandMiddle1", "Hand", (9.5, 0, 0)), ("HandMiddle2", "HandMiddle1", (4, 0, 0)),
            ("HandPinky1", "Hand", (8, 0, -3)), ("HandPinky2", "HandPinky1", (3, 0, 0)),
            ("UpLeg", "Hips", (10, -3, 0)), ("Leg", "UpLeg", (0, -40, 0)), ("Foot", "Leg", (0, -41, -1)),
            ("ToeBase", "Foot", (0, -5, 14)),
        )
    },
}  # fmt: skip


def make_clip(frames: int = 60, frame_time: float = 1 / 30, bones=BONES) -> Clip:
    names = tuple(bones)
    parents = tuple(names.index(parent) if parent else -1 for parent, _ in bones.values())
    offsets = np.array([offset for _, offset in bones.values()], float)
    t = np.arange(frames)[:, None, None] * frame_time
    joint, axis = np.arange(len(names))[:, None], np.arange(3)
    euler = 0.25 * np.sin(2.0 * t * (1 + axis) + joint + axis)
    positions = np.tile(offsets, (frames, 1, 1))
    positions[:, 0, 0] += 30 * np.sin(t[:, 0, 0])
    return Clip(Skeleton(names, parents, offsets), ("zyx",) * len(names), euler, positions, frame_time)


@pytest.fixture(scope="session")
def clip() -> Clip:
    return make_clip()


@pytest.fixture(scope="session")
def foreign_clip() -> Clip:
    """A body whose joint names say nothing."""
    names = dict(zip(BONES, (f"n{k}" for k in range(len(BONES))), strict=True))
    return make_clip(20, bones={names[name]: (names.get(parent, ""), at) for name, (parent, at) in BONES.items()})


@pytest.fixture(scope="session")
def speech() -> tuple[np.ndarray, int]:
    t = np.arange(32000) / 16000
    return (0.3 * np.sin(2 * np.pi * 180 * t) * (1 + np.sin(9 * t)) / 2).astype(np.float32), 16000
