"""Meanings recognised from motion: the truth is, other motion is not; SRGR of the truth is 1."""

from functools import cache

import numpy as np
import pytest

from zeggs_jax.metrics import meaning, movement, srgr
from zeggs_jax.metrics.meaning import NOTHING, Said
from zeggs_jax.motion.edit import mirror
from zeggs_jax.synthetic import gestures, lexicon, prosody, styles

SIGNS = ("big", "up", "you", "stop")
STYLES = ("neutral", "happy", "old", "still")
TIMES = (2.0, 5.5, 9.0, 12.5)


@cache
def performed(style: str, shift: int):
    """A clip in which the signs come in turn, and what was said; `shift` says which one is first."""
    beats = np.arange(0.4, 14.5, 0.4)
    heard = prosody.Prosody(15.0, beats, 0.5 + 0.3 * np.sin(beats) ** 2, np.array([[0.3, 14.6]]))
    names = [SIGNS[(k + shift) % len(SIGNS)] for k in range(len(TIMES))]
    meant = [lexicon.Meant(name, name, t, t + 0.3, False) for name, t in zip(names, TIMES, strict=True)]
    clip = gestures.perform(heard, styles.find(style), 450, 30, shift, None, meant)
    return clip, [Said(t, name) for name, t in zip(names, TIMES, strict=True)]


@cache
def corpus():
    made = [performed(style, shift) for shift in range(2) for style in STYLES]
    return [movement.of(clip) for clip, _ in made], [said for _, said in made]


@cache
def detector() -> meaning.Detector:
    moves, said = corpus()
    return meaning.fit(moves[:4], said[:4])


def test_truth_is_recognised_by_a_recogniser_of_other_clips():
    moves, said = corpus()
    for move, words in zip(moves[4:], said[4:], strict=True):
        for one in words:
            found, probability = meaning.detect(detector(), move, one.time)
            assert found == one.meaning
            assert probability > 0.5
            assert meaning.present(detector(), move, one.time, one.meaning)
            assert not meaning.present(detector(), move, one.time + 1.7, one.meaning)
        assert meaning.detect(detector(), move, 3.75)[0] == NOTHING


def test_presence_is_1_of_the_truth_and_falls_to_chance_when_time_is_shifted():
    moves, said = corpus()
    truth = meaning.presence(detector(), moves[4:], said[4:])
    assert truth.share == 1.0
    assert truth.words == 16
    assert truth.chance < 0.3
    assert set(truth.of_meaning) == set(SIGNS)
    late = [move._replace(positions=np.roll(move.positions, 50, axis=0)) for move in moves[4:]]
    assert meaning.presence(detector(), late, said[4:]).share < 0.3
    other = [[one._replace(meaning=SIGNS[SIGNS.index(one.meaning) - 1]) for one in words] for words in said[4:]]
    assert meaning.presence(detector(), moves[4:], other).share < 0.5


def test_its_own_accuracy_is_of_clips_it_has_not_seen():
    moves, said = corpus()
    own = meaning.own_accuracy(moves, said, folds=4)
    assert own.accuracy > 0.95
    assert own.alarms < 0.25
    assert all(sum(row.values()) == pytest.approx(1.0) for row in own.confusion.values())
    draw = np.random.default_rng(0)
    muddled = [[one._replace(meaning=str(draw.choice(SIGNS))) for one in words] for words in said]
    assert meaning.own_accuracy(moves, muddled, folds=4).accuracy < 0.5


def test_features_do_not_know_where_the_body_stands_or_how_tall_it_is():
    move = corpus()[0][0]
    turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    place = 1.3 * move.positions @ turned.T + np.array([[[50.0, 9.0, -200.0]]])
    times = np.array([0.0, 3.3, 14.9])
    expected = meaning.features(move, times)
    np.testing.assert_allclose(meaning.features(move._replace(positions=place), times), expected, atol=1e-6)
    mirrored = meaning.features(movement.of(mirror(performed("neutral", 0)[0])), times)
    left, right = mirrored.reshape(3, -1, 9)[..., :3], expected.reshape(3, -1, 9)[..., 3:6]
    np.testing.assert_allclose(left, right * np.array([[[-1.0, 1.0, 1.0]]]), atol=0.01)


def test_the_clip_rate_does_not_matter():
    move = corpus()[0][0]
    half = move._replace(positions=move.positions[::2], rate_hz=15.0)
    times = np.array([2.0, 5.5])
    np.testing.assert_allclose(meaning.features(half, times), meaning.features(move, times), atol=0.05)


def test_what_cannot_be_made_a_recogniser_is_refused():
    moves, said = corpus()
    with pytest.raises(ValueError, match="1 lists"):
        meaning.fit(moves, said[:1])
    with pytest.raises(ValueError, match="time"):
        meaning.fit(moves[:1], said[:1])
    with pytest.raises(ValueError, match="jolly"):
        meaning.present(detector(), moves[0], 1.0, "jolly")
    with pytest.raises(ValueError, match="parts"):
        meaning.own_accuracy(moves[:2], said[:2], folds=5)
    with pytest.raises(ValueError, match="no word"):
        meaning.presence(detector(), moves[:1], [[]])


def test_srgr_is_1_of_the_truth_0_of_what_is_far_and_counts_only_meaning():
    truth = corpus()[0][0].positions
    weights = srgr.semantic_weights(corpus()[1][0], len(truth), 30)
    assert weights.sum() == pytest.approx(4 * 31, abs=4)
    assert srgr.srgr(truth, truth, weights) == 1.0
    assert srgr.srgr(truth + 40.0, truth, weights) == 1.0  # where the body stands is no matter
    made = truth.copy()
    made[weights == 0.0, 1:] += 99.0
    assert srgr.srgr(made, truth, weights) == 1.0
    made = truth.copy()
    made[:, 1:] += 11.0 / np.sqrt(3.0)
    joints = truth.shape[1]
    assert srgr.srgr(made, truth, weights) == pytest.approx(1.0 / joints)
    assert srgr.srgr(made, truth, weights, threshold=12.0) == 1.0


def test_srgr_equals_its_definition():
    draw = np.random.default_rng(1)
    made, truth, weights = draw.normal(size=(6, 4, 3)), draw.normal(size=(6, 4, 3)), draw.uniform(size=6)
    total = 0.0
    for t in range(6):
        for j in range(4):
            way = (made[t, j] - made[t, 0]) - (truth[t, j] - truth[t, 0])
            total += weights[t] * (np.sqrt((way**2).sum()) < 1.5) / 4
    assert srgr.srgr(made, truth, weights, 1.5) == pytest.approx(total / weights.sum())
    with pytest.raises(ValueError, match="same frames"):
        srgr.srgr(made[:5], truth, weights)
    with pytest.raises(ValueError, match="all 0"):
        srgr.srgr(made, truth, np.zeros(6))
