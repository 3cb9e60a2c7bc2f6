"""What a model hears: the speech features of its corpus go with it, from preparing to generating."""

import json
from dataclasses import replace

import jax
import numpy as np
import pytest

from zeggs_jax.data.body import AS_IS
from zeggs_jax.data.prepare import PrepareConfig, prepare
from zeggs_jax.data.prepared import Prepared
from zeggs_jax.motion import bvh
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.speech import features, wav
from zeggs_jax.training.plain import from_dict, to_dict
from zeggs_jax.zeroeggs import generate
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs.checkpoints import digest, load_model, save_model
from zeggs_jax.zeroeggs.settings import TrainConfig
from zeggs_jax.zeroeggs.train import fit_config

LOG = features.SpeechFeatureConfig(log_mel=True)
TINY = m.ZeroEggsConfig(
    speech=m.SpeechEncoderConfig(hidden=6, size=5, kernel=5),
    style=m.StyleEncoderConfig(hidden=8, size=4),
    decoder=m.DecoderConfig(hidden=12, layers=1),
)


def noise(seconds: float) -> np.ndarray:
    return (0.1 * np.random.default_rng(0).normal(size=round(16000 * seconds))).astype(np.float32)


@pytest.fixture(scope="module")
def log_corpus(tmp_path_factory) -> Prepared:
    """One clip of three joints, prepared with true log-mels."""
    folder = tmp_path_factory.mktemp("corpus")
    skeleton = Skeleton(("Hips", "Spine", "Head"), (-1, 0, 1), np.array([[0, 90, 0], [0, 30, 0], [0, 40, 0]], float))
    euler = 0.3 * np.sin(np.arange(30)[:, None, None] / 30 * np.arange(1.0, 10.0).reshape(1, 3, 3))
    (folder / "calm").mkdir()
    positions = np.repeat(skeleton.offsets[None], 30, axis=0)
    bvh.write(folder / "calm" / "a.bvh", bvh.Clip(skeleton, ("zyx",) * 3, euler, positions, 0.033333))
    wav.write(folder / "calm" / "a.wav", noise(1.0))
    return prepare(folder, folder / "arrays", PrepareConfig(speech=LOG, body=AS_IS))


def test_log_mels_have_statistics_of_their_own(log_corpus):
    std = np.asarray(log_corpus.scales.speech.std)
    assert std.shape == (81,)
    np.testing.assert_allclose(std, log_corpus.speech[2:-2].std(axis=0), rtol=1e-4)


def test_a_model_generates_with_the_features_of_its_corpus(log_corpus, tmp_path):
    config = fit_config(TrainConfig(model=TINY), log_corpus).model
    assert config.features == LOG
    model = m.Model(config, m.init(jax.random.key(0), config), log_corpus.scales, log_corpus.skeleton)
    save_model(tmp_path / "model", model)
    loaded = load_model(tmp_path / "model")
    assert loaded.config == config
    assert digest(loaded) == digest(model)
    heard = generate.read_speech(noise(1.0), loaded)
    np.testing.assert_array_equal(heard, features.extract(noise(1.0), rate_hz=30, config=LOG))
    usual = generate.read_speech(noise(1.0), loaded._replace(config=replace(config, features=features.RELEASED)))
    assert not np.allclose(heard, usual, atol=1.0)


def test_a_config_from_before_hears_the_released_features():
    old = json.loads(json.dumps(to_dict(TINY)))
    del old["features"]
    assert from_dict(m.ZeroEggsConfig, old) == TINY
    assert generate.bundled_model().config.features == features.RELEASED


def test_feature_settings_survive_json():
    config = replace(TINY, features=replace(LOG, mel_min_hz=55, mel_max_hz=7000.5))
    stored = json.dumps(to_dict(config))
    again = from_dict(m.ZeroEggsConfig, json.loads(stored))
    assert again == config
    assert json.dumps(to_dict(again)) == stored
