"""Style examples of any length: padding changes no loss and no gradient, and nothing compiles twice."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from zeggs_jax.data import windows
from zeggs_jax.data.prepared import Prepared
from zeggs_jax.data.windows import Batch, WindowConfig
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.training import step as updates
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs.objective import Setting, loss_fn
from zeggs_jax.zeroeggs.settings import TrainConfig

FRAMES = 150
GRADIENT = optax.sgd(1.0)


class Tiny(NamedTuple):
    step: updates.Step
    params: m.Params
    prepared: Prepared

    def update(self, batch: Batch) -> tuple[m.Params, updates.Metrics]:
        """One step: the loss, and parameters from which the whole gradient was taken."""
        state, metrics = self.step(updates.begin(jax.tree.map(jnp.array, self.params), GRADIENT), batch)
        return state.params, metrics


@pytest.fixture(scope="module")
def tiny(build) -> Tiny:
    """The small model, and two clips of noise."""
    small, rng = build(layers=1), np.random.default_rng(0)
    half = rng.uniform(0, 1, FRAMES)
    skeleton = Skeleton(("Hips", "Spine", "Head", "LeftHand", "RightHand"), (-1, 0, 1, 1, 1), rng.normal(size=(5, 3)))
    prepared = Prepared(
        folder=Path("noise"), config={}, skeleton=skeleton, frame_time=small.config.frame_time, styles=("a", "b"),
        names=("a/1", "b/1"), splits=("train", "train"), labels=np.array([0, 1], np.int32),
        ranges=np.array([[0, 70], [70, FRAMES]], np.int32), gaze=np.zeros((2, 3), np.float32),
        speech=rng.normal(size=(FRAMES, 9)).astype(np.float32),
        pose=rng.normal(size=(FRAMES, small.config.vector_size)).astype(np.float32),
        root_pos=np.zeros((FRAMES, 3), np.float32),
        root_rot=np.stack([np.cos(half), 0 * half, np.sin(half), 0 * half], axis=1).astype(np.float32),
        scales=small.scales,
        **({"across": skeleton.mirror_map()} if "across" in Prepared.__dataclass_fields__ else {}),
    )  # fmt: skip
    config = replace(
        small.config, speech=replace(small.config.speech, dropout=0.0), style=replace(small.config.style, dropout=0.0)
    )
    config = replace(config, style=replace(config.style, block_dropout=0.0))
    setting = Setting(TrainConfig(model=config), small.scales, skeleton.parents)
    return Tiny(updates.make_step(loss_fn(setting), GRADIENT, seed=0), small.params, prepared)


def batch_of(tiny: Tiny, k: int, longest: int = 64) -> Batch:
    return windows.batch(
        tiny.prepared, 0, k, WindowConfig(batch=2, window=8, example=(8, longest), mirror=0.0, pace=0.0)
    )


def test_batches_of_all_lengths_share_one_compiled_step(tiny):
    """And the lengths that they hand over are heard."""
    lengths: set[int] = set()
    for k in range(4):
        batch = batch_of(tiny, k)
        lengths |= set(batch.example_length.tolist())
        _, metrics = tiny.update(batch)
    assert len(lengths) > 4
    _, shorter = tiny.update(batch._replace(example_length=batch.example_length - 4))
    assert shorter["loss"] != metrics["loss"]
    assert tiny.step._cache_size() == 1  # pyright: ignore[reportFunctionMemberAccess]


@pytest.mark.parametrize("value", [pytest.param(0.0, marks=pytest.mark.slow), 7.0])
def test_the_padded_length_changes_neither_loss_nor_gradient(tiny, value):
    batch = batch_of(tiny, 3)
    assert len(set(batch.example_length.tolist())) == 2
    longer = np.pad(batch.example, ((0, 0), (0, 64), (0, 0)), constant_values=value)
    (params, metrics), (expected, usual) = tiny.update(batch._replace(example=longer)), tiny.update(batch)
    for name in usual:
        np.testing.assert_allclose(metrics[name], usual[name], rtol=1e-5, err_msg=name)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-5, atol=1e-6), params, expected)
