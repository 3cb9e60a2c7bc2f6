"""Confidence intervals: coverage on known distributions, the same for a seed, none for one clip."""

import numpy as np
import pytest

from zeggs_jax.metrics import bootstrap


def test_ninety_five_of_a_hundred_intervals_hold_the_true_mean():
    draw = np.random.default_rng(0)
    held = [
        found.low <= 3.0 <= found.high
        for found in (bootstrap.of_mean(draw.normal(3.0, 2.0, 40), k, draws=300) for k in range(200))
    ]
    assert 0.88 <= np.mean(held) <= 0.985


def test_its_width_is_that_of_the_normal_approximation():
    values = np.random.default_rng(1).normal(size=400)
    found = bootstrap.of_mean(values, 0)
    assert found.value == pytest.approx(values.mean())
    assert (found.high - found.low) / 2.0 == pytest.approx(1.96 * values.std() / 20.0, rel=0.1)
    wide = bootstrap.of_mean(values, 0, level=0.99)
    assert wide.low < found.low < found.high < wide.high


def test_a_seed_is_an_interval():
    values = np.random.default_rng(2).normal(size=20)
    assert bootstrap.of_mean(values, 7) == bootstrap.of_mean(values, 7)
    assert bootstrap.of_mean(values, 7) != bootstrap.of_mean(values, 8)


def test_equal_values_have_no_width_and_one_clip_has_no_interval():
    assert bootstrap.of_mean(np.full(9, 4.0), 0) == (4.0, 4.0, 4.0)
    one = bootstrap.of_mean(np.array([4.0]), 0)
    assert one.value == 4.0
    assert np.isnan([one.low, one.high]).all()


def test_the_centred_interval_is_the_other_one_moved():
    values = np.random.default_rng(3).exponential(size=30)
    pick = lambda index: float(values[index].max())  # noqa: E731
    straight = bootstrap.of_statistic(pick, 30, 0)
    centred = bootstrap.of_statistic(pick, 30, 0, method="centred")
    assert centred.high - centred.low == pytest.approx(straight.high - straight.low)
    assert centred.low > straight.low  # a resample's maximum is never above the whole's


def test_the_centred_interval_holds_a_distance_that_resampling_overstates():
    """Distance of the mean from zero in 30 dimensions: a resample is farther away than the clips."""
    samples = np.random.default_rng(4).normal(size=(60, 30))

    def distance(index: np.ndarray) -> float:
        return float(np.square(samples[index].mean(axis=0)).sum())

    straight = bootstrap.of_statistic(distance, 60, 0, draws=300)
    centred = bootstrap.of_statistic(distance, 60, 0, draws=300, method="centred")
    assert straight.low > straight.value  # the known failure
    assert centred.low < centred.value < centred.high


def test_drawn_within_its_stratum_what_lies_between_strata_does_not_widen():
    """Two styles a hundred apart: their shares are chosen, so only the spread within them counts."""
    draw = np.random.default_rng(5)
    values = np.concatenate([draw.normal(size=20), 100.0 + draw.normal(size=20)])
    mixed = bootstrap.of_mean(values, 0)
    within = bootstrap.of_mean(values, 0, strata=["a"] * 20 + ["b"] * 20)
    assert mixed.high - mixed.low > 20.0
    assert within.high - within.low == pytest.approx(2 * 1.96 / np.sqrt(40), rel=0.3)
    alone = bootstrap.of_mean(values, 0, strata=[str(k) for k in range(40)])
    assert alone == mixed
    with pytest.raises(ValueError, match="2 clips for 40"):
        bootstrap.of_mean(values, 0, strata=["a", "b"])


@pytest.mark.parametrize(
    ("values", "level", "words"),
    [
        (np.zeros(0), 0.95, "no clips"),
        (np.array([1.0, np.nan]), 0.95, "value 1 of 2"),
        (np.zeros(3), 1.0, "level 1"),
        (np.zeros(3), 0.0, "level 0"),
    ],
)
def test_what_has_no_interval_is_refused(values, level, words):
    with pytest.raises(ValueError, match=words):
        bootstrap.of_mean(values, 0, level)
