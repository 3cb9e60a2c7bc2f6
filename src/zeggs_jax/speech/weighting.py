"""The ear's weighting of ITU-R BS.1770, K: two second-order sections, applied to blocks of samples at a time.

What a linear filter makes of a block is a matrix times its samples and another times the state before it; the states
of all blocks follow each other by doubling. So it takes matrix products, and no loop over samples.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

BLOCK = 32  # samples


class Weighting(NamedTuple):
    """The filter as it acts on L samples; its state is that of both sections, transposed direct form II."""

    heard: Float[np.ndarray, "L L"]  # output of the samples
    left: Float[np.ndarray, "L 4"]  # output of the state before them
    kept: Float[np.ndarray, "L 4"]  # state after so many more samples than one, of one
    powers: Float[np.ndarray, "L+1 4 4"]  # state after so many samples, of the state before


def sections(rate_hz: int) -> Float[np.ndarray, "2 6"]:
    """The sections at any rate: a shelf of 4 dB from 1.5 kHz on, a high pass at 38 Hz.

    As R. Bristow-Johnson's audio equaliser cookbook gives them: b0 b1 b2 a0 a1 a2 each, a0 = 1.
    """
    shelf, turn = 10.0 ** (4.0 / 40.0), 2.0 * np.pi / rate_hz
    cos, alpha = np.cos(1500.0 * turn), np.sin(1500.0 * turn) / np.sqrt(2.0)
    up, down, root = shelf + 1.0, shelf - 1.0, 2.0 * np.sqrt(shelf) * alpha
    high = [shelf * (up + down * cos + root), -2.0 * shelf * (down + up * cos), shelf * (up + down * cos - root)]
    high += [up - down * cos + root, 2.0 * (down - up * cos), up - down * cos - root]
    cos, alpha = np.cos(38.0 * turn), np.sin(38.0 * turn)
    low = [0.5 * (1.0 + cos), -(1.0 + cos), 0.5 * (1.0 + cos), 1.0 + alpha, -2.0 * cos, 1.0 - alpha]
    both = np.array([high, low])
    return both / both[:, 3:4]


@lru_cache(maxsize=8)
def weighting(rate_hz: int) -> Weighting:
    """The filter's matrices: its answers to each state and to one sample."""
    states = np.eye(5, 4, -1)  # row 0 begins with a sample of 1, row k with 1 in place k of the state
    outputs, follow = np.zeros((5, BLOCK)), np.zeros((BLOCK + 1, 5, 4))
    follow[0] = states
    for at in range(BLOCK):
        value = np.eye(5)[0] * (at == 0)
        for number, (b0, b1, b2, _, a1, a2) in enumerate(sections(rate_hz)):
            first, second = states[:, 2 * number], states[:, 2 * number + 1]
            made = b0 * value + first
            states[:, 2 * number : 2 * number + 2] = np.stack(
                [b1 * value - a1 * made + second, b2 * value - a2 * made], 1
            )
            value = made
        outputs[:, at], follow[at + 1] = value, states
    shift = np.subtract.outer(np.arange(BLOCK), np.arange(BLOCK))
    heard = np.where(shift >= 0, outputs[0, shift], 0.0)
    return Weighting(heard, outputs[1:].T.copy(), follow[1:, 0].copy(), follow[:, 1:].swapaxes(1, 2).copy())


def weigh(
    rate_hz: int, wave: Float[np.ndarray, " n"], state: Float[np.ndarray, " 4"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " 4"]]:
    """The wave as the ear hears it, float64, and the state after it; the state before the first sample is zeros."""
    own = weighting(rate_hz)
    wave = np.asarray(wave, np.float64)
    whole = wave[: wave.size // BLOCK * BLOCK].reshape(-1, BLOCK)
    states = np.concatenate([state[None], whole @ own.kept[::-1]])  # each block's own part; then all before it
    jump, power = 1, own.powers[BLOCK]
    while jump < len(states):
        states[jump:] += states[:-jump] @ power.T
        jump, power = 2 * jump, power @ power
    rest, last = wave[whole.size :], states[-1]
    n = rest.size
    ends = own.heard[:n, :n] @ rest + own.left[:n] @ last
    blocks = whole @ own.heard.T + states[:-1] @ own.left.T
    return np.concatenate([blocks.ravel(), ends]), own.powers[n] @ last + rest @ own.kept[:n][::-1]
