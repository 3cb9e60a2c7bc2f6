"""Speech features of a recording that is still going on: the rows of `features.extract`, each as soon as it is certain.

The mel frames are the same as of the whole recording, reflected at its two ends, and so are the rows between them.
Loudness, which `extract` measures in the whole recording, is given; or else measured as far as it has been heard.
"""

from fractions import Fraction

import numpy as np
from jaxtyping import Float, Float32

from zeggs_jax.speech import features, wav
from zeggs_jax.speech.features import RELEASED, SpeechFeatureConfig
from zeggs_jax.speech.loudness import RunningLoudness

PIECE_S = 10.0  # worked on at a time, so that a long recording pushed at once fits into memory
LIMIT_DB = 30.0  # a running loudness never changes amplitudes by more: noise before the speech stays noise


class LiveFeatures:
    """Samples in, feature rows at the motion's rate out; memory does not grow."""

    def __init__(
        self, rate_hz: float | int, config: SpeechFeatureConfig = RELEASED, loudness: float | int | None = None
    ):
        """`loudness` (LUFS) of the whole recording, where it is known; None: as heard so far."""
        self.config, self.rate_hz = config, rate_hz
        self.heard = 0  # samples
        self._loudness = None
        self._gain = 1.0
        if config.normalize_loudness and loudness is None:
            self._loudness = RunningLoudness(config.rate_hz)
        elif config.normalize_loudness and loudness is not None:
            self._gain = wav.gain(loudness)
        self._half = config.window // 2
        self._wave = np.zeros(0)  # what later windows still see; from `_from` on, counted in the padded recording
        self._from: int | None = None  # None: not yet enough for the reflection in front
        features.mel_basis(config)  # now, not with the first samples
        self._next = 0  # spectrogram frame
        self._frames = np.zeros((0, config.size))  # the last rows at the spectrogram's rate, up to `_next`
        self._row = 0  # row that comes out next

    def hear(self, wave: Float[np.ndarray, " n"]) -> Float32[np.ndarray, "k D"]:
        """The rows that become certain with these samples, at `config.rate_hz`."""
        piece = round(PIECE_S * self.config.rate_hz)
        parts = [self._hear(wave[start : start + piece]) for start in range(0, wave.size, piece)]
        return np.concatenate([np.zeros((0, self.config.size), np.float32), *parts])

    def finish(self) -> Float32[np.ndarray, "k D"]:
        """The rows that were not certain before the recording's end."""
        total, window = self.heard, self.config.window
        if total == 0:
            return np.zeros((0, self.config.size), np.float32)
        if total < window:
            self._take(np.zeros(window - total))
        self._wave = np.concatenate([self._wave, self._wave[-2 : -2 - self._half : -1]])
        self._spectrum(-(-max(total, window) // self.config.hop), [self._gain], total)
        return self._rows(features.frame_count(total, self.rate_hz, self.config), last=True)

    def _hear(self, wave: Float[np.ndarray, " n"]) -> Float32[np.ndarray, "k D"]:
        before = self.heard
        gains = [self._gain]
        if self._loudness is not None:
            gains += [_limited(loud) for loud in self._loudness.hear(wave)]
        self.heard += wave.size
        self._take(np.asarray(wave, np.float64))
        if self._from is not None:
            certain = (self._from + self._wave.size - self.config.window) // self.config.hop + 1
            self._spectrum(certain, gains, before)
        self._gain = gains[-1]
        return self._rows(features.frame_count(self.heard, self.rate_hz, self.config), last=False)

    def _take(self, wave: Float[np.ndarray, " n"]) -> None:
        """Keeps the samples; the first ones also as their reflection."""
        self._wave = np.concatenate([self._wave, wave])
        if self._from is None and self._wave.size > self._half:
            self._wave = np.concatenate([self._wave[self._half : 0 : -1], self._wave])
            self._from = 0

    def _spectrum(self, until: int, gains: list[float], before: int) -> None:
        """Spectrogram frames up to one; `gains` are those after `before` samples and after each step from there."""
        count, config = until - self._next, self.config
        if count > 0 and self._from is not None:
            start = self._next * config.hop - self._from
            windows = np.lib.stride_tricks.sliding_window_view(self._wave[start:], config.window)[:: config.hop][:count]
            mel = features.mel_amplitude(windows, config, np.fft.rfft)
            mel = mel * self._gain_of(np.arange(self._next, until), gains, before)
            rows = features.with_energy(features.level(mel, config), config)
            self._frames, self._next = np.concatenate([self._frames, rows]), until
        if self._from is not None:  # the last window's length stays: the end is reflected
            keep = min(self._next * config.hop, self._from + self._wave.size - config.window - 1)
            if keep > self._from:
                self._wave, self._from = self._wave[keep - self._from :], keep

    def _gain_of(self, frames: np.ndarray, gains: list[float], before: int) -> Float[np.ndarray, "k 1"]:
        """The gain that was known when a frame's last sample came."""
        if self._loudness is None or len(gains) == 1:
            return np.full((len(frames), 1), gains[-1])
        ends = frames * self.config.hop + self.config.window - self._half
        step = self._loudness.step
        return np.asarray(gains)[np.clip(ends // step - before // step, 0, len(gains) - 1)][:, None]

    def _rows(self, until: int, last: bool) -> Float32[np.ndarray, "k D"]:
        """Rows from the next one on, linear between spectrogram frames; at the end the last frame is held."""
        config = self.config
        rows = np.arange(self._row, max(until, self._row))
        positions = config.rate_hz / config.hop / self.rate_hz * rows
        if last:
            positions = np.minimum(positions, self._next - 1)
        rows = rows[positions <= self._next - 1]
        if not rows.size:
            return np.zeros((0, config.size), np.float32)
        first = self._next - len(self._frames)
        found = features.interpolate(self._frames, positions[: len(rows)] - first).astype(np.float32)
        self._row += len(rows)
        needed = int(config.rate_hz / config.hop / self.rate_hz * self._row)
        self._frames = self._frames[max(min(needed, self._next - 2) - first, 0) :]
        return found


def delay_s(rate_hz: float | int, config: SpeechFeatureConfig = RELEASED) -> tuple[float, float]:
    """How long after its time a row is certain, at the least and at the most: half a window, then a spectrogram frame.

    A row between two spectrogram frames waits for the later one; the most is what the rates leave room for.
    """
    ahead = (config.window - config.window // 2) / config.rate_hz
    between = (Fraction(config.rate_hz, config.hop) / Fraction(rate_hz).limit_denominator(1000)).denominator
    return ahead, ahead + (1.0 - 1.0 / between) * config.hop / config.rate_hz


def _limited(measured_lufs: float) -> float:
    most = 10.0 ** (LIMIT_DB / 20.0)
    return min(max(wav.gain(measured_lufs), 1.0 / most), most)
