"""Frechet distance: closed forms, singular covariances, units, repetition; and what damage does to it."""

import numpy as np
import pytest
import scipy.linalg

from zeggs_jax.metrics import feature_net, frechet
from zeggs_jax.metrics.feature_net import FeatureNetConfig

TINY = FeatureNetConfig(features=6, channels=8, steps=100, batch=16, stride=4)


def samples(mean, covariance, count=400, seed=0):
    """Samples whose mean and covariance (divided by N) are exactly these."""
    draw = np.random.default_rng(seed).normal(size=(count, len(mean)))
    draw -= draw.mean(axis=0)
    white = draw @ np.linalg.inv(np.linalg.cholesky(draw.T @ draw / count)).T
    return white @ np.linalg.cholesky(covariance).T + mean


def test_in_one_dimension_it_is_the_closed_form():
    a, b = samples([1.0], [[4.0]]), samples([4.0], [[25.0]], seed=1)
    assert frechet.distance(a, b) == pytest.approx(9.0 + (5.0 - 2.0) ** 2)


def test_of_commuting_covariances_it_is_the_sum_over_axes():
    a, b = (
        samples(np.zeros(3), np.diag([1.0, 4.0, 9.0])),
        samples(np.array([2.0, 0, 0]), np.diag([4.0, 4.0, 1.0]), seed=1),
    )
    assert frechet.distance(a, b) == pytest.approx(4.0 + 1.0 + 0.0 + 4.0)


def test_it_is_the_formula_with_the_root_of_the_product():
    draw = np.random.default_rng(2)
    mixes = draw.normal(size=(2, 5, 5))
    first, second = (mix @ mix.T + np.eye(5) for mix in mixes)
    wanted = np.trace(first + second - 2.0 * scipy.linalg.sqrtm(first @ second).real) + 5.0
    assert frechet.distance(samples(np.zeros(5), first), samples(np.ones(5), second, seed=3)) == pytest.approx(wanted)


def test_covariances_without_full_rank_give_neither_nan_nor_less_than_nothing():
    """The trap of scipy's sqrtm: flat directions, and a set against itself."""
    draw = np.random.default_rng(3)
    flat = draw.normal(size=(300, 3)) @ draw.normal(size=(3, 40))
    held = np.repeat(flat[:1], 100, axis=0)
    assert frechet.distance(flat, flat) == pytest.approx(0.0, abs=1e-9)
    assert frechet.distance(held, held) == 0.0
    assert frechet.distance(held, flat) == pytest.approx(
        np.square(held[0] - flat.mean(axis=0)).sum() + flat.var(axis=0).sum()
    )
    assert np.isfinite(frechet.distance(1e6 * flat, 1e-6 * flat))


def test_symmetric_scaled_by_the_square_of_the_unit_blind_to_order_place_and_repetition():
    draw = np.random.default_rng(4)
    a, b = draw.normal(size=(50, 6)), 1.5 * draw.normal(size=(70, 6)) + 0.3
    value = frechet.distance(a, b)
    assert frechet.distance(b, a) == pytest.approx(value)
    assert frechet.distance(10.0 * a, 10.0 * b) == pytest.approx(100.0 * value)
    assert frechet.distance(a + 7.0, b + 7.0) == pytest.approx(value)
    turn = np.linalg.qr(draw.normal(size=(6, 6)))[0]
    assert frechet.distance(a @ turn, b @ turn) == pytest.approx(value)
    assert frechet.distance(np.concatenate([a, a]), b[::-1]) == pytest.approx(value)


def test_too_few_samples_are_refused():
    draw = np.random.default_rng(5)
    a, b = draw.normal(size=(19, 10)), draw.normal(size=(20, 10))
    with pytest.raises(ValueError, match="19 made samples are too few for a Frechet distance of 10 dim"):
        frechet.distance(a, b)
    with pytest.raises(ValueError, match="19 true samples"):
        frechet.distance(b, a)
    with pytest.raises(ValueError, match="NaN"):
        frechet.distance(b, np.where(b > 2.0, np.nan, b) * np.nan)
    with pytest.raises(ValueError, match="do not fit"):
        frechet.distance(b, b[:, :9])


@pytest.fixture(scope="module")
def truth(gesture):
    return [gesture(seed, seconds=10.0) for seed in range(5)]


@pytest.fixture(scope="module")
def net(truth):
    return feature_net.train(truth, TINY)


@pytest.fixture(scope="module")
def distances(net, truth):
    def measured(made):
        return (
            frechet.gesture_distance(net, made, truth),
            frechet.geometric(made, truth),
            frechet.kinetic(made, truth),
        )

    return measured


