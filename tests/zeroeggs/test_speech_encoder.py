"""Fig. 3a: what a frame of the speech embedding may depend on, and how."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.zeroeggs.speech_encoder import SpeechEncoder, SpeechEncoderConfig

CONFIG = SpeechEncoderConfig(features=4, hidden=6, size=5, kernel=7)


@pytest.fixture(scope="module")
def encoder():
    x = jax.random.normal(jax.random.key(1), (20, 4))
    network = SpeechEncoder(CONFIG)
    params = network.init(jax.random.key(0), x)
    return lambda x, **kwargs: network.apply(params, x, **kwargs)


@pytest.fixture(scope="module")
def speech():
    return jax.random.normal(jax.random.key(2), (20, 4))


def test_sees_half_a_kernel_to_each_side(encoder, speech):
    slope = jax.jacrev(lambda x: encoder(x)[10])(speech)
    seen = np.abs(slope).sum((0, 2)) > 0
    np.testing.assert_array_equal(np.flatnonzero(seen), np.arange(7, 14))


def test_moves_with_the_speech(encoder, speech):
    later = encoder(jnp.roll(speech, 5, axis=0))
    np.testing.assert_allclose(later[8:17], encoder(speech)[3:12], atol=1e-6)


def test_keeps_a_constant_constant(encoder):
    y = encoder(jnp.ones((20, 4)))
    np.testing.assert_allclose(y, jnp.broadcast_to(y[:1], y.shape), atol=1e-6)


def test_ends_with_an_elu(encoder, speech):
    y = encoder(100.0 * speech)
    assert y.min() >= -1.0
    assert y.max() > 1.0


def test_a_clip_shorter_than_the_kernel(encoder, speech):
    assert np.isfinite(encoder(speech[:1])).all()


def test_a_batch_is_its_clips(encoder):
    clips = jax.random.normal(jax.random.key(3), (3, 20, 4))
    singles = jnp.stack([encoder(clip) for clip in clips])
    np.testing.assert_allclose(jax.vmap(encoder)(clips), singles, atol=1e-6)


def test_dropout_only_when_asked(encoder, speech):
    dropped = [encoder(speech, deterministic=False, rngs={"dropout": jax.random.key(k)}) for k in (1, 1, 2)]
    np.testing.assert_array_equal(dropped[0], dropped[1])
    assert np.abs(dropped[0] - dropped[2]).max() > 1e-3
    assert np.abs(dropped[0] - encoder(speech)).max() > 1e-3
