"""The two stages of the joint space on words that each have a gesture: batches, teachers, what is learnt."""

import dataclasses

import jax
import numpy as np
import pytest

from zeggs_jax.data.scale import Scale
from zeggs_jax.diffuclip import joint_embedding
from zeggs_jax.diffuclip.config import CodesConfig, DiffuclipConfig, JointConfig, StageConfig
from zeggs_jax.diffuclip.stages import gestures, joint
from zeggs_jax.diffuclip.stages.stage import Encoded, Material, Take
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.speech.transcript import Word

CONFIG = DiffuclipConfig(
    frame_time=1 / 30,
    codes=CodesConfig(latent=6, codes=8, halvings=2),
    joint=JointConfig("words", 16, 1, 2, text_layers=1, words=8, latents=32, dropout=0.0),
    learn_gestures=StageConfig(60, 8, 1e-2, 5, seconds=4.0),
    learn_joint=StageConfig(60, 8, 1e-2, 5, seconds=4.0),
)
SPOKEN = ("up", "down", "wide", "no", "yes", "stop")


def take(number, split):
    """Sentences of three words; each word moves a channel of its own while it is spoken."""
    draw = np.random.default_rng(number)
    words, latents = [], draw.normal(0.0, 0.1, (90, 6)).astype(np.float32)
    for k in range(18):
        chosen = int(draw.integers(6))
        start = 0.6 * k + 0.05
        words.append(Word(SPOKEN[chosen] + "." * (k % 3 == 2), start, start + 0.4))
        latents[int(start * 7.5) : int((start + 0.5) * 7.5), chosen] = 3.0
    codes = latents.argmax(axis=1, keepdims=True).astype(np.int32)
    made = Take(f"take{number}", "old", split, np.zeros((360, 3), "f4"), np.zeros((90, 2), "f4"), tuple(words), ())
    return made, Encoded(latents, latents, codes)


@pytest.fixture(scope="module")
def material():
    takes, encoded = zip(*[take(k, "train" if k < 6 else "valid") for k in range(8)], strict=True)
    skeleton = Skeleton(("Hips", "Head"), (-1, 0), np.array([[0.0, 90.0, 0.0], [0.0, 70.0, 0.0]]))
    return Material(takes, Scale(np.zeros(3, "f4"), np.ones(3, "f4")), skeleton, encoded)


@pytest.fixture(scope="module")
def contrast(material):
    """The joint stage, compiled once."""
    return joint.stage(CONFIG, material, {})


def run(stage, updates):
    state = stage.begin(jax.random.key(0))
    for k in range(updates):
        state, metrics = stage.step(state, stage.batch(k))
    return state, metrics


def test_batches_follow_from_their_number(material):
    for make in (gestures.stage, joint.stage):
        stage = make(CONFIG, material, {})
        a, b, c = stage.batch(3), stage.batch(3), stage.batch(4)
        jax.tree.map(np.testing.assert_array_equal, a, b)
        assert any((x != y).any() for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(c), strict=True))


def test_a_sixth_is_covered_in_stretches():
    draw = np.random.default_rng(0)
    hidden = np.stack([gestures.covered(draw, 40, 0.15) for _ in range(200)])
    assert 0.15 <= hidden.mean() < 0.22
    assert hidden.any(1).all()
    starts = (hidden & ~np.roll(hidden, 1, axis=1)).sum() / hidden.sum()
    assert starts < 0.45  # alone, every covered latent would be a start
    assert gestures.covered(draw, 1, 0.15).tolist() == [True]


@pytest.mark.slow
def test_covered_codes_are_told_from_their_neighbours(material):
    stage = gestures.stage(CONFIG, material, {"joint": {"text": "kept"}})
    before = stage.validate(stage.begin(jax.random.key(0)))
    state, _ = run(stage, 40)
    after = stage.validate(state)
    assert after["loss"] < 0.75 * before["loss"]  # ln 6 / ln 8 = 0.86 is what their frequencies are worth
    made = stage.finish(state)
    assert made["text"] == "kept"
    assert (
        made["gesture"]["encoder"].keys() == joint_embedding.init_gesture(jax.random.key(0), CONFIG)["encoder"].keys()
    )


def test_only_covered_latents_cost(material):
    clips = gestures.batch(CONFIG, material, 0, "train")
    params, keys = gestures.init(jax.random.key(0), CONFIG), jax.random.split(jax.random.key(0), 8)
    cost = jax.jit(lambda clips: gestures.loss_fn(CONFIG, params, clips, keys, None)[0])
    loss = cost(clips)
    elsewhere = np.where(clips.hidden[..., None], clips.codes, (clips.codes + 1) % 8)
    there = np.where(clips.hidden[..., None], (clips.codes + 1) % 8, clips.codes)
    assert cost(clips._replace(codes=elsewhere)) == loss
    assert cost(clips._replace(codes=there)) != loss