def test_the_truth_is_at_no_distance_also_when_given_twice(distances, truth):
    np.testing.assert_allclose(distances(truth), 0.0, atol=1e-6)
    np.testing.assert_allclose(distances([*truth, *truth]), 0.0, atol=1e-6)


def test_other_gestures_of_the_same_kind_are_nearer_than_any_damage(distances, truth, gesture, damage):
    same = np.array(distances([gesture(seed, seconds=10.0) for seed in range(20, 25)]))
    for name in ("frozen", "mean_pose", "mirrored"):
        found = np.array(distances([damage[name](motion) for motion in truth]))
        assert (found[:2] > 1.3 * same[:2]).all(), name
        if name != "mirrored":  # velocities are then nearly those of the other hand
            assert found[2] > 1.3 * same[2], name


def test_trembling_and_size_raise_it_the_more_the_more(distances, truth, gesture, damage):
    trembling = np.array([distances([damage["trembling"](m, s) for m in truth]) for s in (0.0, 1.0, 3.0)])
    assert (np.diff(trembling, axis=0) > 0.0).all()
    sizes = (12.0, 8.0, 4.0)
    smaller = np.array([distances([gesture(k, seconds=10.0, size=s) for k in range(5)]) for s in sizes])
    assert (np.diff(smaller, axis=0) > 0.0).all()


def test_a_shift_in_time_is_not_seen(distances, truth, damage):
    """A Frechet distance says what gestures look like, not when they come: rhythm has measures of its own."""
    shifted = np.array(distances([damage["late"](motion, 2.0) for motion in truth]))
    broken = np.array(distances([damage["trembling"](motion, 4.0) for motion in truth]))
    assert (shifted < 0.2 * broken).all()


def test_neither_rate_nor_place_nor_heading_counts(distances, truth, gesture):
    turn = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
    moved = [m._replace(positions=m.positions @ turn.T + np.array([50.0, 0.0, 9.0])) for m in truth]
    np.testing.assert_allclose(distances(moved), 0.0, atol=1e-4)


def test_the_same_motion_at_twice_the_rate_is_near(net, truth, gesture):
    fast = [gesture(seed, seconds=10.0, rate_hz=60.0) for seed in range(5)]
    slow, quick = (np.concatenate([feature_net.embed(net, m) for m in group]) for group in (truth, fast))
    assert frechet.distance(quick, slow) < 0.02 * np.trace(np.cov(slow, rowvar=False))
    with pytest.raises(ValueError, match="Hz"):
        frechet.gesture_distance(net, fast, truth)


def test_halves_of_the_truth_are_apart_and_their_seed_fixes_them(truth):
    clips = [frechet.moments(frechet.postures(motion)) for motion in truth]
    value = frechet.between_halves(clips, 0)
    assert value > 0.0
    assert frechet.between_halves(clips, 0) == value
    assert frechet.between_halves([clips[0]] * 4, 0) == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(ValueError, match="got 1 and 1"):
        frechet.between_halves(clips[:1], 0)


def test_halves_show_the_same_styles_where_styles_are_known(truth):
    """Two styles a metre apart: halves of mixed clips would measure how the styles were dealt out."""
    near = [frechet.moments(frechet.postures(motion)) for motion in truth[:4]]
    far = [samples._replace(mean=samples.mean + 100.0) for samples in near]
    mixed = frechet.between_halves([*near, *far], 0)
    assert frechet.between_halves([*near, *far], 0, ["near"] * 4 + ["far"] * 4) < 0.1 * mixed


def test_no_motion_is_refused(truth):
    with pytest.raises(ValueError, match="0 made and 5 true"):
        frechet.geometric([], truth)
    with pytest.raises(ValueError, match="too few"):
        frechet.geometric([truth[0]._replace(positions=truth[0].positions[:60])], truth)


def test_from_moments_it_is_the_same_distance(truth):
    """Clips drawn again, one of them twice: the samples put together, or their moments."""
    draw = np.random.default_rng(3)
    clips = [draw.normal(size=(n, 5)) @ draw.normal(size=(5, 5)) + 10.0 * draw.normal(size=5) for n in (30, 50, 41)]
    known = [frechet.moments(clip) for clip in clips]
    drawn = [0, 2, 2]
    plain = frechet.distance(np.concatenate([clips[k] for k in drawn]), np.concatenate(clips))
    found = frechet.between(frechet.normal([known[k] for k in drawn]), frechet.normal(known))
    assert found == pytest.approx(plain, rel=1e-7)
    assert frechet.between(frechet.normal(known), frechet.normal(known)) == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(ValueError, match="too few"):
        frechet.normal([frechet.moments(clips[0][:9])])
