"""A small body that gestures by formulas of time, so that any rate shows the same motion; and ways to damage it."""

from collections.abc import Callable

import numpy as np
import pytest

from zeggs_jax.metrics.movement import Movement
from zeggs_jax.motion.skeleton import Skeleton

REST = {
    "Hips": ("", (0.0, 90.0, 0.0)),
    "Spine2": ("Hips", (0.0, 130.0, 0.0)),
    "Head": ("Spine2", (0.0, 160.0, 0.0)),
    "LeftArm": ("Spine2", (18.0, 140.0, 0.0)),
    "LeftForeArm": ("LeftArm", (25.0, 115.0, 5.0)),
    "LeftHand": ("LeftForeArm", (22.0, 105.0, 25.0)),
    "LeftHandIndex": ("LeftHand", (21.0, 105.0, 40.0)),
    "RightArm": ("Spine2", (-18.0, 140.0, 0.0)),
    "RightForeArm": ("RightArm", (-25.0, 115.0, 5.0)),
    "RightHand": ("RightForeArm", (-22.0, 105.0, 25.0)),
    "LeftLeg": ("Hips", (10.0, 50.0, 2.0)),
    "LeftFoot": ("LeftLeg", (10.0, 8.0, 0.0)),
    "LeftToe": ("LeftFoot", (11.0, 2.0, 12.0)),
    "RightLeg": ("Hips", (-10.0, 50.0, 2.0)),
    "RightFoot": ("RightLeg", (-10.0, 8.0, 0.0)),
    "RightToe": ("RightFoot", (-11.0, 2.0, 12.0)),
}
NAMES = tuple(REST)
PLACES = np.array([place for _, place in REST.values()])
SKELETON = Skeleton(NAMES, tuple(NAMES.index(p) if p else -1 for p, _ in REST.values()), PLACES)
REACH = np.array([{"RightHand": 1.0, "RightForeArm": 0.4, "LeftHand": 0.5, "LeftForeArm": 0.2, "LeftHandIndex": 0.5,
                   "Head": 0.08, "Spine2": 0.05, "Hips": 0.03}.get(name, 0.0) for name in NAMES])  # fmt: skip


def perform(seed: int = 0, seconds: float = 8.0, rate_hz: float = 30.0, size: float = 12.0) -> Movement:
    """Smooth gestures, the right hand's twice as large as the left's, on planted feet; below 2 Hz."""
    draw = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    pitch, phase = draw.uniform(0.3, 1.9, (6, len(NAMES), 3)), draw.uniform(0.0, 2.0 * np.pi, (6, len(NAMES), 3))
    waves = np.sin(2.0 * np.pi * time[:, None, None, None] * pitch + phase).mean(axis=1)
    return Movement(PLACES + size * 2.0 * REACH[:, None] * waves, rate_hz, SKELETON)


def trembling(motion: Movement, size: float, seed: int = 5) -> Movement:
    """With noise of `size` cm on every joint and frame."""
    noise = np.random.default_rng(seed).normal(scale=size, size=motion.positions.shape)
    return motion._replace(positions=motion.positions + noise)


def late(motion: Movement, seconds: float) -> Movement:
    """Moved in a circle by `seconds`."""
    return motion._replace(positions=np.roll(motion.positions, round(seconds * motion.rate_hz), axis=0))


def mirrored(motion: Movement) -> Movement:
    """Left and right exchanged."""
    swap = {name: name.replace("Left", "?").replace("Right", "Left").replace("?", "Right") for name in NAMES}
    across = [NAMES.index(swap[name]) if swap[name] in NAMES else k for k, name in enumerate(NAMES)]
    return motion._replace(positions=motion.positions[:, across] * np.array([-1.0, 1.0, 1.0]))


def frozen(motion: Movement) -> Movement:
    """The first frame throughout."""
    return motion._replace(positions=np.repeat(motion.positions[:1], len(motion.positions), axis=0))


def mean_pose(motion: Movement) -> Movement:
    """The clip's mean throughout."""
    mean = motion.positions.mean(axis=0, keepdims=True)
    return motion._replace(positions=np.repeat(mean, len(motion.positions), axis=0))


DAMAGE: dict[str, Callable[..., Movement]] = {
    "trembling": trembling, "late": late, "mirrored": mirrored, "frozen": frozen, "mean_pose": mean_pose,
}  # fmt: skip


@pytest.fixture(scope="session")
def gesture() -> Callable[..., Movement]:
    return perform


@pytest.fixture(scope="session")
def damage() -> dict[str, Callable[..., Movement]]:
    return DAMAGE
