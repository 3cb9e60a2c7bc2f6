"""When a voice is heard in a recording: pauses found by loudness alone, and the clock that stands still in them."""

import numpy as np
from jaxtyping import Bool, Float

from . import features, wav

RATE_HZ = 50.0  # at which loudness is looked at
BELOW_DB = 26.0  # what is quieter than loud speech (its 95th percentile) by more is no voice
PAUSE_S, BURST_S = 0.2, 0.1  # shorter silences belong to the speech, shorter sounds do not
NEAR_S = 0.08  # what begins or ends so near to a pause does so at it


def times(wave: Float[np.ndarray, " n"], shares: Float[np.ndarray, "K 2"]) -> Float[np.ndarray, "K 2"]:
    """From when to when, in s, the (first, last) `shares` (0 to 1) of the voiced time of a recording at 16 kHz last.

    A share that begins where a pause begins begins behind it; one that ends there ends before it.

    Raises:
        ValueError: no voice is heard.
    """
    heard = speaking(wave)
    if not heard.any():
        raise ValueError("no voice is heard in the speech; give a recording of it.")
    edges = np.flatnonzero(np.diff(heard, prepend=False, append=False)).reshape(-1, 2) / RATE_HZ
    lasted = np.concatenate([[0.0], np.cumsum(edges[:, 1] - edges[:, 0])])
    at = np.clip(np.asarray(shares, float), 0.0, 1.0) * lasted[-1]
    first = np.clip(np.searchsorted(lasted, at[:, 0] + NEAR_S, side="right") - 1, 0, len(edges) - 1)
    last = np.clip(np.searchsorted(lasted, at[:, 1] - NEAR_S, side="left") - 1, 0, len(edges) - 1)
    start = edges[first, 0] + np.maximum(at[:, 0] - lasted[first], 0.0)
    stop = np.minimum(edges[last, 0] + at[:, 1] - lasted[last], edges[last, 1])
    spans = np.stack([start, np.maximum(start, stop)], axis=1)
    return np.minimum(spans, len(wave) / wav.RATE_HZ)


def speaking(wave: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " T"]:
    """Is a voice heard, RATE_HZ times a second: loud enough beside the rest; digital silence is none."""
    loud = np.asarray(features.frame_energy(np.asarray(wave, np.float32), None, RATE_HZ), float)
    least = np.quantile(loud, 0.95) * 10 ** (-BELOW_DB / 20) if loud.size else 0.0
    heard = (loud > least) & (loud > 1e-5)
    heard = _without(heard, False, PAUSE_S)
    return _without(heard, True, BURST_S)


def _without(heard: Bool[np.ndarray, " T"], kind: bool, shortest_s: float) -> Bool[np.ndarray, " T"]:
    """Runs of `kind` that are shorter, and not at either end, become the other kind."""
    kept = heard.copy()
    for start, stop in np.flatnonzero(np.diff(heard == kind, prepend=False, append=False)).reshape(-1, 2):
        if stop - start < shortest_s * RATE_HZ and start > 0 and stop < len(heard):
            kept[start:stop] = not kind
    return kept
