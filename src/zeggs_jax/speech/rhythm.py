"""What the denoiser hears (GestureDiffuCLIP Sec. 6.1): onset strength and amplitude of a speech, one row a latent.

The paper names the two and no more. Here an onset is spectral flux: how many dB the mel bands rise from one frame of
the spectrogram to the next, falls counted as zero, averaged over the bands, and the strongest of a latent taken; the
amplitude is the root mean square of a latent's samples. Both follow a recording levelled to -20 LUFS, so that neither
tells how near the microphone was.
"""

from dataclasses import replace

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, Float32

from . import wav
from .features import BLOCK, RELEASED, amplitude, mel_basis

SOUND = replace(RELEASED, mels=40)  # 16 kHz, windows of 50 ms every 12.5 ms
FLOOR = 1e-5  # mel amplitude, about 40 dB below the vowels of levelled speech: what is quieter has no onsets
RISE_DB = 8.0  # mean rise in one frame that counts as 1; strong syllables reach it
LOUD = 0.25  # root mean square that counts as 1; levelled speech seldom exceeds it
SIZE = 2  # columns
FASTEST_HZ = SOUND.rate_hz / SOUND.hop / 2  # at least two frames of the spectrogram in a latent


def extract(wave: Float[ArrayLike, " n"], latents_hz: float | int, count: int) -> Float32[np.ndarray, "L 2"]:
    """Samples at 16 kHz -> (onset strength, amplitude) of `count` latents, both about 0 to 1 and never negative.

    Row l tells of the time from l / latents_hz to (l + 1) / latents_hz; rows behind the recording are 0.

    Raises:
        ValueError: an empty wave, or more latents a second than half of the spectrogram's frames (40).
    """
    wave = np.asarray(wave, np.float32)
    if wave.size == 0:
        raise ValueError("The waveform holds no samples, speech was expected; give a recording that is not empty.")
    if not 0.0 < latents_hz <= FASTEST_HZ:
        raise ValueError(f"{latents_hz:g} latents a second were asked for; expected more than 0, at most {FASTEST_HZ}.")
    levelled = wav.normalize_loudness(wave, SOUND.rate_hz)
    return np.stack([_strongest(onsets(levelled), latents_hz, count), _loudness(levelled, latents_hz, count)], axis=1)


def onsets(wave: Float[np.ndarray, " n"]) -> Float32[np.ndarray, " F"]:
    """Mean rise of the mel bands in dB / RISE_DB, for each frame of the spectrogram; the first frame has none."""
    basis, hop = mel_basis(SOUND).T, SOUND.hop
    pieces, reach = [], SOUND.window  # a block sees the samples around it, so that its length changes nothing
    for start in range(0, len(wave), BLOCK * hop):
        first = max(start - reach, 0)
        seen = amplitude(wave[first : start + BLOCK * hop + reach], SOUND)[(start - first) // hop :]
        pieces.append(seen[: -(-(min(start + BLOCK * hop, len(wave)) - start) // hop)] @ basis)
    level = 20.0 * np.log10(np.maximum(np.concatenate(pieces), FLOOR))
    rise = np.maximum(np.diff(level, axis=0, prepend=level[:1]), 0.0)
    return (rise.mean(1) / RISE_DB).astype(np.float32)


def _strongest(strength: Float[np.ndarray, " F"], latents_hz: float, count: int) -> Float32[np.ndarray, " L"]:
    """The greatest strength of each latent; a rise is of the samples that have just come into the window."""
    at = np.arange(len(strength)) * SOUND.hop + (SOUND.window - SOUND.hop) // 2
    latent = np.floor(at * (latents_hz / SOUND.rate_hz)).astype(int)
    kept = np.zeros(count, np.float32)
    inside = latent < count
    np.maximum.at(kept, latent[inside], strength[inside])
    return kept


def _loudness(wave: Float[np.ndarray, " n"], latents_hz: float, count: int) -> Float32[np.ndarray, " L"]:
    """Root mean square of each latent's samples / LOUD; samples behind the recording are silent."""
    total = np.concatenate([[0.0], np.cumsum(np.asarray(wave, np.float64) ** 2)])
    edges = np.round(np.arange(count + 1) * (SOUND.rate_hz / latents_hz)).astype(int)
    squares = np.diff(total[np.minimum(edges, len(wave))]) / np.diff(edges)
    return (np.sqrt(np.maximum(squares, 0.0)) / LOUD).astype(np.float32)
