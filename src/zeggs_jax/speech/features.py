"""Speech features (ZeroEGGS Sec. 3.1): 80 log-mel amplitudes and an energy, at the motion's frame rate.

As the paper names them (`log_mel=True`) they are the natural logarithms of mel amplitudes and of their norm. The
default is what the release computes, and its weights expect.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, Float32

from zeggs_jax.speech import wav

BLOCK = 256  # spectrogram frames at a time: their windows stay in the CPU's cache


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
    return resampled.astype(np.float32)


def frame_count(samples: int, rate_hz: float | int = 60.0, config: SpeechFeatureConfig = RELEASED) -> int:
    """Motion frames of a recording: rate times duration, rounded half to even, as released."""
    return round(rate_hz * samples / config.rate_hz)


def log_mel(wave: Float[ArrayLike, " n"], config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "F M"]:
    """The release's "log amplitude" of each mel band, float64, at rate_hz / hop frames a second.

    The paper says log mel amplitude; the release takes the dB already mapped to [0, 1] for dB and so scales
    it by ln(10) / 20 (range [0, 0.115]). We follow the release, unless `config.log_mel` asks for ln(amplitude).
    """
    framed = _frames(wave, config)
    blocks = [framed[start : start + BLOCK] for start in range(0, len(framed), BLOCK)]
    return level(np.concatenate([mel_amplitude(block, config) for block in blocks]), config)


def mel_amplitude(framed: Float[np.ndarray, "F W"], config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "F M"]:
    """Amplitude in each mel band of windows of the waveform; a louder recording's is that many times as large."""
    return (_magnitude(framed, config) @ mel_basis(config).T.astype(np.float32)).astype(np.float64)


def level(mel: Float[np.ndarray, "F M"], config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "F M"]:
    """Mel amplitudes -> what `log_mel` says."""
    if config.log_mel:
        return np.log(np.maximum(mel, config.log_floor))
    return np.log(10.0) / 20.0 * decibels(mel, config)


def with_energy(mels: Float[np.ndarray, "F M"], config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "F D"]:
    """What `log_mel` gives, and the energy as a last column."""
    loud = np.log(energy(mels)) if config.log_mel else energy(mels)
    return np.concatenate([mels, loud[:, None]], axis=1)


def energy(log_mels: Float[np.ndarray, "F M"]) -> Float[np.ndarray, " F"]:
    """The release's energy: norm of exp(log mel) over the bands. Silence is sqrt(80); see `frame_energy`."""
    return np.linalg.norm(np.exp(log_mels), axis=1)


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


def _magnitude(framed: Float[np.ndarray, "F W"], config: SpeechFeatureConfig) -> Float[np.ndarray, "F K"]:
    from scipy.fft import rfft  # of many windows in float32, twice as fast as numpy's

    window = np.float32(hann(config.window) / config.window)
    return np.abs(rfft(np.asarray(framed, np.float32) * window, axis=1))  # pyright: ignore[reportCallIssue, reportArgumentType]


def hann(size: int) -> Float[np.ndarray, " size"]:
    """The symmetric Hann window."""
    return np.hanning(size)


@lru_cache(maxsize=8)
def mel_basis(config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "M K"]:
    """Triangular mel filters, Slaney scale and area, to be applied to amplitudes."""
    from librosa.filters import mel  # 1 s to import (and librosa.stft 12 s more, hence `amplitude` above)

    return mel(
        sr=config.rate_hz,
        n_fft=config.window,
        n_mels=config.mels,
        fmin=config.mel_min_hz,
        fmax=config.mel_max_hz,
        htk=False,
        norm="slaney",
        dtype=np.float64,
    )


def decibels(mel: Float[np.ndarray, "F M"], config: SpeechFeatureConfig = RELEASED) -> Float[np.ndarray, "F M"]:
    """Amplitude -> level, 0 at the floor of the amplitude and 1 at amplitude 1."""
    floor = config.min_clipping / config.window
    span = -20.0 * np.log10(floor)
    return (20.0 * np.log10(np.maximum(mel, floor)) + span) / span


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
    weight = (positions - left)[:, None]
    return (1.0 - weight) * rows[left] + weight * rows[left + 1]
