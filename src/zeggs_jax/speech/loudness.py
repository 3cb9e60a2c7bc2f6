"""Loudness, gated as ITU-R BS.1770-4 does it: of a recording, and in constant memory of one that is still going on."""

import numpy as np
from jaxtyping import Float

from zeggs_jax.speech import weighting

BLOCK_S = 0.4  # loudness is gated in blocks of this length
STEP_S = 0.1  # a new one begins every so often
OVERLAP = 4  # steps in a block
SILENT = -70.0  # LUFS; blocks below are not heard
LOUDEST, BINS = 30.0, 2000  # blocks are counted in bins of 0.05 LU
QUIETER = 10.0  # LU below the mean of the blocks heard: what lies there is a pause
PIECE = 40  # steps of a recording that are weighted at a time: they stay in the CPU's cache


def integrated(wave: Float[np.ndarray, " n"], rate_hz: int) -> float:
    """LUFS of a recording of 0.4 s or more; -inf when no block is above the gate of -70 LUFS.

    The last block may reach behind the end, where it hears nothing.
    """
    step = round(STEP_S * rate_hz)
    blocks = int(np.round((wave.size / rate_hz - BLOCK_S) / STEP_S)) + 1
    energies, state = np.zeros(-(-wave.size // step)), np.zeros(4)
    for first in range(0, len(energies), PIECE):
        heard, state = weighting.weigh(rate_hz, wave[first * step : (first + PIECE) * step], state)
        whole = heard[: heard.size // step * step].reshape(-1, step)
        rest = heard[whole.size :]
        energies[first : first + len(whole)] = np.einsum("ks,ks->k", whole, whole)
        if rest.size:
            energies[-1] = rest @ rest
    total = np.concatenate([energies, np.zeros(max(blocks + OVERLAP - 1 - len(energies), 0))])
    power = np.lib.stride_tricks.sliding_window_view(total, OVERLAP).sum(1)[:blocks] / (OVERLAP * step)
    heard = power[power >= _power(SILENT)]
    if not heard.size:
        return -np.inf
    return lufs(float(heard[heard > _power(lufs(float(heard.mean())) - QUIETER)].mean()))


class RunningLoudness:
    """What `integrated` says of all samples so far, to 0.1 LU: one number for every 0.1 s, whatever is pushed."""

    def __init__(self, rate_hz: int = 16_000):
        self.rate_hz, self.step = rate_hz, round(STEP_S * rate_hz)
        self._state = np.zeros(4)
        self._squares = np.zeros(0)  # of the step that has begun, filtered
        self._steps: list[float] = []  # energies of the steps that the next block holds
        self._count, self._energy = np.zeros(BINS), np.zeros(BINS)

    def hear(self, wave: Float[np.ndarray, " n"]) -> list[float]:
        """LUFS at the end of each step that `wave` completes; -inf as long as all is silence."""
        if not wave.size:
            return []
        filtered, self._state = weighting.weigh(self.rate_hz, wave, self._state)
        squares = np.concatenate([self._squares, filtered**2])
        whole = len(squares) // self.step
        energies = squares[: whole * self.step].reshape(whole, self.step).sum(1)
        self._squares = squares[whole * self.step :]
        return [self._after(float(energy)) for energy in energies]

    def _after(self, energy: float) -> float:
        self._steps = [*self._steps, energy][-OVERLAP:]
        if len(self._steps) == OVERLAP:
            power = sum(self._steps) / (OVERLAP * self.step)
            loud = lufs(power)
            if loud >= SILENT:
                place = min(int((loud - SILENT) / (LOUDEST - SILENT) * BINS), BINS - 1)
                self._count[place] += 1.0
                self._energy[place] += power
        return self._gated()

    def _gated(self) -> float:
        """The mean of the blocks that are not more than 10 LU below the mean of all that are not silent."""
        if not self._count.any():
            return -np.inf
        gate = lufs(float(self._energy.sum() / self._count.sum())) - QUIETER
        first = max(int(np.ceil((gate - SILENT) / (LOUDEST - SILENT) * BINS)), 0)
        first = min(first, int(np.flatnonzero(self._count)[-1]))
        return lufs(float(self._energy[first:].sum() / self._count[first:].sum()))


def lufs(power: float) -> float:
    """Loudness of a K-weighted mean square; -inf of none."""
    return -0.691 + 10.0 * float(np.log10(power)) if power > 0.0 else -np.inf


def _power(lufs: float) -> float:
    return 10.0 ** ((lufs + 0.691) / 10.0)
