"""A body of five joints and networks of a few units, with random weights and scales."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data.scale import Scale, Scales
from zeggs_jax.motion.pose import Pose, Root
from zeggs_jax.zeroeggs import model as m

JOINTS, FRAMES = 5, 7
decode = jax.jit(m.decode, static_argnames="config")
init = jax.jit(m.init, static_argnames="config")


class Small(NamedTuple):
    config: m.ZeroEggsConfig
    params: m.Params
    scales: Scales
    first: Pose
    speech: jax.Array  # [T, S]
    style: jax.Array  # [T, Z]
    gaze: jax.Array  # [T, 3]

    def decode(self, **changed) -> Pose:
        """`model.decode` of this clip, with some of it changed."""
        config, params, scales, *clip = self._replace(**changed)
        return decode(params, config, scales, *clip)


def random_pose(rng: np.random.Generator, joints: int = JOINTS) -> Pose:
    """Any numbers, and a root turned about y."""
    yaw, (x, z) = rng.uniform(-3.0, 3.0), rng.normal(size=2)
    rot = [np.cos(yaw / 2), 0.0, np.sin(yaw / 2), 0.0]
    shapes = ((3,), (3,), (joints, 3), (joints, 2, 3), (joints, 3), (joints, 3))
    root = Root(single([10.0 * x, 0.0, 10.0 * z]), single(rot))
    return Pose(root, *(single(rng.normal(size=s)) for s in shapes))


def single(numbers) -> jax.Array:
    return jnp.asarray(np.asarray(numbers, np.float32))


def make_small(conditioning: str = "normal", layers: int = 2, frames: int = FRAMES, seed: int = 0) -> Small:
    """A small model and one clip."""
    config = m.ZeroEggsConfig(
        joints=JOINTS,
        speech=m.SpeechEncoderConfig(features=9, hidden=6, size=5, kernel=5),
        style=m.StyleEncoderConfig(hidden=12, size=4),
        decoder=m.DecoderConfig(hidden=16, layers=layers, conditioning=conditioning),  # pyright: ignore
    )
    rng, n = np.random.default_rng(seed), config.vector_size
    scales = Scales(
        *(Scale(single(rng.normal(size=k)), single(rng.uniform(0.5, 1.5, k))) for k in (9, n + 3, n))
    )
    speech, style, gaze = (single(rng.normal(size=(frames, k)) * by) for k, by in ((5, 1), (4, 1), (3, 100)))
    return Small(config, init(jax.random.key(seed), config), scales, random_pose(rng), speech, style, gaze)


@pytest.fixture(scope="session")
def small() -> Small:
    """Two GRU layers, 'normal' conditioning."""
    return make_small()


@pytest.fixture(scope="session")
def build():
    """`make_small`, for tests that vary it."""
    return make_small
