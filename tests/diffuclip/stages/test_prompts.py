"""The stages of text and video prompts: what counts as right, batches by their number, both learn on a toy corpus."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import joint_embedding, prompts, representation, wording
from zeggs_jax.diffuclip.config import PromptsConfig, StageConfig
from zeggs_jax.diffuclip.stages import prompts as stage
from zeggs_jax.diffuclip.stages import video
from zeggs_jax.diffuclip.stages.stage import Material, Take

TEXTS = {"old": ("an old person", "bent and slow"), "happy": ("the person is happy", "lively and gay")}


@pytest.fixture
def config(tiny, monkeypatch):
    monkeypatch.setattr(wording, "installed", lambda: False)
    small = PromptsConfig("words", 8, 8, 1, 2, frames=40, patch=10, image="small", pixels=16, video_frames=2,
                          video_width=8, video_layers=1, video_heads=2, dropout=0.0)  # fmt: skip
    learn = StageConfig(40, 8, 2e-2, 4, seconds=1.3)
    return dataclasses.replace(tiny, prompts=small, learn_prompts=learn, learn_video=learn)


@pytest.fixture
def material(body, clip):
    """Six takes in two styles: bent, and upright."""
    motion, takes = representation.encode(clip), []
    for k in range(6):
        style = ("old", "happy")[k % 2]
        moved = motion.copy()
        moved[:, 9:15] = [1, 0, 0, 0, 0.6, 0.8 if style == "old" else -0.8]  # the spine leans forward or backward
        split = "train" if k < 4 else "valid"
        takes.append(Take(str(k), style, split, moved, np.zeros((22, 2), np.float32), (), TEXTS[style]))
    return Material(takes, representation.scale([take.motion for take in takes], body), body)


def test_with_one_right_answer_the_contrast_is_eq_5():
    keys = jax.random.split(jax.random.key(0))
    a, b = (joint_embedding.unit(jax.random.normal(key, (5, 4))) for key in keys)
    found = stage.contrast(a @ b.T / 0.1, jnp.eye(5, dtype=bool))
    np.testing.assert_allclose(found, joint_embedding.contrastive(b, a, 0.1) / 2.0, rtol=1e-5)


def test_takes_of_one_style_are_no_negatives_of_each_other():
    style = jnp.array([0, 1, 0])
    same = style[:, None] == style[None, :]
    towards = jnp.eye(2)[style]
    scores = 50.0 * towards @ towards.T
    assert stage.contrast(scores, same) < 1e-6
    assert stage.contrast(scores, jnp.eye(3, dtype=bool)) > 0.4


def test_a_batch_follows_from_its_number(config, material):
    made = stage.stage(config, material, {})
    first, again, other = made.batch(3), made.batch(3), made.batch(4)
    for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first.motion, other.motion)
    assert set(first.mask.sum(axis=1)) <= set(range(1, 41))
    own = wording.features([text for texts in TEXTS.values() for text in texts], config.prompts, "words")
    rows = first.texts["words"]
    for ids, style in zip(rows.ids, first.style, strict=True):
        whose = [k for k in range(4) if np.array_equal(own.ids[k][: ids.shape[0]], ids)]
        assert ["happy", "old"][style] == ("old", "happy")[whose[0] // 2]


@pytest.mark.slow
def test_captions_find_motions_of_their_style_after_training(config, material):
    made = stage.stage(config, material, {})
    state = made.begin(jax.random.key(0))
    for k in range(40):
        state, told = made.step(state, made.batch(k))
    assert told["loss"] < 0.5
    assert made.validate(state)["text_to_motion_words"] == 1.0
    params = made.finish(state)
    assert wording.unseen(params["known"], "a gay person, frankly") == ["a", "frankly"]
    texts = prompts.embed_texts(params, config, ["old person", "happy"], "words")
    scaled = [(take.motion - material.motion_scale.mean) / material.motion_scale.std for take in material.takes[4:]]
    moved = [prompts.encode_motion(params, config, row[:40], np.ones(40, bool)) for row in scaled]
    assert ((texts @ np.stack(moved).T).argmax(axis=1) == [0, 1]).all()


@pytest.mark.slow
def test_videos_come_to_lie_where_their_motions_do(config, material):
    frozen = prompts.init(jax.random.key(1), config, material.skeleton)
    before = jax.tree.map(np.array, frozen)
    made = video.stage(config, material, {"prompts": frozen})
    state, losses = made.begin(jax.random.key(0)), []
    for k in range(30):
        state, told = made.step(state, made.batch(k))
        losses.append(float(told["loss"]))
    assert np.mean(losses[-5:]) < 0.6 * losses[0]
    params = made.finish(state)
    for a, b in zip(jax.tree.leaves(before), jax.tree.leaves({k: params[k] for k in frozen}), strict=True):
        np.testing.assert_array_equal(a, b)
    shown = video.film(config, material.skeleton, material.takes[0].motion[:40], np.ones(40, bool))
    np.testing.assert_allclose(np.linalg.norm(prompts.encode_video(params, config, shown[None])), 1.0, atol=1e-5)
