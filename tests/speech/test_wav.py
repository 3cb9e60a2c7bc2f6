"""Speech files: every format reads alike, bad ones say why, loudness and silence stay finite."""

import numpy as np
import pytest
import soundfile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from zeggs_jax.speech import wav


def tone(seconds: float = 1.0, rate_hz: int = 16000, hz: float = 440.0) -> np.ndarray:
    return 0.3 * np.sin(2 * np.pi * hz * np.arange(round(seconds * rate_hz)) / rate_hz)


@pytest.mark.parametrize("rate_hz", [8000, 11025, 16000, 22050, 32000, 44100, 48000, 96000])
@pytest.mark.parametrize("channels", [1, 2, 6])
def test_rates_and_channels_give_the_same_tone(tmp_path, rate_hz, channels):
    path = tmp_path / "tone.wav"
    soundfile.write(path, np.repeat(tone(1.0, rate_hz)[:, None], channels, axis=1), rate_hz, subtype="FLOAT")
    wave = wav.read(path)
    assert wave.dtype == np.float32
    assert len(wave) == 16000
    np.testing.assert_allclose(wave[800:-800], tone()[800:-800], atol=2e-4)  # away from the resampler's edges


@pytest.mark.parametrize(
    ("suffix", "subtype", "step"),
    [("wav", "PCM_U8", 2**-7), ("wav", "PCM_16", 2**-15), ("wav", "PCM_24", 2**-23),
     ("wav", "PCM_32", 2**-24),
     ("wav", "FLOAT", 2**-24), ("wav", "DOUBLE", 2**-24), ("flac", "PCM_16", 2**-15),
     ("flac", "PCM_24", 2**-23), ("ogg", "VORBIS", 0.02)],
)  # fmt: skip
def test_sample_formats_differ_by_their_step(tmp_path, suffix, subtype, step):
    path = tmp_path / f"tone.{suffix}"
    soundfile.write(path, tone(), 16000, subtype=subtype)
    np.testing.assert_allclose(wav.read(path), tone(), atol=1.01 * step + 1e-7)


def test_channels_are_averaged(tmp_path):
    path = tmp_path / "stereo.wav"
    soundfile.write(path, np.stack([tone(), np.zeros(16000)], axis=1), 16000, subtype="FLOAT")
    np.testing.assert_allclose(wav.read(path), tone() / 2, atol=1e-7)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(samples=st.integers(1, 5000), rate_hz=st.sampled_from([8000, 22050, 44100, 48000]))
def test_length_follows_the_duration(tmp_path, samples, rate_hz):
    path = tmp_path / "noise.wav"
    soundfile.write(path, np.random.default_rng(samples).uniform(-0.5, 0.5, samples), rate_hz)
    if round(samples * 16000 / rate_hz) < 1:
        return
    wave = wav.read(path)
    assert abs(len(wave) - samples * 16000 / rate_hz) <= 1
    assert np.isfinite(wave).all()


def test_written_samples_come_back(tmp_path):
    path = tmp_path / "out.wav"
    wav.write(path, tone())
    np.testing.assert_allclose(wav.read(path), tone(), atol=2**-15)
    wav.write(path, np.array([-3.0, -1.0, 0.0, 1.0, 3.0]))
    np.testing.assert_array_equal(wav.read(path), np.float32([-1, -1, 0, 32767 / 32768, 32767 / 32768]))
    assert [p.name for p in tmp_path.iterdir()] == ["out.wav"]  # no temporary file stays


def test_writing_twice_gives_the_same_bytes(tmp_path):
    for name in ("a.wav", "b.wav"):
        wav.write(tmp_path / name, tone())
    assert (tmp_path / "a.wav").read_bytes() == (tmp_path / "b.wav").read_bytes()


def test_writing_into_a_missing_folder_says_so(tmp_path):
    with pytest.raises(OSError, match=r"Cannot write '.*out.wav'"):
        wav.write(tmp_path / "absent" / "out.wav", tone())


