"""Speech features (ZeroEGGS Sec. 3.1): 80 log-mel amplitudes and an energy, at the motion's frame rate.

As the paper names them (`log_mel=True`) they are the natural logarithms of mel amplitudes and of their norm. The
default is what the release computes, and its weights expect.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, Float32

from zeggs_jax.speech import wav

BLOCK = 256  # spectrogram frames at a time: their windows stay in the CPU's cache
MELS = 16  # of one product


@dataclass(frozen=True)
class SpeechFeatureConfig:
    """The release's audio settings; the energy column comes on top of the mels.

    The floor of the amplitude is `min_clipping / window`; its level is 0 and full scale is 1 on the feature's
    dB scale. With `log_mel` the floor is `log_floor`, and every feature gets statistics of its own.
    """

    rate_hz: int = 16000
    window: int = 800  # samples, 50 ms; also the length of the FFT
    hop: int = 200  # samples, 12.5 ms
    mels: int = 80
    mel_min_hz: float | int = 20
    mel_max_hz: float | int = 7600
    min_clipping: float = 1e-5
    normalize_loudness: bool = True
    log_mel: bool = False  # true log-mels and log-energy instead of the released features
    log_floor: float = 1e-6  # mel amplitude, 78 dB below a full-scale tone

    def __post_init__(self) -> None:
        for name in ("rate_hz", "window", "hop", "mels"):
            if getattr(self, name) < 1:
                raise ValueError(f"SpeechFeatureConfig.{name} is {getattr(self, name)}; it must be at least 1.")
        for name in ("min_clipping", "log_floor"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(
                    f"SpeechFeatureConfig.{name} is {getattr(self, name)}; it must be above 0 and below 1."
                )
        if not 0 <= self.mel_min_hz < self.mel_max_hz <= self.rate_hz / 2:
            raise ValueError(
                f"SpeechFeatureConfig has mels from {self.mel_min_hz} to {self.mel_max_hz} Hz; they must rise and end "
                f"at {self.rate_hz / 2:g} Hz, half the rate."
            )

    @property
    def size(self) -> int:
        """Number of columns: the mels and the energy."""
        return self.mels + 1


RELEASED = SpeechFeatureConfig()


def extract(
    wave: Float[ArrayLike, " n"],
    frames: int | None = None,
    rate_hz: float | int = 60.0,
    config: SpeechFeatureConfig = RELEASED,
    as_released: bool = False,
) -> Float32[np.ndarray, "T D"]:
    """Waveform at config.rate_hz -> `frames` rows of (mels, energy); by default round(rate_hz * duration).

    Row t is the spectrogram at time t / rate_hz, linearly interpolated. Times behind the last spectrogram
    frame take that frame; `as_released` gives the release's NaN mels and extrapolated energy there instead.
    Digital silence and clips shorter than the window give finite rows.
    """
    wave = np.asarray(wave, np.float32)
    if wave.size == 0:
        raise ValueError("The waveform holds no samples, speech was expected; give a recording that is not empty.")
    if frames is None:
        frames = frame_count(wave.size, rate_hz, config)
    if config.normalize_loudness:
        wave = wav.normalize_loudness(wave, config.rate_hz)
    rows = with_energy(log_mel(wave, config), config)
    positions = config.rate_hz / config.hop / rate_hz * np.arange(frames)
    if as_released:
        resampled = interpolate(rows, positions)
        resampled[positions > len(rows) - 1, : config.mels] = np.nan
    else:
        resampled = interpolate(rows, np.minimum(positions, len(rows) - 1))
    return resampled.astype(np.float32, copy=False)


def frame_count(samples: int, rate_hz: float | int = 60.0, config: SpeechFeatureConfig = RELEASED) -> int:
    """Motion frames of a recording: rate times duration, rounded half to even, as released."""
    return round(rate_hz * samples / config.rate_hz)


def log_mel(wave: Float[ArrayLike, " n"], config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "F M"]:
    """The release's "log amplitude" of each mel band, float32, at rate_hz / hop frames a second.

    The paper says log mel amplitude; the release takes the dB already mapped to [0, 1] for dB and so scales
    it by ln(10) / 20 (range [0, 0.115]). We follow the release, unless `config.log_mel` asks for ln(amplitude).
    """
    return level(mel_amplitude(_frames(wave, config), config), config)


def mel_amplitude(
    framed: Float[np.ndarray, "F W"],
    config: SpeechFeatureConfig = RELEASED,
    rfft: Callable[..., Any] | None = None,
) -> Float32[np.ndarray, "F M"]:
    """Amplitude in each mel band of windows of the waveform; a louder recording's is that many times as large.

    `rfft` is numpy's or, by default, scipy's: of many windows three times as fast, and 0.2 s to import.
    """
    made = np.empty((len(framed), config.mels), np.float32)
    for start in range(0, len(framed), BLOCK):
        amplitudes = _magnitude(framed[start : start + BLOCK], config, rfft)
        for mels, bins, weights in _bands(config):
            made[start : start + BLOCK, mels] = amplitudes[:, bins] @ weights
    return made


@lru_cache(maxsize=8)
def _bands(config: SpeechFeatureConfig) -> list[tuple[slice, slice, Float32[np.ndarray, "b m"]]]:
    """Some mels at a time, the bins that they hear, and their filters of these: the rest of them is zeros."""
    basis, bands = mel_basis(config).astype(np.float32), []
    for first in range(0, config.mels, MELS):
        mels = slice(first, first + MELS)
        heard = np.flatnonzero(basis[mels].any(0))
        bins = slice(int(heard[0]), int(heard[-1]) + 1) if heard.size else slice(0, 1)
        bands.append((mels, bins, np.ascontiguousarray(basis[mels, bins].T)))
    return bands


def level(mel: Float[np.ndarray, "F M"], config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "F M"]:
    """Mel amplitudes -> what `log_mel` says."""
    if config.log_mel:
        return np.log(np.maximum(mel, config.log_floor))
    return math.log(10.0) / 20.0 * decibels(mel, config)


def with_energy(mels: Float[np.ndarray, "F M"], config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "F D"]:
    """What `log_mel` gives, and the energy as a last column."""
    rows = np.empty((len(mels), config.size), mels.dtype)
    rows[:, :-1] = mels
    rows[:, -1] = np.log(energy(mels)) if config.log_mel else energy(mels)
    return rows


def energy(log_mels: Float[np.ndarray, "F M"]) -> Float[np.ndarray, " F"]:
    """The release's energy: norm of exp(log mel) over the bands. Silence is sqrt(80); see `frame_energy`."""
    mels = np.exp(log_mels)
    return np.sqrt(np.einsum("fm,fm->f", mels, mels))


