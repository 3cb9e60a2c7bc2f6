"""Models with each kind of style encoder: written and read again, trained and generating from the command line."""

import json

import jax
import numpy as np
import pytest

from zeggs_jax.data.prepared import load
from zeggs_jax.motion import bvh
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.speech import wav
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs import train
from zeggs_jax.zeroeggs.checkpoints import load_model, save_model
from zeggs_jax.zeroeggs.encoders import ENCODERS
from zeggs_jax.zeroeggs.settings import TrainConfig

SIZES = {
    "speech": {"hidden": 6, "size": 5, "kernel": 5},
    "decoder": {"hidden": 12, "layers": 1},
}
KINDS = ["bottleneck", "parts"]


def fitted(kind, corpus):
    settings = {"model": {**SIZES, "style": {"kind": kind, "hidden": 8, "size": 4}}}
    return train.fit_config(m.from_dict(TrainConfig, settings), load(corpus)).model


@pytest.mark.parametrize("kind", KINDS)
def test_a_model_is_read_as_it_was_written(corpus, tmp_path, kind):
    config, prepared = fitted(kind, corpus), load(corpus)
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))
    params = jax.tree.map(lambda a: np.random.default_rng(0).normal(size=a.shape).astype(np.float32), shapes)
    model = m.Model(config, params, prepared.scales, prepared.skeleton)
    save_model(tmp_path / "model", model)
    again = load_model(tmp_path / "model")
    assert again.config == config
    jax.tree.map(np.testing.assert_array_equal, again.params, params)


def test_what_training_fills_in(corpus):
    assert fitted("parts", corpus).style.parts == ("trunk", "trunk", "head")
    assert not fitted("bottleneck", corpus).style.variational
    assert fitted("attn", corpus).style == m.StyleEncoderConfig(hidden=8, size=4)


def test_a_model_of_a_kind_that_is_not_there_says_how_to_add_it(corpus, tmp_path, monkeypatch):
    monkeypatch.setitem(ENCODERS, "mine", ENCODERS["bottleneck"])
    config = fitted("mine", corpus)
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))
    params = jax.tree.map(lambda a: np.zeros(a.shape, np.float32), shapes)
    save_model(tmp_path / "model", m.Model(config, params, load(corpus).scales, load(corpus).skeleton))
    monkeypatch.delitem(ENCODERS, "mine")
    with pytest.raises(
        ValueError, match=r"style kind 'mine' is unknown; .*ENCODERS\['mine'\] = Encoder\(init, apply\)"
    ):
        load_model(tmp_path / "model")


@pytest.fixture(scope="module")
def speech_and_clip(tmp_path_factory):
    """A second of noise, and a clip of the corpus's body in motion."""
    folder = tmp_path_factory.mktemp("inputs")
    wav.write(folder / "speech.wav", 0.1 * np.random.default_rng(0).normal(size=16000), 16000)
    skeleton = Skeleton(("Hips", "Spine", "Head"), (-1, 0, 1), np.array([[0, 90, 0], [0, 30, 0], [0, 40, 0]], float))
    euler = 0.3 * np.sin(np.arange(30)[:, None, None] / 5 + np.arange(9.0).reshape(1, 3, 3))
    positions = np.repeat(skeleton.offsets[None], 30, axis=0)
    bvh.write(folder / "style.bvh", bvh.Clip(skeleton, ("zyx",) * 3, euler, positions, 0.033333))
    return folder / "speech.wav", folder / "style.bvh"


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*KINDS, "gru"])
def test_train_and_generate_from_the_command_line(zeggs, corpus, speech_and_clip, tmp_path, kind):
    settings = {
        "model": {**SIZES, "style": {"kind": kind, "hidden": 8, "size": 4}},
        "windows": {"batch": 2, "window": 6, "example": [8, 12]},
        "steps": 3, "checkpoint_every": 3, "validate_every": 0, "sample_every": 0,
    }  # fmt: skip
    (tmp_path / "my.json").write_text(json.dumps(settings))
    status, _, told = zeggs("train", corpus, "-o", tmp_path / "run", "--config", tmp_path / "my.json")
    assert status == 0, told
    speech, style = speech_and_clip
    words = ("generate", speech, "--style", style, "--checkpoint", tmp_path / "run", "-o", tmp_path / "out.bvh")
    status, _, told = zeggs(*words)
    assert status == 0, told
    assert bvh.read(tmp_path / "out.bvh").euler.shape == (30, 3, 3)
    assert load_model(tmp_path / "run").config.style.kind == kind
