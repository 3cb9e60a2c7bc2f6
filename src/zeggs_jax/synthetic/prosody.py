"""What the body hears: phrases, stressed syllables and their loudness, known from words or measured."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from zeggs_jax.synthetic.voice import Word

ENVELOPE_HZ = 100
SILENT = 0.06  # of the loud level (90th percentile of the spoken part): about -24 dB
SHORTEST_PAUSE = 0.28  # s; shorter gaps stay inside a phrase
LOUDEST = 1.3


class Prosody(NamedTuple):
    """Stresses and phrases of one speech; the only thing of it that drives the body."""

    seconds: float
    time: Float[np.ndarray, " N"]  # s, middle of each stressed vowel, rising
    strength: Float[np.ndarray, " N"]  # loudness there; 1 is loud speech, at most 1.3
    phrases: Float[np.ndarray, "M 2"]  # s, start and end of each run of speech


def envelope(wave: Float[np.ndarray, " n"], rate: int = 16000) -> Float[np.ndarray, " E"]:
    """Loudness at 100 Hz: RMS over 50 ms, relative to the spoken part's loud level (zeros for silence)."""
    hop = rate // ENVELOPE_HZ
    power = np.square(wave[: len(wave) // hop * hop].astype(np.float64)).reshape(-1, hop).mean(axis=1)
    level = np.sqrt(gaussian_filter1d(power, 2.5, mode="constant")) if len(power) else np.zeros(0)
    spoken = level[level > max(0.05 * level.max(initial=0.0), 1e-5)]
    return level / np.percentile(spoken, 90) if len(spoken) else np.zeros_like(level)


def _runs(speaking: np.ndarray) -> Float[np.ndarray, "M 2"]:
    """Start and end in s of each run of true frames; short gaps are closed and blips under 0.1 s dropped."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], speaking.astype(np.int8), [0]])))
    runs = edges.reshape(-1, 2) / ENVELOPE_HZ
    merged: list[list[float]] = []
    for start, end in runs.tolist():
        if merged and start - merged[-1][1] < SHORTEST_PAUSE:
            merged[-1][1] = end
        else:
            merged.append([start, end])
    return np.array([r for r in merged if r[1] - r[0] > 0.1]).reshape(-1, 2)


def measure(wave: Float[np.ndarray, " n"], rate: int = 16000) -> Prosody:
    """Prosody heard in any mono wave: peaks of its energy envelope are its stresses."""
    level = envelope(wave, rate)
    smooth = gaussian_filter1d(level, 4.0, mode="constant")
    peaks, _ = find_peaks(smooth, height=0.35, prominence=0.12, distance=int(0.15 * ENVELOPE_HZ))
    strength = np.minimum(level[peaks], LOUDEST)
    return Prosody(len(wave) / rate, peaks / ENVELOPE_HZ, strength, _runs(level > SILENT))


def known(words: Sequence[Word], wave: Float[np.ndarray, " n"], rate: int = 16000) -> Prosody:
    """Prosody of speech whose words are known: exact times, loudness of the wave at each stressed vowel."""
    level = envelope(wave, rate)
    stressed = [w for w in words if w.stressed and w.nucleus * ENVELOPE_HZ < len(level) - 1]
    time = np.array([w.nucleus for w in stressed])
    strength = np.interp(time * ENVELOPE_HZ, np.arange(len(level)), gaussian_filter1d(level, 2.0)) if stressed else time
    phrases: list[list[float]] = []
    for word in words:
        if phrases and word.start - phrases[-1][1] < SHORTEST_PAUSE:
            phrases[-1][1] = word.end
        else:
            phrases.append([word.start, word.end])
    return Prosody(len(wave) / rate, time, np.minimum(strength, LOUDEST), np.array(phrases).reshape(-1, 2))
