"""The clock of a voice: it stands still in pauses, and counts every voiced moment once."""

from itertools import pairwise

import numpy as np
import pytest

from zeggs_jax.speech import transcript, voiced

TONE_S = ((0.5, 1.5), (2.5, 4.5))  # s, when the made recording sounds


@pytest.fixture
def wave():
    """5 s of faint noise in which a voice is heard twice."""
    at = np.arange(5 * 16000) / 16000
    sounding = np.any([(start <= at) & (at < stop) for start, stop in TONE_S], axis=0)
    noise = np.random.default_rng(0).normal(size=len(at))
    return (0.3 * sounding * np.sin(700 * at) + 1e-3 * noise).astype(np.float32)


def test_shares_of_the_voice_leave_pauses_out(wave):
    shares = np.array([(0, 1 / 6), (1 / 6, 1 / 3), (1 / 3, 2 / 3), (2 / 3, 1)])
    wanted = [(0.5, 1.0), (1.0, 1.5), (2.5, 3.5), (3.5, 4.5)]
    np.testing.assert_allclose(voiced.times(wave, shares), wanted, atol=0.06)


def test_short_gaps_are_speech_and_clicks_are_none(wave):
    wave[16000 : 16000 + 1600] *= 0.0
    wave[2 * 16000] = 0.9
    heard = voiced.speaking(wave)
    assert heard[45:60].all()
    assert not heard[80:120].any()


@pytest.mark.parametrize("made", [np.zeros(16000), np.zeros(200)])
def test_silence_has_no_voice(made):
    assert not voiced.speaking(made).any()
    with pytest.raises(ValueError, match="no voice is heard"):
        voiced.times(made, np.array([(0.0, 1.0)]))


def test_words_of_a_plain_text_are_spoken_while_the_voice_is_heard(tmp_path, wave):
    (tmp_path / "a.txt").write_text("aa bb. cccc\ndddd\n")
    assert transcript.is_untimed(tmp_path / "a.txt")
    words = transcript.read(tmp_path / "a.txt", wave)
    assert [word.text for word in words] == ["aa", "bb.", "cccc", "dddd"]
    assert all(0.4 <= word.start < word.end <= 4.6 for word in words)
    assert all(before.end <= after.start + 1e-9 for before, after in pairwise(words))
    (tmp_path / "b.txt").write_text("0\t1\taa\n")
    assert not transcript.is_untimed(tmp_path / "b.txt")
    assert transcript.read(tmp_path / "b.txt", wave)[0].end == 1.0


@pytest.mark.parametrize(
    ("content", "given", "told"),
    [("a dog", False, "its words have no times"), ("much too much " * 30, True, "has 90 words for 3.. s of voice")],
)
def test_a_plain_text_that_cannot_be_is_one_sentence(tmp_path, wave, content, given, told):
    (tmp_path / "a.txt").write_text(content)
    with pytest.raises(ValueError, match=told):
        transcript.read(tmp_path / "a.txt", wave if given else None)
