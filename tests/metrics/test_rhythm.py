"""Rhythm: agreement of hand speed and speech energy, against the same speech moved in time."""

import numpy as np
import pytest

from zeggs_jax.metrics import rhythm

RATE = 30.0


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


def test_chance_is_the_mean_over_the_shifts():
    found = rhythm.against_chance(lambda shift: 5.0 if shift == 0.0 else shift, 4.0)
    assert found.matched == 5.0
    assert found.shifted == pytest.approx(np.mean(np.arange(1.0, 3.0, 0.25)))
    assert found.share_below == 1.0
    with pytest.raises(ValueError, match="too short to shift"):
        rhythm.against_chance(lambda shift: shift, 2.9)


def test_the_later_the_motion_the_less_it_agrees():
    energy = np.repeat(np.random.default_rng(3).uniform(size=60), 9)
    found = [rhythm.agreement(np.roll(energy, n), energy, RATE).matched for n in (0, 9, 12, 15)]
    assert found == sorted(found, reverse=True)
    assert found[-1] < found[0] - 0.3
