"""Loudness of a recording that is still going on: gated as ITU-R BS.1770-4 does it, in constant memory."""

import numpy as np
from jaxtyping import Float

from zeggs_jax.speech import wav

STEP_S = 0.1  # a new block of wav.BLOCK_S begins every so often
OVERLAP = 4  # steps in a block
SILENT = -70.0  # LUFS; blocks below are not heard
LOUDEST, BINS = 30.0, 2000  # blocks are counted in bins of 0.05 LU
QUIETER = 10.0  # LU below the mean of the blocks heard: what lies there is a pause


class RunningLoudness:
    """What `wav.loudness` says of all samples so far, to 0.1 LU: one number for every 0.1 s, whatever is pushed."""

    def __init__(self, rate_hz: int = wav.RATE_HZ):
        from scipy.signal import sosfilt  # 0.5 s to import: only who measures pays

        self._run = sosfilt
        self.step = round(STEP_S * rate_hz)
        self._filter = k_weighting(rate_hz)
        self._state = np.zeros((len(self._filter), 2))
        self._squares = np.zeros(0)  # of the step that has begun, filtered
        self._steps: list[float] = []  # energies of the steps that the next block holds
        self._count, self._energy = np.zeros(BINS), np.zeros(BINS)

    def hear(self, wave: Float[np.ndarray, " n"]) -> list[float]:
        """LUFS at the end of each step that `wave` completes; -inf as long as all is silence."""
        if not wave.size:
            return []
        filtered, self._state = self._run(self._filter, np.asarray(wave, np.float64), zi=self._state)
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


def k_weighting(rate_hz: int) -> Float[np.ndarray, "2 6"]:
    """The two second-order sections of BS.1770 at any rate: a shelf of 4 dB from 1.5 kHz on, a high pass at 38 Hz.

    Sections as R. Bristow-Johnson's audio equaliser cookbook gives them.
    """
    shelf, turn = 10.0 ** (4.0 / 40.0), 2.0 * np.pi / rate_hz
    cos, alpha = np.cos(1500.0 * turn), np.sin(1500.0 * turn) / np.sqrt(2.0)
    up, down, root = shelf + 1.0, shelf - 1.0, 2.0 * np.sqrt(shelf) * alpha
    high = [shelf * (up + down * cos + root), -2.0 * shelf * (down + up * cos), shelf * (up + down * cos - root)]
    high += [up - down * cos + root, 2.0 * (down - up * cos), up - down * cos - root]
    cos, alpha = np.cos(38.0 * turn), np.sin(38.0 * turn)
    low = [0.5 * (1.0 + cos), -(1.0 + cos), 0.5 * (1.0 + cos), 1.0 + alpha, -2.0 * cos, 1.0 - alpha]
    sections = np.array([high, low])
    return sections / sections[:, 3:4]