def amplitude(wave: Float[ArrayLike, " n"], config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "F K"]:
    """Spectrogram |rfft| / window, symmetric Hann window, centred frames, reflected edges; float32."""
    return _magnitude(_frames(wave, config), config)


def _frames(wave: Float[ArrayLike, " n"], config: SpeechFeatureConfig) -> Float[np.ndarray, "F W"]:
    """The pieces of the wave that the spectrogram sees, as a view."""
    wave = np.asarray(wave, np.float32)
    wave = np.pad(wave, (0, max(0, config.window - wave.size)))
    count = -(-wave.size // config.hop)
    padded = np.pad(wave, config.window // 2, mode="reflect")
    return np.lib.stride_tricks.sliding_window_view(padded, config.window)[:: config.hop][:count]


def _magnitude(
    framed: Float[np.ndarray, "F W"], config: SpeechFeatureConfig, rfft: Callable[..., Any] | None = None
) -> Float[np.ndarray, "F K"]:
    if rfft is None:
        from scipy.fft import rfft
    return np.abs(rfft(np.asarray(framed, np.float32) * _window(config.window), axis=1))


@lru_cache(maxsize=8)
def _window(size: int) -> Float32[np.ndarray, " size"]:
    return (hann(size) / size).astype(np.float32)


def hann(size: int) -> Float[np.ndarray, " size"]:
    """The symmetric Hann window."""
    return np.hanning(size)


@lru_cache(maxsize=8)
def mel_basis(config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "M K"]:
    """Triangular mel filters of equal area, on M. Slaney's scale (Auditory Toolbox, 1998), to be applied to amplitudes.

    They are those of librosa, which takes a second to import.
    """
    low, high = (_slaney(float(hz)) for hz in (config.mel_min_hz, config.mel_max_hz))
    edges = _slaney_hz(np.linspace(low, high, config.mels + 2))[:, None]
    bins = np.arange(config.window // 2 + 1) * config.rate_hz / config.window
    width = np.diff(edges, axis=0)
    rising, falling = (bins - edges[:-2]) / width[:-1], (edges[2:] - bins) / width[1:]
    return np.maximum(np.minimum(rising, falling), 0.0) * 2.0 / (edges[2:] - edges[:-2])


STEP, CORNER, OCTAVES = 200.0 / 3.0, 15.0, math.log(6.4) / 27.0  # Hz a mel; the mel of 1 kHz; above, so much in log Hz


def _slaney(hz: float) -> float:
    mel = hz / STEP
    return mel if mel < CORNER else CORNER + math.log(mel / CORNER) / OCTAVES


def _slaney_hz(mels: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    above = STEP * CORNER * np.exp(OCTAVES * (mels - CORNER))
    return np.where(mels < CORNER, STEP * mels, above)


def decibels(mel: Float[np.ndarray, "F M"], config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "F M"]:
    """Amplitude -> level, 0 at the floor of the amplitude and 1 at amplitude 1."""
    floor = config.min_clipping / config.window
    return np.log(np.maximum(mel, floor) / floor) / -math.log(floor)


def frame_energy(
    wave: Float[ArrayLike, " n"],
    frames: int | None = None,
    rate_hz: float | int = 60.0,
    window_s: float | int = 0.05,
    wave_rate_hz: int = wav.RATE_HZ,
) -> Float32[np.ndarray, " T"]:
    """True loudness envelope (ours): root mean square of the samples in `window_s` around each motion frame.

    Windows are cut at the ends of the recording; frames that lie wholly behind it are 0.
    """
    squares = np.asarray(wave, np.float64) ** 2
    if frames is None:
        frames = round(rate_hz * squares.size / wave_rate_hz)
    total = np.concatenate([[0.0], np.cumsum(squares)])
    centre = np.arange(frames) / rate_hz * wave_rate_hz
    half = window_s * wave_rate_hz / 2
    start = np.clip(np.round(centre - half).astype(int), 0, squares.size)
    stop = np.clip(np.round(centre + half).astype(int), 0, squares.size)
    mean = (total[stop] - total[start]) / np.maximum(stop - start, 1)
    return np.sqrt(np.maximum(mean, 0.0)).astype(np.float32)


def interpolate(rows: Float[np.ndarray, "F D"], positions: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T D"]:
    """Rows at fractional positions, linear between neighbours, extrapolated behind the last."""
    if len(rows) == 1:
        return np.repeat(rows, len(positions), axis=0)
    left = np.minimum(positions.astype(int), len(rows) - 2)
    weight = (positions - left)[:, None].astype(rows.dtype)
    return (1.0 - weight) * rows.take(left, axis=0) + weight * rows.take(left + 1, axis=0)
