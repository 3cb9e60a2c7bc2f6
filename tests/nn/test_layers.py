"""Layers: their definitions, PyTorch's initialisers, and PyTorch itself where it is installed."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.nn.layers import Conv, Dense, Dropout, GRUCell, LayerNorm

KEY = jax.random.key(0)


def normal(seed, *shape):
    return jax.random.normal(jax.random.key(seed), shape)


def uniform_within(array, bound):
    """Looks like U(-bound, bound): inside, and with its standard deviation."""
    assert np.abs(array).max() <= bound
    assert np.std(array) == pytest.approx(bound / math.sqrt(3), rel=0.1)


def test_dense_of_a_sequence_is_dense_of_each_frame():
    layer, x = Dense(5), normal(1, 7, 3)
    params = layer.init(KEY, x)
    frames = jnp.stack([layer.apply(params, frame) for frame in x])
    np.testing.assert_allclose(layer.apply(params, x), frames, atol=1e-6)


def test_dense_keeps_weights_out_in():
    params = Dense(5).init(KEY, jnp.zeros(3))["params"]
    x = normal(2, 3)
    expected = params["weight"] @ x + params["bias"]
    assert params["weight"].shape == (5, 3)
    np.testing.assert_allclose(Dense(5).apply({"params": params}, x), expected, atol=1e-6)


@pytest.mark.parametrize(("padding", "half"), [("zero", 3), ("none", 0)])
@pytest.mark.parametrize("frames", [40, 7, 3])
def test_conv_is_the_sum_over_its_taps(padding, half, frames):
    layer, x = Conv(4, 7, padding=padding), normal(3, frames - 2 * half + 6, 5)
    params = layer.init(KEY, x)
    weight, bias = (np.asarray(params["params"][k], np.float64) for k in ("weight", "bias"))
    padded = np.pad(np.asarray(x, np.float64), ((half, half), (0, 0)))
    expected = sum(padded[k : k + frames] @ weight[:, :, k].T for k in range(7)) + bias
    assert weight.shape == (4, 5, 7)
    np.testing.assert_allclose(layer.apply(params, x), expected, atol=1e-5)


def test_gru_cell_is_its_formula():
    x, hidden = normal(4, 3), normal(5, 4)
    params = GRUCell(4).init(KEY, x, hidden)["params"]
    w_i, w_h, b_i, b_h = (np.asarray(params[k]) for k in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"))

    def sigmoid(a):
        return 1 / (1 + np.exp(-a))

    part = [slice(4 * i, 4 * i + 4) for i in range(3)]
    r, z = (sigmoid(w_i[s] @ x + b_i[s] + w_h[s] @ hidden + b_h[s]) for s in part[:2])
    n = np.tanh(w_i[part[2]] @ x + b_i[part[2]] + r * (w_h[part[2]] @ hidden + b_h[part[2]]))
    expected = (1 - z) * n + z * np.asarray(hidden)
    np.testing.assert_allclose(GRUCell(4).apply({"params": params}, x, hidden), expected, atol=1e-6)


def test_gru_cell_with_a_shut_update_gate_remembers():
    x, hidden = normal(4, 3), normal(5, 4)
    params = GRUCell(4).init(KEY, x, hidden)["params"]
    params["bias_ih"] = params["bias_ih"].at[4:8].set(100.0)
    np.testing.assert_array_equal(GRUCell(4).apply({"params": params}, x, hidden), hidden)


def test_both_gru_biases_are_trained():
    x, hidden = normal(4, 3), normal(5, 4)
    params = GRUCell(4).init(KEY, x, hidden)
    grads = jax.grad(lambda p: GRUCell(4).apply(p, x, hidden).sum())(params)["params"]
    np.testing.assert_allclose(grads["bias_ih"][:8], grads["bias_hh"][:8], atol=1e-7)  # reset, update
    assert np.abs(grads["bias_ih"][8:] - grads["bias_hh"][8:]).min() > 0  # new: one of them inside the reset


def test_layer_norm_forgets_shift_and_scale():
    x = normal(6, 5, 16)
    params = LayerNorm().init(KEY, x)
    y = LayerNorm().apply(params, x)
    np.testing.assert_allclose(y.mean(-1), 0.0, atol=1e-6)
    np.testing.assert_allclose(y.std(-1), 1.0, atol=1e-4)
    np.testing.assert_allclose(LayerNorm().apply(params, 1000.0 + 10.0 * x), y, atol=5e-4)


def test_initialisers_are_pytorchs():
    dense = Dense(400).init(KEY, jnp.zeros(300))["params"]
    uniform_within(dense["weight"], 1 / math.sqrt(300))
    uniform_within(dense["bias"], 1 / math.sqrt(300))
    conv = Conv(64, 31).init(KEY, jnp.zeros((2, 64)))["params"]
    uniform_within(conv["weight"], 1 / math.sqrt(64 * 31))
    uniform_within(
        Conv(64, 3, gain=2**0.5).init(KEY, jnp.zeros((2, 32)))["params"]["weight"],
        math.sqrt(2 * 6 / (3 * 96)),
    )
    uniform_within(Dense(384, gain=1.0).init(KEY, jnp.zeros(128))["params"]["weight"], math.sqrt(6 / (4 * 128)))
    gru = GRUCell(100).init(KEY, jnp.zeros(300), jnp.zeros(100))["params"]
    assert all(np.abs(leaf).max() <= 0.1 for leaf in gru.values())
    uniform_within(gru["weight_ih"], 0.1)
    assert not Dense(3, zero_bias=True).init(KEY, jnp.zeros(3))["params"]["bias"].any()


def test_against_pytorch():
    torch = pytest.importorskip("torch")
    x, hidden = normal(7, 9), normal(8, 6)
    params = GRUCell(6).init(KEY, x, hidden)["params"]
    cell = torch.nn.GRUCell(9, 6)
    cell.load_state_dict({name: torch.tensor(np.asarray(leaf)) for name, leaf in params.items()})
    theirs = cell(torch.tensor(np.asarray(x))[None], torch.tensor(np.asarray(hidden))[None])[0].detach().numpy()
    np.testing.assert_allclose(GRUCell(6).apply({"params": params}, x, hidden), theirs, atol=5e-7)
    frames = normal(9, 5, 12)
    theirs = torch.nn.functional.layer_norm(torch.tensor(np.asarray(frames)), (12,)).numpy()
    np.testing.assert_allclose(LayerNorm().apply(LayerNorm().init(KEY, frames), frames), theirs, atol=1e-6)


@pytest.mark.parametrize(("rate", "shape"), [(0.2, (400, 501)), (0.5, (3, 7)), (0.0, (5,))])
def test_dropout_keeps_the_mean_and_drops_its_share(rate, shape):
    x = 1.0 + jnp.arange(math.prod(shape), dtype=jnp.float32).reshape(shape)
    layer = Dropout(rate, False)
    one, two = (np.asarray(layer.apply({}, x, rngs={"dropout": jax.random.key(seed)})) for seed in (0, 1))
    kept = one != 0
    np.testing.assert_allclose(one[kept], np.asarray(x)[kept] / (1 - rate), rtol=2e-5)
    assert abs(kept.mean() - (1 - rate)) < 5 * (0.25 / kept.size) ** 0.5
    assert bool((one == two).all()) is (rate == 0)
    np.testing.assert_array_equal(Dropout(rate, True).apply({}, x), x)
    if kept.size > 1000:  # neighbours, which share a word, are dropped independently
        pairs = kept.reshape(-1)[: kept.size // 2 * 2].reshape(-1, 2)
        assert abs(np.corrcoef(pairs.T)[0, 1]) < 0.02
