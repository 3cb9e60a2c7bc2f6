"""A small body and a clip of it: mixed Euler orders, positions on every joint, smooth motion."""

import numpy as np
import pytest

from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.skeleton import Skeleton

NAMES = (
    "Hips",
    "Spine",
    "Spine2",
    "Head",
    "LeftArm",
    "LeftHand",
    "RightArm",
    "RightHand",
    "LeftFoot",
    "RightFoot",
)
PARENTS = (-1, 0, 1, 2, 2, 4, 2, 6, 0, 0)
OFFSETS = [
    *([0, 90, 0], [0, 10, -2], [0, 20, 1], [0, 25, 2]),
    *([15, 12, 0], [28, -3, 1], [-15, 12, 0], [-28, -3, 1]),
    *([10, -80, 3], [-10, -80, 3]),
]


@pytest.fixture
def skeleton() -> Skeleton:
    return Skeleton(NAMES, PARENTS, np.array(OFFSETS, float))


def smooth(rng: np.random.Generator, frames: int, *shape: int) -> np.ndarray:
    """A few slow sines per component."""
    t = np.arange(frames).reshape(-1, *(1 for _ in shape)) / 60
    return sum(
        rng.normal(size=shape) * np.sin(rng.uniform(0.5, 6, shape) * t + rng.uniform(0, 6, shape)) for _ in range(3)
    )


@pytest.fixture
def clip(skeleton) -> Clip:
    """60 frames at 60 a second, walking about and turning; only the root changes its position."""
    rng = np.random.default_rng(0)
    frames, joints = 60, len(NAMES)
    positions = np.tile(skeleton.offsets, (frames, 1, 1))
    positions[:, 0] += smooth(rng, frames, 3) * [20, 2, 20]
    euler = 0.4 * smooth(rng, frames, joints, 3)
    orders = tuple(("zyx", "yxz", "xzy")[joint % 3] for joint in range(joints))
    euler[:, 0] = np.linspace(0, 5, frames)[:, None] * [0, 1, 0] + 0.1 * euler[:, 0]  # zyx: turns about y
    return Clip(skeleton, orders, euler, positions, 0.016667)
