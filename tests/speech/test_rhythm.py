"""What the denoiser hears: onsets where sounds begin, amplitude where they are loud, and laws of both."""

import numpy as np
import pytest

from zeggs_jax.speech import rhythm, wav
from zeggs_jax.speech.rhythm import extract

HZ = 7.5
RATE = wav.RATE_HZ


def tone(seconds, beats, hz=220.0, loud=0.3):
    """A tone that is struck at each beat and dies away."""
    t = np.arange(round(seconds * RATE)) / RATE
    since = [np.where(t >= beat, t - beat, np.inf) for beat in beats]
    return (loud * sum(np.exp(-8 * s) for s in since) * np.sin(2 * np.pi * hz * t)).astype(np.float32)


@pytest.fixture(scope="module")
def speech():
    draw = np.random.default_rng(0)
    return tone(4.0, [0.5, 1.1, 1.9, 2.6, 3.3]) + 0.001 * draw.standard_normal(4 * RATE).astype(np.float32)


def test_clicks_peak_where_they_are_and_nowhere_else():
    clicks = [0.50, 1.10, 1.63, 2.31, 3.03]
    wave = np.zeros(4 * RATE, np.float32)
    for click in clicks:
        wave[round(click * RATE) : round(click * RATE) + 20] = 0.5
    heard = np.flatnonzero(extract(wave, HZ, 30)[:, 0] > 1.5)
    np.testing.assert_array_equal(heard, np.floor(np.array(clicks) * HZ))


def test_struck_tones_have_their_onsets(speech):
    onsets = extract(speech, HZ, 30)[:, 0]
    beats = np.floor(np.array([0.5, 1.1, 1.9, 2.6, 3.3]) * HZ).astype(int)
    assert set(np.argsort(onsets)[-5:]) == set(beats)


def test_amplitude_is_the_root_mean_square_of_its_samples(speech):
    levelled = wav.normalize_loudness(speech)
    start, stop = round(9 / HZ * RATE), round(10 / HZ * RATE)
    expected = np.sqrt(np.mean(levelled[start:stop].astype(np.float64) ** 2)) / rhythm.LOUD
    np.testing.assert_allclose(extract(speech, HZ, 30)[9, 1], expected, rtol=1e-5)


@pytest.mark.parametrize("gain", [0.01, 0.3, 3.0])
def test_a_louder_copy_sounds_the_same(speech, gain):
    np.testing.assert_allclose(extract(gain * speech, HZ, 30), extract(speech, HZ, 30), atol=2e-4)


def test_silence_is_zero_and_so_is_what_lies_behind_the_end(speech):
    assert not extract(np.zeros(RATE, np.float32), HZ, 7).any()
    beyond = extract(speech, HZ, 60)
    assert not beyond[31:].any()
    np.testing.assert_array_equal(beyond[:30], extract(speech, HZ, 30))


def test_what_comes_later_changes_no_onset_before(speech):
    changed = speech.copy()
    changed[2 * RATE :] = 0.0
    before = rhythm.onsets(speech)[: 2 * RATE // rhythm.SOUND.hop - 3]
    np.testing.assert_array_equal(rhythm.onsets(changed)[: len(before)], before)


def test_long_recordings_go_through_in_blocks(speech, monkeypatch):
    whole = rhythm.onsets(speech)
    monkeypatch.setattr(rhythm, "BLOCK", 37)
    np.testing.assert_allclose(rhythm.onsets(speech), whole, atol=1e-5)


def test_values_are_about_one_at_most(speech):
    heard = extract(speech, HZ, 30)
    assert heard.dtype == np.float32
    assert np.isfinite(heard).all()
    assert heard.min() >= 0.0
    assert heard.max() < 4.0


@pytest.mark.parametrize("samples", [1, 100, 900])
def test_scraps_of_sound_are_finite(samples):
    assert np.isfinite(extract(np.ones(samples, np.float32) * 0.1, HZ, 3)).all()


def test_recorded_speech_fills_the_range(shared):
    for path in (shared / "data" / "speech_clean").glob("*.wav"):
        heard = extract(wav.read(path), HZ, 20)
        assert (heard.max(0) > 0.3).all()
        assert (heard.max(0) < 2.0).all()


def test_what_cannot_be_heard_is_told():
    with pytest.raises(ValueError, match="no samples"):
        extract(np.zeros(0, np.float32), HZ, 3)
    with pytest.raises(ValueError, match="60 latents a second"):
        extract(np.zeros(100, np.float32), 60, 3)
