"""Prosody measured from a wave finds what the voice knows."""

import numpy as np
import pytest

from zeggs_jax.synthetic import prosody, sentences, voice


@pytest.mark.parametrize("seed", range(3))
def test_measured_stresses_are_the_known_ones(seed):
    wave, words = voice.speak(sentences.monologue(seed, 40), seed)
    known, heard = prosody.known(words, wave), prosody.measure(wave)
    nearest = np.abs(known.time[:, None] - heard.time[None]).min(axis=1)
    assert np.mean(nearest < 0.08) > 0.9
    assert len(heard.time) < 1.3 * len(known.time)
    assert np.all(np.diff(known.time) > 0)
    assert np.all(np.diff(heard.time) > 0)


def test_loudness_and_silence_around_do_not_matter():
    wave, _ = voice.speak(sentences.monologue(1, 20), 1)
    plain, soft = prosody.measure(wave), prosody.measure(0.01 * np.pad(wave, (16000, 8000)))
    np.testing.assert_allclose(soft.time - 1.0, plain.time, atol=0.011)
    np.testing.assert_allclose(soft.strength, plain.strength, rtol=0.05)
    np.testing.assert_allclose(soft.phrases - 1.0, plain.phrases, atol=0.021)


@pytest.mark.parametrize("samples", [0, 100, 16000])
def test_silence_has_no_events(samples):
    heard = prosody.measure(np.zeros(samples, np.float32))
    assert heard.time.shape == (0,)
    assert heard.phrases.shape == (0, 2)
    assert heard.seconds == samples / 16000
