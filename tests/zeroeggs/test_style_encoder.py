"""Fig. 3b: padding changes nothing, temperature means what it says, both kinds, with and without VAE."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.zeroeggs.style_encoder import (
    StyleDistribution,
    StyleEncoder,
    StyleEncoderConfig,
    reparameterise,
    sample_style,
)

LENGTH, PADDED = 13, 21


def encoder(kind, variational):
    network = StyleEncoder(StyleEncoderConfig(kind, hidden=12, size=4, variational=variational))
    params = network.init(jax.random.key(0), jnp.zeros((2, 6)), 2)
    return jax.jit(lambda x, length: network.apply(params, x, length))


@pytest.fixture(scope="module", params=[(k, v) for k in ("attn", "gru") for v in (True, False)], ids=str)
def encode(request):
    return encoder(*request.param)


@pytest.fixture(scope="module")
def example():
    return jax.random.normal(jax.random.key(1), (LENGTH, 6))


def padded(example, value):
    return jnp.concatenate([example, jnp.full((PADDED - LENGTH, 6), value)])


def test_padding_changes_nothing(encode, example):
    plain = encode(example, LENGTH)
    for value in (0.0, 1e4, jnp.nan):
        for ours, expected in zip(encode(padded(example, value), LENGTH), plain, strict=True):
            if expected is not None:
                np.testing.assert_allclose(ours, expected, rtol=0, atol=3e-7)  # sums of another length round apart


def test_what_stands_in_the_padding_does_not_matter_at_all(encode, example):
    zeros, garbage = (encode(padded(example, value), LENGTH) for value in (0.0, 1e4))
    jax.tree.map(np.testing.assert_array_equal, zeros, garbage)


def test_gradient_stops_at_the_length(encode, example):
    slope = jax.grad(lambda x: encode(x, LENGTH).mean.sum())(padded(example, 0.5))
    assert np.abs(slope[:LENGTH]).max(1).min() > 0
    assert not slope[LENGTH:].any()


def test_a_batch_of_lengths_is_its_examples(encode, example):
    lengths = jnp.array([5, LENGTH, 8])
    batch = jax.vmap(encode)(jnp.stack([example] * 3), lengths)
    for i, length in enumerate((5, LENGTH, 8)):
        np.testing.assert_allclose(batch.mean[i], encode(example[:length], length).mean, atol=1e-6)


def test_variational_or_not(example):
    assert encoder("attn", True)(example, LENGTH).log_var.shape == (4,)
    alone = encoder("attn", False)(example, LENGTH)
    assert alone.log_var is None
    np.testing.assert_array_equal(sample_style(jax.random.key(0), alone, 3.0), alone.mean)


@pytest.fixture(scope="module")
def style():
    return StyleDistribution(jnp.array([1.0, -2.0]), jnp.log(jnp.array([0.25, 4.0])))


def test_temperature_zero_is_the_mean(style):
    np.testing.assert_array_equal(sample_style(jax.random.key(0), style, 0.0), style.mean)


def test_a_sample_is_mean_and_noise(style):
    noise = jnp.array([1.0, -1.0])
    np.testing.assert_allclose(reparameterise(style, noise), [1.5, -4.0], atol=1e-6)
    np.testing.assert_allclose(reparameterise(style, noise, 2.0), [2.0, -6.0], atol=1e-6)


def test_samples_spread_with_temperature(style):
    keys = jax.random.split(jax.random.key(0), 4000)
    for temperature in (0.5, 2.0):
        draws = jax.vmap(lambda k, t=temperature: sample_style(k, style, t))(keys)
        np.testing.assert_allclose(draws.mean(0), style.mean, atol=0.15)
        np.testing.assert_allclose(draws.std(0), temperature * np.array([0.5, 2.0]), rtol=0.05)
