"""Attention: what a frame may see, what it may not, and the table of positions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.nn import attention
from zeggs_jax.nn.attention import SelfAttention, TransformerBlock, positions

KEY = jax.random.key(0)
ALL = jnp.ones(10, bool)


@pytest.fixture(scope="module")
def block():
    x = jax.random.normal(jax.random.key(1), (10, 8))
    layer = TransformerBlock(heads=2, dropout=0.3)
    return layer, layer.init(KEY, x, ALL), x


def test_positions_turn_at_their_own_rates():
    table = positions(50, 16)
    np.testing.assert_allclose(table[:, 0::2] ** 2 + table[:, 1::2] ** 2, 1.0, atol=1e-6)
    np.testing.assert_array_equal(table[0], np.tile([0.0, 1.0], 8))
    np.testing.assert_allclose(table[:, 0], np.sin(np.arange(50)), atol=1e-6)
    np.testing.assert_allclose(table[:, 3], np.cos(np.arange(50) * 10000 ** (-2 / 16)), atol=1e-5)


def test_one_more_frame_turns_every_position_alike():
    table = positions(30, 8).astype(np.float64)
    phase = table[:, 1::2] + 1j * table[:, 0::2]
    steps = phase[1:] / phase[:-1]
    np.testing.assert_allclose(steps, np.broadcast_to(steps[:1], steps.shape), atol=1e-5)


def test_attention_does_not_know_the_order_of_frames():
    x = jax.random.normal(jax.random.key(2), (10, 8))
    layer = SelfAttention(heads=2, dropout=0.0)
    params = layer.init(KEY, x, ALL)
    order = jax.random.permutation(jax.random.key(3), 10)
    np.testing.assert_allclose(layer.apply(params, x[order], ALL), layer.apply(params, x, ALL)[order], atol=1e-6)


def test_masked_frames_are_not_seen(block):
    layer, params, x = block
    mask = jnp.arange(10) < 6
    seen = jax.jacrev(lambda x: layer.apply(params, x, mask)[:6])(x)
    assert np.abs(seen[:, :, :6]).max() > 0
    assert not seen[:, :, 6:].any()


def test_padding_changes_nothing(block):
    layer, params, x = block
    short = layer.apply(params, x[:6], ALL[:6])
    padded = layer.apply(params, x.at[6:].set(1e6), jnp.arange(10) < 6)[:6]
    np.testing.assert_allclose(padded, short, atol=1e-6)


def test_dropout_only_when_asked(block):
    layer, params, x = block
    plain = layer.apply(params, x, ALL)
    one, two = (layer.apply(params, x, ALL, False, rngs={"dropout": jax.random.key(k)}) for k in (1, 2))
    np.testing.assert_array_equal(layer.apply(params, x, ALL), plain)
    assert np.abs(one - two).max() > 1e-3


@pytest.mark.parametrize("frames", [11, 12])
def test_in_blocks_it_is_the_plain_attention(block, monkeypatch, frames):
    """Whatever the number of frames is to the block's, with padding in them and gradients through them."""
    layer, params, x = block
    x = jnp.concatenate([x, x[::-1]])[:frames]
    mask = jnp.arange(frames) < frames - 3
    of = jax.value_and_grad(lambda p: (layer.apply(p, x, mask) ** 2)[: frames - 3].sum())
    plain, slopes = of(params)
    monkeypatch.setattr(attention, "QUERIES", 4)
    again, slopes_again = of(params)
    np.testing.assert_allclose(again, plain, rtol=1e-5)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-4), slopes_again, slopes)


def test_a_long_clip_takes_memory_by_its_length():
    layer = SelfAttention(heads=4, dropout=0.1)
    params = jax.eval_shape(layer.init, KEY, jnp.zeros((2, 8)), jnp.ones(2, bool))

    def memory(frames):
        x, mask = jax.ShapeDtypeStruct((frames, 8), jnp.float32), jax.ShapeDtypeStruct((frames,), bool)
        return jax.jit(layer.apply).lower(params, x, mask).compile().memory_analysis().temp_size_in_bytes

    assert memory(8192) < 2.5 * memory(4096)
    assert memory(4096) < 4 * 4 * 4096 * 4096 / 2  # half the bytes of all heads' weights
