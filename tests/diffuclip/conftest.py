"""A small body that walks, turns and gestures, and a config of a few units for it."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import soundfile

from zeggs_jax.data.scale import Scale
from zeggs_jax.diffuclip import body_parts, model, representation, video_encoder, wording
from zeggs_jax.diffuclip.config import (
    CodesConfig,
    DenoiserConfig,
    DiffuclipConfig,
    DiffusionConfig,
    JointConfig,
    PromptsConfig,
    StageConfig,
)
from zeggs_jax.diffuclip.model import Model
from zeggs_jax.motion import bvh
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.skeleton import Skeleton

NAMES = (
    *("Hips", "Spine", "Spine2", "Head", "LeftArm", "LeftHand", "LeftHandIndex1", "RightArm", "RightHand"),
    *("LeftUpLeg", "LeftFoot", "RightUpLeg", "RightFoot"),
)
PARENTS = (-1, 0, 1, 2, 2, 4, 5, 2, 7, 0, 9, 0, 11)
OFFSETS = (
    *([0, 90, 0], [0, 10, -2], [0, 20, 1], [0, 25, 2], [15, 12, 0], [28, -3, 1], [8, 0, 0], [-15, 12, 0]),
    *([-28, -3, 1], [10, -5, 0], [0, -80, 3], [-10, -5, 0], [0, -80, 3]),
)
FRAME_TIME = 1 / 30


def moving(body: Skeleton, frames: int, seed: int = 0) -> Clip:
    """A clip that goes about, turns by several rounds and moves every joint, in mixed Euler orders."""
    rng = np.random.default_rng(seed)
    seconds = np.arange(frames) * FRAME_TIME

    def waves(*shape: int) -> np.ndarray:
        at = seconds.reshape(-1, *(1 for _ in shape))
        pace, phase, size = (rng.uniform(*limits, (3, *shape)) for limits in ((0.5, 6), (0, 6), (-1.5, 1.5)))
        return (size[:, None] * np.sin(pace[:, None] * at[None] + phase[:, None])).sum(axis=0)

    positions = np.tile(np.asarray(body.offsets, float), (frames, 1, 1))
    positions[:, 0] += waves(3) * [20, 2, 20] + seconds[:, None] * [30, 0, 10]
    euler = 0.3 * waves(len(body), 3)
    euler[:, 0] = 0.1 * euler[:, 0]
    euler[:, 0, 1] += 1.0 + 0.8 * seconds  # joint 0 is zyx: about the vertical
    orders = tuple(("zyx", "yxz", "xzy")[joint % 3] for joint in range(len(body)))
    return Clip(body, orders, euler, positions, FRAME_TIME)


@pytest.fixture(scope="session")
def body() -> Skeleton:
    return Skeleton(NAMES, PARENTS, np.array(OFFSETS, float))


@pytest.fixture(scope="session")
def clip(body) -> Clip:
    return moving(body, 90)


@pytest.fixture(scope="session")
def tiny() -> DiffuclipConfig:
    """Two parts, two residual codebooks of 16, a latent for 4 frames."""
    return dataclasses.replace(
        DiffuclipConfig(),
        frame_time=FRAME_TIME,
        joints=len(NAMES),
        parts=("upper", "lower"),
        codes=CodesConfig(latent=6, codes=16, quantisers=2, width=12, halvings=2, depth=2, revive=0.5),
        learn_codes=StageConfig(30, 8, 3e-3, 5, seconds=0.8, ema=0.9),
    )


def drawn(make: Callable[[Any], Any], body: Skeleton | None = None, parts: tuple[str, ...] = (), seed: int = 0) -> Any:
    """Parameters of the shapes of `make(key)`, drawn by numpy: none is silent, and nothing is compiled for them."""
    rng = np.random.default_rng(seed)

    def leaf(path, shape):
        if shape.dtype != np.float32:
            return jnp.asarray(np.zeros(shape.shape, shape.dtype))
        size = min(0.2, float(np.prod(shape.shape[1:])) ** -0.5)
        noise = (size * rng.normal(size=shape.shape)).astype(np.float32)
        return jnp.asarray(noise + np.float32(path[-1].key == "scale"))

    made = jax.tree_util.tree_map_with_path(leaf, jax.eval_shape(make, jax.random.key(0)))
    if "codes" in made:
        assert body
        columns = body_parts.columns(body, parts)
        for part, own in zip(parts or (body_parts.WHOLE,), columns, strict=True):
            made["codes"][part]["columns"] = jnp.asarray(own, jnp.int32)
    return made


@pytest.fixture(scope="session")
def corpus(tmp_path_factory, body) -> Path:
    """Four clips of 4 s, one of them valid, with speech, timed words and, of the first, captions."""
    folder = tmp_path_factory.mktemp("corpus")
    rng, lines = np.random.default_rng(0), ["name,style,split"]
    for k in range(4):
        name = f"clip{k}"
        lines.append(f"{name},{('Old', 'Happy')[k % 2]},{'valid' if k == 3 else 'train'}")
        bvh.write(folder / f"{name}.bvh", moving(body, 121, k))
        voice = 0.1 * rng.normal(size=64000) * np.abs(np.sin(np.arange(64000) / 3000))
        soundfile.write(folder / f"{name}.wav", voice, 16000)
        told = [
            {"text": f"word{i % 5}" + "." * (i % 4 == 3), "start": 0.4 * i + 0.1, "end": 0.4 * i + 0.4}
            for i in range(9)
        ]
        captions = {"captions": ["bent and slow", "an old person"]} if k == 0 else {}
        (folder / f"{name}.json").write_text(json.dumps({"words": told, **captions}))
    (folder / "corpus.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="session")
def draw() -> Callable[..., Any]:
    return drawn


@pytest.fixture(scope="session")
def tiny_model(body, tiny) -> Model:
    """A whole model with drawn parameters: prompts of words, motion and video, two parts of the body."""
    config = dataclasses.replace(
        tiny,
        joint=JointConfig("words", 12, 1, 2, text_layers=1, words=12, latents=24, saliency="rescaled"),
        prompts=PromptsConfig(
            "words", 12, 12, 1, 2, frames=30, patch=6, image="small", pixels=16, video_frames=3,
            video_width=12, video_layers=1, video_heads=2,
        ),
        denoiser=DenoiserConfig(12, 1, 2, ahead=2, output="velocity"),
        diffusion=DiffusionConfig(steps=40, context=8, chunk=4, short_steps=0),
    )  # fmt: skip
    params = drawn(lambda key: model.init(key, config, body), body, config.parts)
    video = drawn(lambda key: video_encoder.init(key, config), body, seed=1)
    params["prompts"] |= {"video": video, "known": wording.known(["an old person", "happy"])}
    motion = np.concatenate([representation.encode(moving(body, 60, seed)) for seed in range(3)])
    channels = config.latent_size
    scale_z = Scale(np.zeros(channels, np.float32), np.full(channels, 0.3, np.float32))
    return Model(config, params, representation.scale([motion], body), scale_z, body)
