"""The stage of text prompts: what counts as right, batches by their number, captions find motions on a toy corpus."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import joint_embedding, prompts, wording
from zeggs_jax.diffuclip.stages import prompts as stage


@pytest.fixture
def material(leaning):
    return leaning


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
    own = wording.features([*material.takes[0].captions, *material.takes[1].captions], config.prompts, "words")
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
    encode = jax.jit(prompts.encode_motion, static_argnames="config")
    moved = [encode(params, config, row[:40], np.ones(40, bool)) for row in scaled]
    assert ((texts @ np.stack(moved).T).argmax(axis=1) == [0, 1]).all()
