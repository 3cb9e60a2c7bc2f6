"""Speech features: finite for every length, in step with the motion, and what the released recipe implies."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.speech import features


def noise(samples: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=samples).astype(np.float32) * 0.1


@settings(max_examples=60, deadline=None)
@given(samples=st.integers(1, 20000), rate_hz=st.sampled_from([24, 25, 30, 50, 60, 120]))
def test_every_length_and_rate_gives_finite_rows(samples, rate_hz):
    rows = features.extract(noise(samples), rate_hz=rate_hz)
    assert rows.shape == (round(rate_hz * samples / 16000), 81)
    assert rows.dtype == np.float32
    assert np.isfinite(rows).all()


def test_rows_of_half_the_rate_are_every_other_row():
    wave = noise(32000)
    np.testing.assert_array_equal(features.extract(wave, rate_hz=30), features.extract(wave, rate_hz=60)[::2])


def test_rows_at_the_spectrogram_rate_are_the_spectrogram():
    wave = noise(16000)
    quiet = features.SpeechFeatureConfig(normalize_loudness=False)
    rows = features.extract(wave, rate_hz=80, config=quiet)
    np.testing.assert_allclose(rows[:, :80], features.log_mel(wave), atol=1e-7)


@pytest.mark.parametrize("samples", [2000, 3600, 10000, 21200])
def test_the_released_nan_row_comes_only_on_request(samples):
    wave = noise(samples)
    ours, released = features.extract(wave), features.extract(wave, as_released=True)
    assert np.isnan(released[-1, :80]).all()
    assert np.isfinite(released[:-1]).all()
    assert np.isfinite(released[:, 80]).all()
    np.testing.assert_array_equal(ours[:-1], released[:-1])
    assert np.isfinite(ours).all()


def test_frames_behind_the_speech_repeat_its_last():
    rows = features.extract(noise(16000), frames=100)
    assert rows.shape == (100, 81)
    np.testing.assert_array_equal(rows[70:], np.repeat(rows[70:71], 30, axis=0))


def test_long_recordings_are_taken_in_pieces(monkeypatch):
    wave = noise(48000)
    whole = features.extract(wave)
    monkeypatch.setattr(features, "BLOCK", 37)
    np.testing.assert_array_equal(features.extract(wave), whole)


def test_silence_is_at_the_floor():
    rows = features.extract(np.zeros(16000, np.float32))
    np.testing.assert_array_equal(rows[:, :80], 0)
    np.testing.assert_allclose(rows[:, 80], np.sqrt(80), rtol=1e-6)


def test_no_samples_is_an_error():
    with pytest.raises(ValueError, match="no samples"):
        features.extract(np.zeros(0, np.float32))


def test_gain_does_not_matter_once_loudness_is_levelled():
    wave = noise(16000)
    np.testing.assert_allclose(features.extract(wave), features.extract(0.05 * wave), atol=2e-5)


def test_a_tone_is_loudest_in_its_band():
    wave = np.sin(2 * np.pi * 1000 * np.arange(16000) / 16000)
    band = features.log_mel(wave)[40].argmax()
    weights = features.mel_basis()[band]
    assert 960 <= 20 * weights.argmax() <= 1040  # bins are 20 Hz wide


def test_a_click_appears_at_its_time():
    wave = np.zeros(32000, np.float32)
    wave[16000:16400] = noise(400)
    rows = features.extract(wave)
    assert abs(rows[:, 80].argmax() / 60 - 16200 / 16000) < 0.02


def test_amplitude_of_a_full_scale_tone():
    """A bin-centred cosine under a Hann window has half the window's mean as magnitude."""
    wave = np.cos(2 * np.pi * 1000 * np.arange(16000) / 16000)
    assert features.amplitude(wave)[40, 50] == pytest.approx(np.hanning(800).mean() / 2, rel=1e-3)


def test_frame_energy_is_the_root_mean_square():
    wave = 0.5 * np.sin(2 * np.pi * 200 * np.arange(16000) / 16000)
    envelope = features.frame_energy(wave)
    assert envelope.shape == (60,)
    np.testing.assert_allclose(envelope[3:-3], 0.5 / np.sqrt(2), rtol=1e-3)
    np.testing.assert_array_equal(features.frame_energy(wave, frames=80)[65:], 0)
    np.testing.assert_array_equal(features.frame_energy(np.zeros(16000)), 0)


@settings(max_examples=30, deadline=None)
@given(samples=st.integers(1, 9000), rate_hz=st.sampled_from([30, 60]), gain=st.floats(0.01, 10))
def test_frame_energy_scales_with_the_wave(samples, rate_hz, gain):
    wave = noise(samples, seed=samples)
    louder = features.frame_energy(gain * wave, rate_hz=rate_hz)
    np.testing.assert_allclose(louder, gain * features.frame_energy(wave, rate_hz=rate_hz), rtol=1e-4)


LOG = features.SpeechFeatureConfig(log_mel=True)


def test_log_mels_are_logarithms_of_mel_amplitudes():
    wave = noise(16000)
    quiet = replace(LOG, normalize_loudness=False)
    mel = features.amplitude(wave) @ features.mel_basis().T
    rows = features.extract(wave, rate_hz=80, config=quiet)
    np.testing.assert_allclose(rows[:, :80], np.log(mel), atol=1e-5)
    np.testing.assert_allclose(rows[:, 80], np.log(np.linalg.norm(mel, axis=1)), atol=1e-5)


def test_ten_times_the_sound_is_a_step_of_ln_10_in_every_log_feature():
    quiet = replace(LOG, normalize_loudness=False)
    soft, loud = (features.extract(gain * noise(16000), config=quiet) for gain in (1.0, 10.0))
    np.testing.assert_allclose(loud - soft, np.log(10.0), atol=1e-4)


def test_silence_is_at_the_floor_of_the_log_features():
    rows = features.extract(np.zeros(16000, np.float32), config=LOG)
    np.testing.assert_allclose(rows[:, :80], np.log(1e-6), rtol=1e-6)
    np.testing.assert_allclose(rows[:, 80], np.log(1e-6 * np.sqrt(80)), rtol=1e-6)


def test_log_features_use_their_range():
    """Speech that comes and goes moves them by several units; the released mels stay within 0.12."""
    wave = noise(32000) * np.repeat([1.0, 0.01, 0.3, 0.0], 8000).astype(np.float32)
    released, log = features.extract(wave), features.extract(wave, config=LOG)
    assert released[:, :80].max() < 0.12
    assert log.std(axis=0).min() > 1.0
    assert np.isfinite(log).all()


@pytest.mark.parametrize(
    ("wrong", "named"),
    [({"hop": 0}, "hop is 0"), ({"log_floor": 0.0}, "log_floor is 0"), ({"mel_max_hz": 9000}, "to 9000 Hz")],
)
def test_features_that_cannot_be_are_refused(wrong, named):
    with pytest.raises(ValueError, match=named):
        features.SpeechFeatureConfig(**wrong)


@pytest.mark.parametrize("changed", [{}, {"mels": 40, "mel_max_hz": 900}, {"rate_hz": 48000, "window": 2400}])
def test_mel_filters_are_librosas(changed):
    from librosa.filters import mel

    config = replace(features.RELEASED, **changed)
    band = {"fmin": config.mel_min_hz, "fmax": config.mel_max_hz}
    theirs = mel(sr=config.rate_hz, n_fft=config.window, n_mels=config.mels, **band, dtype=np.float64)
    np.testing.assert_allclose(features.mel_basis(config), theirs, rtol=0, atol=1e-12)
