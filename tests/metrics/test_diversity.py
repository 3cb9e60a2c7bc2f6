"""Diversity, multimodality and L1: known answers, nothing drawn, nothing changed."""

import numpy as np
import pytest

from zeggs_jax.metrics import diversity


def test_corners_of_a_square():
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    assert diversity.diversity(corners) == pytest.approx((4.0 + 2.0 * np.sqrt(2.0)) / 6.0)


def test_one_feature_for_all_has_none_and_units_scale_it():
    features = np.random.default_rng(0).normal(size=(9, 4))
    assert diversity.diversity(np.ones((5, 3))) == 0.0
    assert diversity.diversity(10.0 * features + 7.0) == pytest.approx(10.0 * diversity.diversity(features))
    assert diversity.diversity(features[::-1]) == pytest.approx(diversity.diversity(features))


def test_clips_given_twice_lower_it_by_the_known_share():
    features = np.random.default_rng(1).normal(size=(6, 4))
    twice = diversity.diversity(np.concatenate([features, features]))
    assert twice == pytest.approx(diversity.diversity(features) * 10.0 / 11.0)


def test_samples_of_one_speech_and_speeches_apart_are_two_things():
    speeches = 100.0 * np.arange(3.0)[:, None, None] * np.ones((3, 4, 2))
    assert diversity.multimodality(speeches) == 0.0
    spread = speeches + np.random.default_rng(2).normal(size=(3, 4, 2))
    assert diversity.multimodality(spread) == pytest.approx(np.mean([diversity.diversity(s) for s in spread]))
    assert diversity.multimodality(spread) < 5.0


def test_temperature_raises_multimodality():
    noise = np.random.default_rng(3).normal(size=(4, 20, 8))
    found = [diversity.multimodality(t * noise) for t in (0.0, 0.5, 1.0, 2.0)]
    assert found[0] == 0.0
    assert found == sorted(found)


def test_l1_of_a_step_and_its_input_stays(gesture):
    motion = gesture(seconds=2.0)
    step = motion.positions * 0.0
    step[30:, :, 1] = 6.0  # half of the frames: 3 cm from the mean in one axis of three
    given = motion._replace(positions=step.copy())
    assert diversity.l1(given) == pytest.approx(1.0)
    np.testing.assert_array_equal(given.positions, step)


def test_l1_does_not_depend_on_place_rate_or_repetition_and_is_nothing_of_a_held_pose(gesture, damage):
    motion = gesture(seconds=20.0)
    value = diversity.l1(motion)
    assert value > 0.5
    assert diversity.l1(motion._replace(positions=motion.positions + 70.0)) == pytest.approx(value)
    assert diversity.l1(gesture(seconds=20.0, rate_hz=60.0)) == pytest.approx(value, rel=1e-2)
    twice = motion._replace(positions=np.concatenate([motion.positions, motion.positions]))
    assert diversity.l1(twice) == pytest.approx(value)
    assert diversity.l1(damage["frozen"](motion)) == pytest.approx(0.0, abs=1e-9)
    assert diversity.l1(damage["mean_pose"](motion)) == pytest.approx(0.0, abs=1e-9)


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(ValueError, match="got 1"):
        diversity.diversity(np.zeros((1, 3)))
    with pytest.raises(ValueError, match="NaN"):
        diversity.diversity(np.full((3, 3), np.nan))
    with pytest.raises(ValueError, match="got none"):
        diversity.multimodality(np.zeros((0, 2, 3)))
    with pytest.raises(ValueError, match="got 1"):
        diversity.multimodality(np.zeros((2, 1, 3)))
