"""Words that matter: varied sentences, held-out synonyms that never slip in, no meaning by accident."""

from collections import Counter

import pytest

from zeggs_jax.synthetic import lexicon, sentences, voice

SEEDS = range(60)


def said(held_out: bool = False) -> list[str]:
    text = " ".join(lexicon.monologue(seed, 60, held_out) for seed in SEEDS)
    return [word.strip(".,") for word in text.split()]


def test_the_monologue_without_meanings_is_as_it_always_was():
    text = "at first, a singer dropped the basket. you know, the stranger painted my young ladder over a bright garden."
    assert sentences.monologue(5, 8) == text


def test_every_meaning_is_said_by_every_word_of_training_and_by_no_other():
    counts = Counter(word for word in said() if lexicon.find(word))
    assert set(counts) == {word for meaning in lexicon.MEANINGS.values() for word in meaning.words}
    of_meaning = Counter()
    for word, count in counts.items():
        of_meaning[lexicon.find(word)] += count
    assert min(of_meaning.values()) > 0.4 * max(of_meaning.values())


def test_held_out_words_are_said_only_where_asked():
    held_out = {word for meaning in lexicon.MEANINGS.values() for word in meaning.held_out}
    assert {word for word in said(True) if lexicon.find(word)} == held_out


def test_neutral_words_mean_nothing_and_are_all_that_is_said_besides():
    neutral = lexicon.neutral_words()
    assert not {word for word in neutral if lexicon.find(word)}
    assert {word for word in said() if not lexicon.find(word)} <= neutral


def test_meanings_are_disjoint_and_have_words_enough():
    words = [word for m in lexicon.MEANINGS.values() for word in (*m.words, *m.held_out)]
    assert len(words) == len(set(words))
    assert all(len(m.words) >= 3 and len(m.held_out) >= 2 for m in lexicon.MEANINGS.values())
    assert {m.kind for m in lexicon.MEANINGS.values()} == {"iconic", "deictic", "metaphoric", "emblem"}


def test_some_sentences_mean_nothing_and_some_twice():
    texts = " ".join(lexicon.monologue(seed, 60) for seed in SEEDS).split(". ")
    counts = Counter(sum(lexicon.find(word) is not None for word in text.split()) for text in texts)
    assert set(counts) == {0, 1, 2}
    assert 0.05 < counts[0] / len(texts) < 0.25
    assert len(set(texts)) > 0.98 * len(texts)


def test_spoken_words_are_found_at_their_nucleus():
    words = [
        voice.Word("The", 0.0, 0.2, False, 0.1),
        voice.Word("Huge,", 0.2, 0.7, True, 0.45),
        voice.Word("teeny", 0.8, 1.2, True, 1.0),
    ]
    assert lexicon.meant(words) == [("huge", "big", 0.45, 0.7, False), ("teeny", "small", 1.0, 1.2, True)]


@pytest.mark.parametrize("seed", [0, 7])
def test_same_seed_same_words(seed):
    assert lexicon.monologue(seed, 40) == lexicon.monologue(seed, 40)
    assert len(lexicon.monologue(seed, 40).split()) >= 40
