"""Fig. 3a: what a frame of the speech embedding may depend on, and how."""

from dataclasses import replace

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


@pytest.mark.parametrize(("lookahead", "last"), [(None, 13), (3, 13), (0, 10), (1, 11), (6, 16)])
def test_sees_as_many_frames_ahead_as_it_says_and_the_rest_behind(speech, lookahead, last):
    config, first = replace(CONFIG, lookahead=lookahead), last - 6
    network = SpeechEncoder(config)
    params = network.init(jax.random.key(0), speech)
    slope = jax.jacrev(lambda x: network.apply(params, x)[10])(speech)
    seen = np.abs(slope).sum((0, 2)) > 0
    np.testing.assert_array_equal(np.flatnonzero(seen), np.arange(first, last + 1))
    assert (10 - config.behind, 10 + config.ahead) == (first, last)


@pytest.mark.parametrize("lookahead", [None, 0, 1, 6])
def test_is_its_formula_with_the_first_and_the_last_frame_repeated(speech, lookahead):
    config = replace(CONFIG, lookahead=lookahead)
    network = SpeechEncoder(config)
    params = network.init(jax.random.key(0), speech)
    p = jax.tree.map(lambda a: np.asarray(a, np.float64), params["params"])
    elu = lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0)))  # noqa: E731
    x = elu(np.asarray(speech) @ p["conv0"]["weight"][:, :, 0].T + p["conv0"]["bias"])
    seen = x[np.arange(-config.behind, 20 + config.ahead).clip(0, 19)]
    x = elu(sum(seen[k : k + 20] @ p["conv1"]["weight"][:, :, k].T for k in range(7)) + p["conv1"]["bias"])
    x = elu(x @ p["dense"]["weight"].T + p["dense"]["bias"])
    np.testing.assert_allclose(network.apply(params, speech), x, atol=1e-5)


def test_looking_less_far_ahead_is_the_same_embedding_later(encoder, speech):
    """The weights stay; what is seen moves, so that frame t is what frame t - 3 was."""
    params = SpeechEncoder(CONFIG).init(jax.random.key(0), jax.random.normal(jax.random.key(1), (20, 4)))
    none = SpeechEncoder(replace(CONFIG, lookahead=0)).apply(params, speech)
    np.testing.assert_allclose(none[6:], encoder(speech)[3:-3], atol=1e-6)


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
