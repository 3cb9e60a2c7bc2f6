"""Retrieval: chance and perfection, ties, the share of wanted words among the top-ranked."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zeggs_jax.metrics import retrieval


def test_perfect_pairs_are_first_both_ways():
    found = retrieval.recalls(np.eye(20))
    assert found.there == found.back == retrieval.Direction((1.0, 1.0, 1.0), 1.0)
    assert found.chance == (0.05, 0.25, 0.5)
    assert (found.median, found.count) == (10.5, 20)


def test_the_two_ways_differ():
    similarity = np.array([[0.9, 0.1, 0.0], [0.95, 0.5, 0.0], [0.99, 0.0, 0.3]])
    found = retrieval.recalls(similarity)
    assert found.there.recalls[0] == pytest.approx(1 / 3)
    assert found.back.recalls[0] == pytest.approx(2 / 3)


def test_equal_similarities_are_worth_chance():
    found = retrieval.recalls(np.zeros((21, 21)))
    assert found.there.median == found.median == 11.0
    assert found.there.recalls == (0.0, 0.0, 0.0)


def test_random_similarities_are_worth_chance():
    draw = np.random.default_rng(0)
    made = [retrieval.recalls(draw.normal(size=(50, 50))).there.recalls for _ in range(100)]
    np.testing.assert_allclose(np.mean(made, axis=0), [0.02, 0.1, 0.2], atol=0.01)


@given(st.integers(0, 100))
def test_only_the_order_counts(seed):
    similarity = np.random.default_rng(seed).normal(size=(12, 12))
    assert retrieval.recalls(similarity) == retrieval.recalls(np.exp(3.0 * similarity) - 7.0)


def test_ways_that_lead_nowhere():
    with pytest.raises(ValueError, match=r"shape \(2, 3\)"):
        retrieval.recalls(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="not finite"):
        retrieval.recalls(np.full((2, 2), np.nan))


def test_nearest_are_the_most_similar_first():
    assert retrieval.nearest(np.array([[0.1, 0.9, 0.5]]), 2) == [[1, 2]]


def test_top_share_of_perfect_equal_and_inverted_weights():
    wanted = [[1], [0, 2], []]
    perfect = [np.array([0.0, 1.0, 0.0, 0.0]), np.array([0.5, 0.0, 0.5, 0.0]), np.ones(3)]
    even = (1 * 1 / 4 + 2 * 2 / 4) / 3
    assert retrieval.top_share(perfect, wanted) == (1.0, pytest.approx(even))
    equal, chance = retrieval.top_share([np.ones(4), np.ones(4), np.ones(3)], wanted)
    assert equal == pytest.approx(chance)
    assert retrieval.top_share([1.0 - row for row in perfect], wanted)[0] == pytest.approx(0.0)


def test_wanted_words_must_be_there():
    with pytest.raises(ValueError, match="word 4 is wanted of a sentence of 4"):
        retrieval.top_share([np.ones(4)], [[4]])
    with pytest.raises(ValueError, match="no sentence has a wanted word"):
        retrieval.top_share([np.ones(4)], [[]])
