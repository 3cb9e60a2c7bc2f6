"""Laws of live features: those of the whole recording, however it is pushed; loudness is that of pyloudnorm."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.speech import features, wav
from zeggs_jax.speech.features import SpeechFeatureConfig
from zeggs_jax.speech.live import LIMIT_DB, LiveFeatures, delay_s
from zeggs_jax.speech.loudness import RunningLoudness

AS_IS = SpeechFeatureConfig(normalize_loudness=False)


def speech(samples: int, seed: int = 0) -> np.ndarray:
    """Noise in syllables of different loudness."""
    rng = np.random.default_rng(seed)
    level = np.repeat(rng.uniform(0.0, 0.3, samples // 1600 + 1), 1600)[:samples]
    return (level * rng.normal(size=samples)).astype(np.float32)


def live(wave, sizes, rate_hz=60.0, config=AS_IS, loudness=None) -> np.ndarray:
    """All rows of a recording pushed in pieces of these sizes, over and over."""
    stream, found, start = LiveFeatures(rate_hz, config, loudness), [], 0
    while start < len(wave):
        for size in sizes:
            found.append(stream.hear(wave[start : start + size]))
            start += size
    return np.concatenate([*found, stream.finish()])


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 9000),
    st.lists(st.integers(1, 4000), min_size=1, max_size=5),
    st.sampled_from([60.0, 30.0, 29.97, 120.0]),
)
def test_live_rows_are_those_of_the_whole_recording(samples, sizes, rate_hz):
    wave = speech(samples, samples)
    expected = features.extract(wave, rate_hz=rate_hz, config=AS_IS)
    found = live(wave, sizes, rate_hz)
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("changed", [{"log_mel": True}, {"window": 801, "hop": 201}, {"window": 400, "hop": 400}])
def test_so_they_are_with_other_settings(changed):
    config, wave = dataclasses.replace(AS_IS, **changed), speech(7777)
    expected = features.extract(wave, config=config)
    np.testing.assert_allclose(live(wave, [333, 1, 2000], config=config), expected, atol=1e-6)


def test_a_known_loudness_is_that_of_the_whole_recording():
    config, wave = SpeechFeatureConfig(), 0.05 * speech(20_000)
    expected = features.extract(wave, config=config)
    found = live(wave, [512], config=config, loudness=wav.loudness(wave))
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert np.abs(live(wave, [512], config=config, loudness=-20.0) - expected).max() > 1e-3


def test_silence_gives_the_rows_of_silence():
    wave = np.zeros(8000, np.float32)
    np.testing.assert_array_equal(live(wave, [100], config=SpeechFeatureConfig()), features.extract(wave))


@pytest.mark.parametrize("rate_hz", [60.0, 30.0, 29.97])
def test_a_row_is_certain_within_the_delay_told(rate_hz):
    wave, stream, delays, row = speech(16_000), LiveFeatures(rate_hz, AS_IS), [], 0
    for n in range(0, len(wave), 10):
        for _ in stream.hear(wave[n : n + 10]):
            delays.append((n + 10) / 16_000 - row / rate_hz)
            row += 1
    least, most = delay_s(rate_hz, AS_IS)
    late = delays[1:]  # row 0 also waits for its reflection
    near = 20 / 16_000 + (0.004 if rate_hz == 29.97 else 0.0)  # which takes a hundred seconds to meet all cases
    assert least - 1e-9 <= min(late) < least + near
    assert most - near < max(late) <= most + 10 / 16_000 + 1e-9


def test_running_loudness_is_that_of_the_recording_so_far():
    wave = np.concatenate([np.zeros(8000), speech(48_000), 0.01 * speech(32_000), speech(40_000, 1)])
    meter, found = RunningLoudness(), []
    for start in range(0, len(wave), 1111):
        found += meter.hear(wave[start : start + 1111])
    assert len(found) == len(wave) // 1600
    assert np.isneginf(found[4])
    for step in (9, 20, 40, 79):
        assert found[step] == pytest.approx(wav.loudness(wave[: (step + 1) * 1600]), abs=0.1)


def test_running_loudness_knows_no_push_sizes_and_ends_where_it_should():
    config, wave = SpeechFeatureConfig(), 0.1 * speech(64_000)
    one, other = live(wave, [64_000], config=config), live(wave, [37, 1200, 5], config=config)
    np.testing.assert_allclose(one, other, atol=1e-7)
    expected = features.extract(wave, config=config)
    assert np.abs(one[-60:] - expected[-60:]).max() < 2e-3  # the last second, in ln(10) / 20 of the dB scale
    assert np.abs(one[:6] - expected[:6]).max() > 5e-3  # before 0.4 s nothing is known


def test_faint_noise_is_not_made_speech():
    wave = 4e-3 * speech(32_000)
    loud = live(wave * 10 ** (LIMIT_DB / 20), [1600])
    np.testing.assert_allclose(live(wave, [1600], config=SpeechFeatureConfig())[40:], loud[40:], atol=1e-6)


def test_memory_stays_flat():
    stream, wave, sizes = LiveFeatures(60.0, SpeechFeatureConfig()), speech(16_000), []
    for _ in range(30):
        stream.hear(wave)
        sizes.append(sum(x.size for x in vars(stream).values() if isinstance(x, np.ndarray)))
    assert len(set(sizes[1:])) <= 2
    assert max(sizes) < 5000
