"""K-weighting by blocks: the recursion of its sections, however the samples are cut."""

import numpy as np
import pytest
from scipy.signal import sosfilt

from zeggs_jax.speech import weighting


@pytest.mark.parametrize("rate_hz", [8000, 16000, 48000])
@pytest.mark.parametrize("samples", [1, 31, 32, 33, 1000, 40_001])
def test_it_is_the_recursion(samples, rate_hz):
    rng = np.random.default_rng(samples)
    wave, state = rng.normal(size=samples), rng.normal(size=(2, 2))
    expected, after = sosfilt(weighting.sections(rate_hz), wave, zi=state)
    found, left = weighting.weigh(rate_hz, wave, state.ravel())
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(left, after.ravel(), rtol=0, atol=1e-8)


def test_pieces_are_the_whole():
    wave, state, pieces = np.random.default_rng(0).normal(size=5000), np.zeros(4), []
    whole, last = weighting.weigh(16_000, wave, state)
    for piece in np.split(wave, [7, 7, 40, 1700]):
        made, state = weighting.weigh(16_000, piece, state)
        pieces.append(made)
    np.testing.assert_allclose(np.concatenate(pieces), whole, rtol=0, atol=1e-8)
    np.testing.assert_allclose(state, last, rtol=0, atol=1e-8)
