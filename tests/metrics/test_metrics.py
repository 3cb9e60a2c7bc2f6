"""Measures: known answers, invariances, and the right response to planted damage."""

import numpy as np
import pytest

from zeggs_jax.metrics import kinematic, recognition, rhythm
from zeggs_jax.motion import edit
from zeggs_jax.synthetic import corpus

RATE = 30.0


@pytest.fixture(scope="module")
def clip():
    return corpus.style_clip("happy", 4.0, 30, 3)


def test_a_signal_agrees_with_itself_and_not_with_itself_moved():
    draw = np.random.default_rng(0)
    energy = np.repeat(draw.uniform(size=40), 9)
    agreement = rhythm.agreement(2.0 + 3.0 * energy, energy, RATE)
    assert agreement.matched == pytest.approx(1.0)
    assert agreement.share_below == 1.0
    assert agreement.shifted < 0.5
    moved = rhythm.agreement(np.roll(energy, 90), energy, RATE)
    assert moved.matched < 0.5


def test_noise_agrees_no_better_than_shifted_noise():
    draw = np.random.default_rng(1)
    shares = [rhythm.agreement(draw.normal(size=300), draw.normal(size=300), RATE).share_below for _ in range(30)]
    assert 0.3 < np.mean(shares) < 0.7


def test_constant_motion_agrees_with_nothing():
    assert rhythm.agreement(np.ones(300), np.random.default_rng(2).uniform(size=300), RATE).matched == 0.0


@pytest.mark.parametrize(("a", "b"), [(300, 299), (60, 60)])
def test_lengths_that_do_not_fit_are_refused(a, b):
    with pytest.raises(ValueError, match="frames"):
        rhythm.agreement(np.zeros(a), np.zeros(b), RATE)


def test_jerk_of_a_cubic_is_its_third_derivative(monkeypatch, clip):
    time = np.arange(60) / RATE
    path = np.zeros((60, 1, 3))
    path[:, 0, 0] = 2.0 * time**3
    monkeypatch.setattr(kinematic, "world_positions", lambda clip: path)
    assert kinematic.mean_jerk(clip) == pytest.approx(12.0, rel=1e-6)


def test_jitter_raises_jerk_and_a_frozen_clip_has_none(clip):
    jerk = kinematic.mean_jerk(clip)
    jitter = np.random.default_rng(3).normal(scale=0.02, size=clip.euler.shape)
    assert kinematic.mean_jerk(clip._replace(euler=clip.euler + jitter)) > 2.0 * jerk
    frozen = clip._replace(euler=np.repeat(clip.euler[:1], 120, 0), positions=np.repeat(clip.positions[:1], 120, 0))
    assert kinematic.mean_jerk(frozen) == pytest.approx(0.0, abs=1e-3)
    assert kinematic.hand_speed(frozen).max() == pytest.approx(0.0, abs=1e-6)


def test_drift_is_how_far_the_hips_went(clip):
    walked = clip.positions.copy()
    walked[:, 0, 0] += np.linspace(0.0, 300.0, len(walked))
    assert kinematic.root_drift(clip._replace(positions=walked)) == pytest.approx(300.0, abs=15.0)
    assert kinematic.root_drift(clip) < 20.0


def test_hand_speed_does_not_count_where_the_body_goes(clip):
    walked = clip.positions.copy()
    walked[:, 0, 0] += np.linspace(0.0, 300.0, len(walked))
    np.testing.assert_allclose(
        kinematic.hand_speed(clip._replace(positions=walked)), kinematic.hand_speed(clip), atol=1e-6
    )


def test_hand_speed_does_not_depend_on_the_frame_rate(clip):
    fast = edit.resample(clip, 60.0)
    assert kinematic.hand_speed(fast).mean() == pytest.approx(kinematic.hand_speed(clip).mean(), rel=0.1)


def test_statistics_do_not_depend_on_where_the_body_stands(clip):
    moved = clip.positions.copy()
    moved[:, 0] += [100.0, 0.0, -50.0]
    np.testing.assert_allclose(
        kinematic.style_statistics(clip._replace(positions=moved)), kinematic.style_statistics(clip), atol=1e-4
    )


def test_recognition_finds_the_nearest_and_needs_two_styles():
    draw = np.random.default_rng(4)
    centres = {"a": np.array([0.0, 0.0]), "b": np.array([5.0, 0.0]), "c": np.array([0.0, 5.0])}
    names = [name for name in centres for _ in range(5)]
    points = np.stack([centres[name] + 0.1 * draw.normal(size=2) for name in names])
    centroids = recognition.fit(points, names)
    assert all(recognition.nearest(centroids, centre) == name for name, centre in centres.items())
    with pytest.raises(ValueError, match="two styles"):
        recognition.fit(points[:3], ["a", "a", "a"])


def test_named_styles_are_told_apart():
    clips = {(s, k): corpus.style_clip(s, 5.0, 30, 50 + k) for s in ("old", "happy", "still") for k in range(3)}
    train = [key for key in clips if key[1] < 2]
    centroids = recognition.fit(
        np.stack([kinematic.style_statistics(clips[key]) for key in train]), [key[0] for key in train]
    )
    for style in ("old", "happy", "still"):
        assert recognition.nearest(centroids, kinematic.style_statistics(clips[style, 2])) == style
