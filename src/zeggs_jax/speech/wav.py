"""Speech as a waveform: any audio file in as 16 kHz mono, its loudness levelled, written out again."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import soundfile
import soxr
from jax.typing import ArrayLike
from jaxtyping import Float, Float32

from zeggs_jax.speech.loudness import BLOCK_S, integrated

RATE_HZ = 16000
TARGET_LUFS = -20.0

Wave = Float32[np.ndarray, " n"]
Seconds = float | int


def read(path: str | Path, rate_hz: int = RATE_HZ) -> Wave:
    """Any file that soundfile reads (WAV, FLAC, OGG...) -> mono at `rate_hz`, nominally within [-1, 1].

    Channels are averaged, then resampled by soxr at quality HQ, which is the release's `sox rate -h` to 80
    dB. Unlike the release, 8-bit silence is exactly 0 and 16 kHz stereo is mixed down. Raises
    FileNotFoundError, or ValueError when the path is a folder, not audio, without samples, or holds values
    that are not finite.
    """
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"'{path}' is a folder, a speech file was expected; give a WAV, FLAC or OGG file.")
    if not path.exists():
        raise FileNotFoundError(f"Speech file '{path}' does not exist; check the path.")
    try:
        samples, file_rate = soundfile.read(path, dtype="float32", always_2d=True)
    except (soundfile.LibsndfileError, TypeError) as error:  # TypeError: formats without a header
        raise ValueError(
            f"'{path}' is not an audio file that can be read ({_reason(error)}); give a WAV, FLAC or OGG."
        ) from error
    if not np.isfinite(samples).all():
        raise ValueError(f"'{path}' holds samples that are NaN or infinite; export the recording again.")
    wave = samples.mean(axis=1, dtype=np.float32)
    if wave.size and file_rate != rate_hz:
        wave = soxr.resample(wave, file_rate, rate_hz, quality="HQ")
    if wave.size == 0:
        raise ValueError(f"'{path}' holds no samples; give a recording that is not empty.")
    return wave


def write(path: str | Path, wave: Float[ArrayLike, " n"], rate_hz: int = RATE_HZ) -> None:
    """Write mono 16-bit samples; values outside [-1, 1) are clipped (the release lets them wrap around)."""
    path = Path(path)
    scaled = np.trunc(np.asarray(wave, np.float64) * 32768.0)  # towards zero, as the release
    samples = np.clip(scaled, -32768, 32767).astype(np.int16)
    temporary = path.with_name(f"{path.name}.tmp{os.getpid()}")
    try:
        soundfile.write(temporary, samples, rate_hz, format="WAV", subtype="PCM_16")
        os.replace(temporary, path)
    except soundfile.LibsndfileError as error:
        raise OSError(f"Cannot write '{path}' ({_reason(error)}); choose a folder that is writable.") from error
    finally:
        temporary.unlink(missing_ok=True)


def loudness(wave: Float[ArrayLike, " n"], rate_hz: int = RATE_HZ) -> float:
    """Integrated loudness in LUFS (ITU-R BS.1770-4); -inf when no block is above the gate of -70 LUFS.

    A wave shorter than one block of 0.4 s is repeated to fill that block.
    """
    wave = np.asarray(wave, np.float64)
    block = int(np.ceil(BLOCK_S * rate_hz))
    return integrated(np.resize(wave, block) if wave.size < block else wave, rate_hz)


def normalize_loudness(
    wave: Float[ArrayLike, " n"], rate_hz: int = RATE_HZ, target_lufs: float | int = TARGET_LUFS
) -> Wave:
    """Scale to `target_lufs`, peaks unlimited, as released; silence (loudness -inf) comes back unchanged."""
    wave = np.asarray(wave, np.float32)
    return (wave * gain(loudness(wave, rate_hz), target_lufs)).astype(np.float32)


def gain(measured_lufs: float | int, target_lufs: float | int = TARGET_LUFS) -> float:
    """What amplitudes are multiplied by to get from one loudness to the other; 1 for silence."""
    return 10.0 ** ((target_lufs - measured_lufs) / 20.0) if np.isfinite(measured_lufs) else 1.0


def silence(wave: Float[ArrayLike, " n"], regions_s: Sequence[tuple[Seconds, Seconds]], rate_hz: int = RATE_HZ) -> Wave:
    """Zero everything outside the (start, stop) regions: the release's way to remove the other speaker."""
    wave = np.asarray(wave, np.float32)
    kept = np.zeros(wave.shape, np.float32)
    for start, stop in regions_s:
        span = slice(round(start * rate_hz), round(stop * rate_hz))
        kept[span] = wave[span]
    return kept


def retime(wave: Float[ArrayLike, " n"], factor: float | int) -> Float[np.ndarray, " m"]:
    """int(factor * n) samples of the same speech by a cubic spline, as released: 0.9 is faster and higher."""
    from scipy.interpolate import make_interp_spline

    wave = np.asarray(wave, np.float64)
    spline = make_interp_spline(np.arange(wave.size), wave, k=3)
    return spline(np.linspace(0, wave.size - 1, int(factor * wave.size)))


def _reason(error: Exception) -> str:
    return str(getattr(error, "error_string", error)).rstrip(". ")
