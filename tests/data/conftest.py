"""A small corpus on disk: eight joints, smooth motion, noise for speech."""

from pathlib import Path

import numpy as np
import pytest

from zeggs_jax.data.prepare import Prepared, prepare
from zeggs_jax.motion import bvh
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.speech import wav

NAMES = ("Hips", "Spine", "Spine2", "Head", "LeftHand", "RightHand", "LeftFoot", "RightFoot")
PARENTS = (-1, 0, 1, 2, 2, 2, 0, 0)
OFFSETS = [[0, 95, 0], [0, 12, -2], [0, 25, 1], [0, 35, 2], [38, -9, 6], [-36, -10, 5], [9, -86, 3], [-10, -85, 2]]


def make_clip(frames: int, seed: int = 0, rate_hz: float = 60.0, names: tuple[str, ...] = NAMES) -> bvh.Clip:
    random = np.random.default_rng(seed)
    offsets = np.array(OFFSETS[: len(names)], float)
    time = np.arange(frames)[:, None, None] / rate_hz
    phase, speed = random.uniform(0, 6, (2, 1, len(names), 3))
    euler = 0.4 * np.sin(speed * time + phase)
    euler[:, 0, 0] += 1.0 + 0.2 * seed  # the release's channel order: z, y, x
    positions = np.repeat(offsets[None], frames, axis=0)
    positions[:, 0] += 10 * np.sin(time[:, :, 0])
    skeleton = Skeleton(names, PARENTS[: len(names)], offsets)
    return bvh.Clip(skeleton, ("yzx",) * len(names), euler, positions, round(1 / rate_hz, 6))


def add_pair(folder: Path, name: str, frames: int, seed: int = 0, rate_hz: float = 60.0) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    bvh.write(path.with_suffix(".bvh"), make_clip(frames, seed, rate_hz))
    noise = 0.1 * np.random.default_rng(seed).normal(size=round(frames / rate_hz * 16000))
    wav.write(path.with_suffix(".wav"), noise)


def add_corpus(folder: Path) -> Path:
    """Three styles in subfolders; `calm` has four clips, so its last one is for validation."""
    frames = {"calm/a": 40, "calm/b": 55, "calm/c": 30, "calm/d": 45, "angry/a": 62, "old/x": 26}
    for seed, name in enumerate(frames):
        add_pair(folder, name, frames[name], seed)
    return folder


@pytest.fixture
def corpus_folder(tmp_path: Path) -> Path:
    return add_corpus(tmp_path / "corpus")


@pytest.fixture(scope="session")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    """The same corpus, prepared once; not to be written to."""
    folder = tmp_path_factory.mktemp("prepared")
    return prepare(add_corpus(folder / "corpus"), folder / "arrays")
