"""A corpus of two styles that are told apart by how the spine leans, and settings for prompts of it."""

import dataclasses

import numpy as np
import pytest

from zeggs_jax.diffuclip import representation, wording
from zeggs_jax.diffuclip.config import PromptsConfig, StageConfig
from zeggs_jax.diffuclip.stages.stage import Material, Take

TEXTS = {"old": ("an old person", "bent and slow"), "happy": ("the person is happy", "lively and gay")}


@pytest.fixture
def config(tiny, monkeypatch):
    monkeypatch.setattr(wording, "installed", lambda: False)
    small = PromptsConfig("words", 8, 8, 1, 2, frames=40, patch=10, image="small", pixels=16, video_frames=2,
                          video_width=8, video_layers=1, video_heads=2, dropout=0.0)  # fmt: skip
    learn = StageConfig(40, 8, 2e-2, 4, seconds=1.3)
    return dataclasses.replace(tiny, prompts=small, learn_prompts=learn, learn_video=learn)


@pytest.fixture(scope="session")
def leaning(body, clip):
    """Six takes in two styles: bent, and upright."""
    motion, takes = representation.encode(clip), []
    for k in range(6):
        style = ("old", "happy")[k % 2]
        moved = motion.copy()
        moved[:, 9:15] = [1, 0, 0, 0, 0.6, 0.8 if style == "old" else -0.8]  # the spine leans forward or backward
        split = "train" if k < 4 else "valid"
        takes.append(Take(str(k), style, split, moved, np.zeros((22, 2), np.float32), (), TEXTS[style]))
    return Material(takes, representation.scale([take.motion for take in takes], body), body)
