"""One update: compiled once, the same in parts, with its average and with shortened gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from zeggs_jax.training.optimiser import radam
from zeggs_jax.training.step import TrainState, begin, make_step, mean_over_parts, trained

CLIPS = 6


def loss_fn(params, batch, keys, step):
    noise = jax.vmap(lambda key: jax.random.normal(key, (5,)))(keys)
    error = jnp.mean(jnp.abs(jnp.tanh(params["w"])[None] - batch["x"] - noise)) * (1.0 + 0.1 * step)
    return error, {"error": error}


def batch(k: int) -> dict[str, np.ndarray]:
    return {"x": np.random.default_rng(k).normal(1.0, 0.5, (CLIPS, 5)).astype(np.float32)}


def run(optimiser=None, steps: int = 6, averaged: bool = False, **options) -> TrainState:
    optimiser = optimiser or radam(0.05)
    state, step = begin({"w": jnp.zeros(5)}, optimiser, averaged), make_step(loss_fn, optimiser, 7, **options)
    for k in range(steps):
        state, _ = step(state, batch(k))
    assert step._cache_size() == 1  # pyright: ignore
    return state


@pytest.mark.parametrize("parts", [2, 3, 6])
def test_a_batch_in_parts_is_the_same_update(parts):
    """The keys of the clips are those of the whole batch, so dropout and noise are the same too."""
    whole, cut = run(), run(accumulate=parts)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6), cut, whole)


def test_parts_take_rows_of_every_device():
    seen = []
    mean_over_parts(lambda x: seen.append(x) or x.sum(), jnp.arange(6.0), 1)
    total = mean_over_parts(lambda x: {"first": x[0], "sum": x.sum()}, jnp.arange(6.0), 2)
    assert float(total["first"]) == 0.5  # parts 0, 2, 4 and 1, 3, 5
    assert float(total["sum"]) == 7.5


def test_the_average_is_that_of_the_parameters():
    state = begin({"w": jnp.zeros(5)}, radam(0.05), averaged=True)
    step, expected = make_step(loss_fn, radam(0.05), 7, ema=0.9), np.zeros(5)
    for k in range(8):
        state, _ = step(state, batch(k))
        decay = min(0.9, (1 + k) / (10 + k))
        expected = decay * expected + (1 - decay) * np.asarray(state.params["w"])
    np.testing.assert_allclose(trained(state)["w"], expected, rtol=1e-5)
    assert not np.allclose(trained(state)["w"], state.params["w"], rtol=1e-2)


def test_the_average_changes_nothing_else():
    with_average, without = run(averaged=True, ema=0.9), run()
    np.testing.assert_array_equal(with_average.params["w"], without.params["w"])
    assert trained(without) is without.params


def test_long_gradients_are_shortened_and_reported_as_they_were():
    gradient = {}
    for limit in (1e-3, 1e9):
        optimiser = optax.chain(optax.clip_by_global_norm(limit), optax.sgd(1.0))
        state, metrics = make_step(loss_fn, optimiser, 7)(begin({"w": jnp.zeros(5)}, optimiser), batch(0))
        gradient[limit] = float(metrics["gradient"])
        moved = float(optax.tree.norm(state.params))
        assert moved == pytest.approx(min(limit, gradient[limit]), rel=1e-5)
    assert gradient[1e-3] == gradient[1e9] > 1e-3


def test_the_state_is_consumed():
    optimiser = radam(0.05)
    state = begin({"w": jnp.zeros(5)}, optimiser, averaged=True)
    make_step(loss_fn, optimiser, 7, ema=0.9)(state, batch(0))
    assert all(leaf.is_deleted() for leaf in jax.tree.leaves((state.params, state.opt_state)))
