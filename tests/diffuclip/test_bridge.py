"""Text prompts for ZeroEGGS: which style clips a prompt mixes, `zeggs generate --prompt`, one sentence for the rest."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from zeggs_jax.cli import bridge
from zeggs_jax.diffuclip import wording
from zeggs_jax.diffuclip.checkpoints import save_model
from zeggs_jax.motion import bvh
from zeggs_jax.zeroeggs import examples


@pytest.fixture(scope="module")
def folder(tmp_path_factory, tiny_model, clip):
    """A model that reads prompts, three style clips of its body, a second of speech."""
    where = tmp_path_factory.mktemp("bridge")
    save_model(where / "model", tiny_model)
    for k in range(3):
        euler = clip.euler * (0.2, 1.0, 1.0)[k]
        euler[:, 1, 0] += (0.0, 1.0, -1.0)[k]
        bvh.write(where / f"style{k}.bvh", clip._replace(euler=euler))
    soundfile.write(where / "speech.wav", 0.1 * np.random.default_rng(0).normal(size=16000), 16000)
    return where


@pytest.fixture
def bundled(folder, monkeypatch):
    """The three clips as if they came with the package."""
    clips = {f"style{k}": folder / f"style{k}.bvh" for k in range(3)}
    monkeypatch.setattr(examples, "bundled", lambda: clips)
    monkeypatch.setattr(wording, "installed", lambda: False)
    return clips


def test_a_clip_as_a_prompt_is_nearest_to_itself(folder, bundled):
    for name, path in bundled.items():
        weights, notes = bridge.mix(str(path), (), folder / "model")
        assert next(iter(weights)) == name
        assert list(weights.values()) == sorted(weights.values(), reverse=True)
        np.testing.assert_allclose(sum(weights.values()), 1.0, atol=1e-6)
        assert f"{name} {weights[name]:.2f}" in notes[-1]


def test_words_mix_those_that_are_asked_for_alone(folder, bundled):
    given = (str(bundled["style1"]), "style2")
    weights, notes = bridge.mix("an old person", given, folder / "model")
    assert set(weights) <= set(given)
    np.testing.assert_allclose(sum(weights.values()), 1.0, atol=1e-6)
    assert min(weights.values()) >= bridge.LEAST
    assert notes[-1].startswith("the prompt 'an old person' is a mixture of style")


def test_without_a_prompt_the_styles_stay_as_they_are():
    assert bridge.chosen(None, None, ("old",), (1.0,), True) == (("old",), (1.0,), ())


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--prompts-from", "{f}/model"), "--prompts-from was given without --prompt"),
        (("--prompt", "old", "--style", "old", "--weights", "1"), "--prompt mixes the styles itself"),
        (("--prompt", ""), "the prompt is empty"),
        (("--prompt", "old", "--style", "{f}/lib.npz"), "lib.npz' is none; give bundled styles or .bvh files"),
        (("--prompt", "{f}/none.bvh", "--prompts-from", "{f}/model"), "none.bvh"),
        (("--prompt", "old", "--prompts-from", "{f}/none"), "holds no model"),
    ],
)
def test_what_cannot_be_is_one_sentence(zeggs, folder, bundled, tmp_path, words, sentence):
    given = [word.replace("{f}", str(folder)) for word in words]
    status, _, complained = zeggs("generate", folder / "speech.wav", "-o", tmp_path / "o.bvh", *given)
    assert status == 2
    assert sentence in complained
    assert "Traceback" not in complained
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_bundled_styles_are_mixed_by_words(zeggs, folder, tmp_path, monkeypatch):
    """From end to end, with both bundled models."""
    monkeypatch.setattr(wording, "installed", lambda: False)
    motion = {}
    for prompt in ("an old, tired person", "the person is happy"):
        out = tmp_path / f"{prompt}.bvh"
        status, _, complained = zeggs("generate", folder / "speech.wav", "--prompt", prompt, "-o", out)
        assert status == 0, complained
        assert f"the prompt '{prompt}' is a mixture of" in complained
        told = json.loads(out.with_suffix(".provenance.json").read_text())
        assert "weights" in json.dumps(told)
        motion[prompt] = bvh.read(out).euler
    first, second = motion.values()
    assert np.abs(first - second).max() > 0.01
    assert Path(folder / "style0.bvh").exists()
