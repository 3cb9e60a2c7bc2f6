"""Tokens: one length, times of the words' middles, words hashed without a vocabulary."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from zeggs_jax.diffuclip import tokens
from zeggs_jax.diffuclip.config import JointConfig
from zeggs_jax.speech.transcript import Word

FIVE, TWO = JointConfig(words=5), JointConfig(words=2)
WORDS = (Word("A", 0.5, 0.7), Word("big,", 0.8, 1.2), Word("fish.", 1.4, 2.0))


def test_padding_has_no_features_and_no_time():
    found = tokens.tokenize(WORDS, FIVE)
    assert found.features.shape == (5, tokens.PIECES)
    assert found.mask.tolist() == [True] * 3 + [False] * 2
    np.testing.assert_allclose(found.times, [0.6, 1.0, 1.7, 0.0, 0.0], atol=1e-6)
    assert not found.features[3:].any()
    assert found.features[:3, 0].all()


def test_more_words_than_tokens_are_cut_at_the_end():
    found = tokens.tokenize(WORDS, TWO)
    assert found.mask.all()
    np.testing.assert_array_equal(found.features, tokens.tokenize(WORDS[:2], TWO).features)


def test_no_words_are_all_padding():
    assert not tokens.tokenize((), TWO).mask.any()


def test_a_reader_may_give_several_tokens_a_word():
    found = tokens.tokenize(WORDS, FIVE, lambda texts: (np.array([7, 8, 9, 4], np.int32), np.array([0, 1, 1, 2])))
    assert found.features.tolist() == [7, 8, 9, 4, 0]
    np.testing.assert_allclose(found.times[:4], [0.6, 1.0, 1.0, 1.7], atol=1e-6)


def test_case_and_punctuation_do_not_count():
    (ids, _), (same, _) = tokens.hashed(["Big,", "don't"]), tokens.hashed(["big", "DONT"])
    np.testing.assert_array_equal(ids, same)


def test_hashes_never_change():
    """A trained table depends on them."""
    assert tokens.hashed(["big"])[0][0].tolist() == [732, 3906, 732, 887, 1104, 3100, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]


def test_alike_words_share_pieces():
    big, bigger, stop = (set(row[row > 0]) for row in tokens.hashed(["big", "bigger", "stop"])[0])
    assert big & bigger
    assert not big & stop


@given(st.lists(st.text(max_size=30), max_size=5))
def test_every_text_has_ids_in_the_table(texts):
    ids, owners = tokens.hashed(texts)
    assert ids.shape == (len(texts), tokens.PIECES)
    assert owners.tolist() == list(range(len(texts)))
    assert ((ids >= 0) & (ids < tokens.BUCKETS)).all()
    assert ids[:, 0].all()


def test_between_takes_each_word_once():
    first, second = tokens.between(WORDS, 0.0, 1.0), tokens.between(WORDS, 1.0, 2.0)
    assert [w.text for w in first] == ["A"]
    assert [w.text for w in second] == ["big,", "fish."]
    assert first + second == WORDS


def test_times_are_from_the_zero_that_is_given():
    plain, later = tokens.tokenize(WORDS, FIVE), tokens.tokenize(WORDS, FIVE, zero_s=0.5)
    np.testing.assert_allclose(plain.times[:3] - later.times[:3], 0.5, atol=1e-6)
    assert not later.times[3:].any()