@pytest.mark.slow
def test_sentences_find_their_gestures(contrast):
    stage = contrast
    before = stage.validate(stage.begin(jax.random.key(0)))
    state, _ = run(stage, 60)
    after = stage.validate(state)
    assert after["loss"] < 0.6 * before["loss"]
    assert min(after["words_to_gesture_r5"], after["gesture_to_words_r5"]) > 0.8
    assert after["chance_r10"] == 10 / 12


def test_the_pretrained_gesture_encoder_is_where_it_begins(material):
    learnt = joint_embedding.init_gesture(jax.random.key(9), CONFIG)
    state = joint.stage(CONFIG, material, {"joint": {"gesture": learnt}}).begin(jax.random.key(0))
    jax.tree.map(np.testing.assert_array_equal, state.params["gesture"], learnt)
    assert set(state.params) == {"text", "gesture"}


@pytest.mark.slow
def test_teachers_follow_by_the_momentum(contrast):
    stage = contrast
    state = stage.begin(jax.random.key(0))
    first = jax.tree.map(np.array, state.average)
    state, _ = stage.step(state, stage.batch(1))
    wanted = jax.tree.map(lambda a, p: 0.995 * a + 0.005 * np.asarray(p), first, state.params)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), state.average, wanted)


@pytest.mark.slow
def test_distillation_begins_with_the_first_epoch(contrast):
    """At update 0 the loss is Eq. 4-5 alone; later it keeps 60 % of that."""
    stage = contrast
    _, metrics = stage.step(stage.begin(jax.random.key(0)), stage.batch(0))
    np.testing.assert_allclose(metrics["loss"], metrics["contrast"], rtol=1e-6)
    state = stage.begin(jax.random.key(0))
    _, metrics = stage.step(state._replace(step=state.step + 1000), stage.batch(0))
    assert 0.6 * metrics["contrast"] < metrics["loss"] < 0.9 * metrics["contrast"]  # the teacher sees what is left out


def test_sentences_are_cut_where_they_are_too_long(material):
    said = joint.sentences(CONFIG, material, "train")
    assert len(said) == 6 * 6
    assert [one.seconds for one in said] == sorted(one.seconds for one in said)
    short = dataclasses.replace(CONFIG, joint=dataclasses.replace(CONFIG.joint, words=2))
    pieces = joint.sentences(short, material, "train")
    assert max(len(one.words) for one in pieces) == 2
    assert all(one.seconds >= joint.SHORTEST_S for one in pieces)


def test_a_gesture_is_that_of_its_words(material):
    one = joint.sentences(CONFIG, material, "train")[7]
    made = joint.pair(CONFIG, material, one, None)
    first = int(max(one.words[0].start - 0.25, 0) * 7.5)
    count = int(made.mask.sum())
    np.testing.assert_array_equal(made.quantised[:count], material.encoded[one.take].quantised[first : first + count])
    assert count / 7.5 >= one.seconds + 0.25
    centre = int(made.spoken.times[0] * 7.5)
    assert made.quantised[centre].argmax() == SPOKEN.index(one.words[0].text.strip("."))


def test_a_corpus_without_words_is_told(material):
    silent = material._replace(takes=[take._replace(words=()) for take in material.takes])
    with pytest.raises(ValueError, match=r"0 spoken sentences .* transcripts with timed words"):
        joint.stage(CONFIG, silent, {})


def test_a_t5_needs_its_folder(material):
    t5 = dataclasses.replace(CONFIG, joint=dataclasses.replace(CONFIG.joint, text="t5"))
    with pytest.raises(ValueError, match=r"set joint\.folder"):
        joint.stage(t5, material, {}).begin(jax.random.key(0))


@pytest.mark.slow
def test_some_words_and_latents_are_left_out_in_training_alone(material, contrast):
    params = contrast.begin(jax.random.key(0)).params
    pairs = contrast.batch(0)
    plain, again = joint._embed(params, CONFIG, pairs), joint._embed(params, CONFIG, pairs)
    jax.tree.map(np.testing.assert_array_equal, plain, again)
    keys = jax.random.split(jax.random.key(0), (8, 2))
    for whole, cut in zip(plain, joint._embed(params, CONFIG, pairs, keys), strict=True):  # CONFIG has no dropout
        apart = np.abs(whole - cut).max(axis=1) > 1e-4
        assert apart.any()
        assert np.isfinite(cut).all()
