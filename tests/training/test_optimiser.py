"""The release's RAdam: its schedule, its steps against float64 arithmetic, and how it differs from optax's."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from zeggs_jax.training.optimiser import radam, step_table, stepped_rate


def run(optimiser, gradients, start):
    """Parameters after each update."""

    def body(carry, gradient):
        params, state = carry
        change, state = optimiser.update(gradient, state, params)
        params = optax.apply_updates(params, change)
        return (params, state), params

    return jax.lax.scan(body, (start, optimiser.init(start)), gradients)[1]


def exact(gradients, start, rate=1e-2, beta1=0.9, beta2=0.999, eps=1e-5):
    """Liu et al. 2020, Algorithm 2, in float64, one number after the other; epsilon as released."""
    path, params, m, v = [], np.array(start, float), np.zeros(start.shape), np.zeros(start.shape)
    longest = 2 / (1 - beta2) - 1
    for t, g in enumerate(np.asarray(gradients, float), 1):
        v = beta2 * v + (1 - beta2) * g * g
        m = beta1 * m + (1 - beta1) * g
        length = longest - 2 * t * beta2**t / (1 - beta2**t)
        if length >= 5:
            r = np.sqrt((length - 4) * (length - 2) * longest / ((longest - 4) * (longest - 2) * length))
            params = params - rate * r * np.sqrt(1 - beta2**t) / (1 - beta1**t) * m / (np.sqrt(v) + eps)
        else:
            params = params - rate * m / (1 - beta1**t)
        path.append(params)
    return np.stack(path)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-6])
def test_steps_are_those_of_float64_arithmetic(scale):
    gradients = scale * jax.random.normal(jax.random.key(0), (200, 5))
    start = jnp.zeros(5)
    ours = run(radam(1e-2), gradients, start)
    expected = exact(gradients, start)
    assert np.abs(ours - expected).max() < 2e-6 * np.abs(expected).max()


def test_rectification_starts_at_the_sixth_update():
    table = step_table(0.9, 0.999)
    assert not table.rectified[:5].any()
    assert table.rectified[5:].all()
    assert table.length[4] == pytest.approx(4.995998, abs=1e-6)  # float32 arithmetic gives 4.961
    np.testing.assert_array_less(table.length[:-1], table.length[1:])


def test_the_table_ends_where_nothing_changes_any_more():
    table = step_table(0.9, 0.999)
    assert table.factor[-1] == pytest.approx(1.0, abs=1e-7)
    assert table.length[-1] == pytest.approx(1999.0, rel=1e-6)


def test_before_that_it_is_momentum():
    gradient = jnp.array([1.0, -2e-7])
    path = run(radam(0.1), jnp.tile(gradient, (5, 1)), jnp.zeros(2))
    np.testing.assert_allclose(path, -0.1 * np.outer(np.arange(1, 6), gradient), rtol=1e-6)


def test_or_nothing_when_told_so():
    path = run(radam(0.1, momentum_start=False), jnp.ones((6, 2)), jnp.zeros(2))
    assert np.all(np.asarray(path[:5]) == 0.0)
    assert np.all(np.asarray(path[5]) < 0.0)


@pytest.mark.parametrize(("size", "low", "high"), [(1e-5, 2.4, 2.8), (1e-7, 4.0, 4.4), (1.0, 0.99, 1.01)])
def test_optax_moves_small_gradients_further(size, low, high):
    """The documented difference: 2.6 times at 1e-5 after 100 updates, none at 1."""
    gradients, start = jnp.full((100, 1), size), jnp.zeros(1)
    ours = run(radam(1e-4), gradients, start)[-1]
    theirs = run(optax.radam(1e-4, eps=1e-5), gradients, start)[-1]
    assert low < float((theirs / ours)[0]) < high


def test_weight_decay_needs_the_parameters():
    optimiser = radam(weight_decay=0.1)
    with pytest.raises(ValueError, match="needs the parameters"):
        optimiser.update(jnp.ones(2), optimiser.init(jnp.ones(2)))


def test_weight_decay_shrinks_towards_zero():
    path = run(radam(0.1, weight_decay=0.5), jnp.zeros((3, 1)), jnp.ones(1))
    np.testing.assert_allclose(path[:, 0], [0.95, 0.95**2, 0.95**3], rtol=1e-6)


@pytest.mark.parametrize(("update", "decays"), [(0, 0), (999, 0), (1000, 1), (1999, 1), (2000, 2), (160_000, 160)])
def test_the_rate_falls_after_each_thousand_updates(update, decays):
    rate = jax.jit(stepped_rate(1e-4, 0.995))(jnp.int32(update))
    assert float(rate) == pytest.approx(1e-4 * 0.995**decays, rel=1e-5)