def _bad_files(folder):
    (folder / "text.wav").write_text("this is no sound\n" * 50)
    (folder / "bytes.raw").write_bytes(b"\0" * 100)
    (folder / "nothing.wav").write_bytes(b"")
    soundfile.write(folder / "empty.wav", np.zeros(0), 16000)
    soundfile.write(folder / "nan.wav", np.array([0.1, np.nan, 0.2]), 16000, subtype="FLOAT")
    (folder / "folder.wav").mkdir()


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [("absent.wav", FileNotFoundError, "does not exist"), ("text.wav", ValueError, "not an audio file"),
     ("bytes.raw", ValueError, "not an audio file"), ("nothing.wav", ValueError, "not an audio file"),
     ("empty.wav", ValueError, "no samples"), ("nan.wav", ValueError, "NaN"),
     ("folder.wav", ValueError, "is a folder")],
)  # fmt: skip
def test_bad_files_say_what_is_wrong_in_one_sentence(tmp_path, name, error, words):
    _bad_files(tmp_path)
    with pytest.raises(error, match=words) as caught:
        wav.read(tmp_path / name)
    message = str(caught.value)
    assert name in message
    assert "\n" not in message
    assert message.endswith(".")


@settings(max_examples=30, deadline=None)
@given(gain_db=st.floats(-40, 20), seed=st.integers(0, 99))
def test_loudness_is_levelled_whatever_the_gain(gain_db, seed):
    noise = np.random.default_rng(seed).normal(size=16000) * 0.1 * 10 ** (gain_db / 20)
    levelled = wav.normalize_loudness(noise)
    assert wav.loudness(levelled) == pytest.approx(-20.0, abs=1e-3)
    np.testing.assert_allclose(wav.normalize_loudness(levelled), levelled, rtol=1e-3, atol=1e-6)


def test_silence_and_nearly_silence_stay_as_they_are():
    assert wav.loudness(np.zeros(16000)) == -np.inf
    np.testing.assert_array_equal(wav.normalize_loudness(np.zeros(16000)), np.zeros(16000))
    hiss = np.full(16000, 1e-6, np.float32)
    np.testing.assert_array_equal(wav.normalize_loudness(hiss), hiss)


@pytest.mark.parametrize("samples", [1, 2, 100, 1600, 6399, 6400, 6401])
def test_short_clips_are_levelled_too(samples):
    noise = np.random.default_rng(0).normal(size=samples) * 0.01
    levelled = wav.normalize_loudness(noise)
    assert levelled.shape == (samples,)
    assert np.isfinite(levelled).all()
    if samples >= 1600:
        assert wav.loudness(levelled) == pytest.approx(-20, abs=0.01)


def test_silence_keeps_the_regions_only():
    wave = np.ones(16000, np.float32)
    kept = wav.silence(wave, [(0.1, 0.25), (0.9, 5.0)])
    expected = np.zeros(16000)
    expected[1600:4000] = expected[14400:] = 1
    np.testing.assert_array_equal(kept, expected)
    np.testing.assert_array_equal(wav.silence(wave, []), np.zeros(16000))


def test_retime_shortens_and_raises_the_pitch():
    quick = wav.retime(tone(hz=100.0), 0.9)
    assert len(quick) == 14400
    crossings = np.sum(np.diff(np.sign(quick)) != 0)
    assert crossings == pytest.approx(199, abs=2)  # the same waves in less time
    np.testing.assert_allclose(wav.retime(tone(), 1.0), tone(), atol=1e-6)


def test_real_voices_read(shared):
    files = sorted((shared / "data" / "speech_clean").glob("*.wav"))
    if not files:
        pytest.skip("no real voices here")
    for file in files:
        wave = wav.read(file)
        assert len(wave) > 16000
        assert wav.loudness(wav.normalize_loudness(wave)) == pytest.approx(-20, abs=1e-3)


@pytest.mark.parametrize("rate_hz", [16000, 22050, 48000])
@pytest.mark.parametrize("seconds", [0.4, 0.449, 0.451, 1.26, 7.7])
def test_loudness_is_what_pyloudnorm_measures(seconds, rate_hz):
    import pyloudnorm

    rng = np.random.default_rng(round(1000 * seconds))
    wave = rng.normal(size=round(seconds * rate_hz))
    wave *= 10.0 ** np.repeat(rng.uniform(-4, 0, wave.size // 2000 + 1), 2000)[: wave.size]  # with pauses
    assert wav.loudness(wave, rate_hz) == pytest.approx(pyloudnorm.Meter(rate_hz).integrated_loudness(wave), abs=1e-9)
