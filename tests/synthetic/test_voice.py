"""Laws of the voice: deterministic, and its words are where it says they are."""

import itertools

import numpy as np
import pytest

from zeggs_jax.synthetic import phones, prosody, sentences, voice

TEXT = "the old baker carried a golden kettle, and then my sister opened this window. nobody answered."


def test_same_seed_same_samples_and_another_seed_differs():
    wave, words = voice.speak(TEXT, 3)
    again, words_again = voice.speak(TEXT, 3)
    other, _ = voice.speak(TEXT, 4)
    assert wave.dtype == np.float32
    np.testing.assert_array_equal(wave, again)
    assert words == words_again
    assert wave.shape != other.shape or np.abs(wave - other).max() > 0.01


@pytest.mark.parametrize("seed", range(4))
def test_words_are_loud_and_pauses_silent(seed):
    wave, words = voice.speak(TEXT, seed)
    level = prosody.envelope(wave)
    time = (np.arange(len(level)) + 0.5) / prosody.ENVELOPE_HZ
    spoken = np.any([(w.start <= time) & (time < w.end) for w in words], axis=0)
    near = np.any([(w.start - 0.06 <= time) & (time < w.end + 0.06) for w in words], axis=0)
    assert np.mean(level[spoken] > prosody.SILENT) > 0.85  # stops close the mouth for a moment
    assert level[~near].max() < prosody.SILENT
    assert [w.text for w in words] == [w.rstrip(",.") for w in TEXT.split()]
    assert all(a.end <= b.start + 1e-9 for a, b in itertools.pairwise(words))
    assert all(w.start < w.nucleus < w.end for w in words)


def test_stressed_vowels_are_louder_than_weak_words():
    wave, words = voice.speak(sentences.monologue(5, 40), 5)
    level = prosody.envelope(wave)
    at = {
        stressed: [level[int(w.nucleus * 100)] for w in words if w.stressed == stressed] for stressed in (True, False)
    }
    assert np.mean(at[True]) > 1.5 * np.mean(at[False])


def test_commas_and_stops_make_pauses():
    _, words = voice.speak(TEXT, 0)
    gaps = {a.text: b.start - a.end for a, b in itertools.pairwise(words)}
    assert 0.2 < gaps["kettle"] < 0.5 < gaps["window"]
    assert sum(gap > 0.1 for gap in gaps.values()) == 2


def test_pitch_is_the_voices():
    """The autocorrelation of a long vowel peaks at the voice's period."""
    for pitch in (100.0, 200.0):
        wave, words = voice.speak("oo", 0, voice.Voice(pitch=pitch, pace=0.3, liveliness=0.0))
        piece = wave[int(words[0].nucleus * 16000) :][:1600].astype(float)
        lags = np.arange(int(0.6 * 16000 / pitch), int(1.4 * 16000 / pitch))
        best = lags[np.argmax([np.dot(piece[:-320], piece[lag : lag + 1280]) for lag in lags])]
        assert abs(16000 / best / pitch - 1.0) < 0.15


def test_every_word_has_a_vowel_and_weak_words_no_stress():
    for word in ("strengths", "a", "mmm", "yellow", "quiet", "nth"):
        parts = phones.syllables(word)
        assert parts
        assert all(any(p.vowel for p in part.phones) for part in parts)
    assert len(phones.syllables("carpenter")) == 3
    assert [s.stressed for s in phones.syllables("garden")] == [True, False]
    assert not phones.syllables("the")[0].stressed


def test_nothing_to_say_is_an_error():
    with pytest.raises(ValueError, match="at least one word"):
        voice.speak(" ... ", 0)
