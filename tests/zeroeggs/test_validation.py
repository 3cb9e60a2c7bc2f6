"""Looking at a model while it trains: which clips are looked at, what is reported, what is left out."""

import dataclasses
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data.prepared import Prepared, load
from zeggs_jax.data.windows import WindowConfig
from zeggs_jax.motion import bvh
from zeggs_jax.training.step import TrainState
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs import train as t
from zeggs_jax.zeroeggs.objective import Setting
from zeggs_jax.zeroeggs.validation import Sampler, Validation, can_validate

WINDOWS = WindowConfig(batch=2, window=6, example=(8, 12))


@pytest.fixture(scope="module")
def arrays(corpus) -> Prepared:
    return load(corpus)


@pytest.fixture(scope="module")
def setting(arrays) -> Setting:
    model = m.ZeroEggsConfig(
        speech=m.SpeechEncoderConfig(hidden=6, size=5, kernel=5),
        style=m.StyleEncoderConfig(kind="label"),
        decoder=m.DecoderConfig(hidden=8, layers=1),
        labels=arrays.styles,
    )
    config = t.fit_config(t.TrainConfig(model=model, windows=WINDOWS, validate_clips=3), arrays)
    return Setting(config, arrays.scales, arrays.skeleton.parents)


@pytest.fixture(scope="module")
def state(setting) -> TrainState:
    return TrainState(jnp.int32(7), jax.jit(lambda: m.init(jax.random.key(0), setting.config.model))(), ())


def test_windows_of_the_split_valid_are_needed(arrays):
    assert can_validate(arrays, WINDOWS)
    assert not can_validate(arrays, replace(WINDOWS, window=100, example=(100, 100)))
    assert not can_validate(dataclasses.replace(arrays, splits=("train",) * len(arrays.splits)), WINDOWS)


@pytest.fixture(scope="module")
def validation(arrays, setting) -> Callable[..., Validation]:
    def judge(made, recorded, energy):
        return {"frames": float(len(made.euler)), "energy": float(energy.mean())}

    return Validation(arrays, setting, judge)


def test_a_validation_is_the_same_every_time(validation, state, arrays):
    first = validation(state)
    assert validation(state) == first
    assert first["clips"] == 3
    assert first["frames"] == 6.0
    assert first["energy"] == pytest.approx(float(validation.batch.speech[:, :, -1].mean()), rel=1e-4)
    assert set(validation.batch.label.tolist()) == {arrays.labels[arrays.clips("valid")[0]]}
    total = sum(value for name, value in first.items() if name not in ("loss", "clips", "frames", "energy"))
    assert first["loss"] == pytest.approx(total / 18, rel=1e-5)


def test_it_is_of_the_average_where_one_is_kept(validation, state):
    other = jax.tree.map(lambda a: a * 1.5, state.params)
    assert validation(state._replace(average=other))["loss"] == validation(state._replace(params=other))["loss"]
    assert validation(state._replace(average=other))["loss"] != validation(state)["loss"]


def test_bodies_that_are_not_finite_are_reported_and_not_judged(validation, state):
    broken = state._replace(params=jax.tree.map(lambda a: a * np.nan, state.params))
    values = validation(broken)
    assert np.isnan(values["loss"])
    assert "frames" not in values


def test_samples_are_files_and_a_page(arrays, setting, state, tmp_path):
    shown = []

    def show(path: Path, figures: list, title: str) -> None:
        shown.append((path.name, [label for label, _ in figures], title))

    sampler = Sampler(arrays, setting, show)
    (tmp_path / ".step_7.partial").mkdir()  # of a run that was killed
    sampler(tmp_path / "step_7", state)
    assert shown == [("index.html", ["wild_d, made", "wild_d, recorded"], "After 7 updates")]
    assert [path.name for path in tmp_path.iterdir()] == ["step_7"]
    made = bvh.read(tmp_path / "step_7" / "wild_d.bvh")
    assert made.euler.shape == (30, 3, 3)
    broken = state._replace(params=jax.tree.map(lambda a: a * np.nan, state.params))
    sampler(tmp_path / "step_8", broken)
    assert list((tmp_path / "step_8").iterdir()) == []
    assert len(shown) == 1


def test_clips_of_the_training_are_shown_where_no_others_are(arrays, setting):
    none = dataclasses.replace(arrays, splits=("train",) * len(arrays.splits))
    assert Sampler(arrays, setting, None).clips.tolist() == arrays.clips("valid").tolist()
    assert len(Sampler(none, setting, None).clips) == 3
