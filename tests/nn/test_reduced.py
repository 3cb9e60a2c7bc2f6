"""Reduced weights: how far rounding goes, and that the kernel multiplies what they stand for, wherever it is called."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.nn import native, reduced

KINDS = ("bfloat16", "int8")
ROUNDING = 2e-6  # of float32 sums, against the largest product that could come out


@pytest.fixture(scope="module")
def kernel():
    """The tests of the kernel; where there is no compiler the others say what happens then."""
    if native.problem():
        pytest.skip(native.problem())


@pytest.fixture
def without_compiler(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CXX", raising=False)
    native.problem.cache_clear()
    yield
    native.problem.cache_clear()


def matrix(rows, columns, seed=0):
    rng = np.random.default_rng([seed, rows, columns])
    return (rng.normal(size=(rows, columns)) * 10.0 ** rng.uniform(-3, 3, (rows, 1))).astype(np.float32)


def vectors(*shape, seed=1):
    return np.random.default_rng([seed, *shape]).normal(size=shape).astype(np.float32)


def exact(weight, x):
    return np.asarray(reduced.restore(weight), np.float64) @ np.asarray(x, np.float64)


def check_product(weight, x, y, rounding=ROUNDING):
    """Each entry of y is that of the restored weight, to what summing in float32 may cost."""
    most = np.abs(reduced.restore(weight)).max(1)[:, None] * np.abs(np.asarray(x, np.float64)).sum(-2, keepdims=True)
    assert (np.abs(np.asarray(y) - exact(weight, x)) <= rounding * most + 1e-30).all()


@pytest.mark.parametrize("seed", range(3))
def test_bfloat16_is_within_half_of_its_last_digit(seed):
    weight = matrix(20, 50, seed)
    off = np.abs(reduced.restore(reduced.reduce(weight, "bfloat16")) - weight)
    assert (off <= np.abs(weight) * 2.0**-8).all()


@pytest.mark.parametrize("seed", range(3))
def test_int8_is_within_half_a_step_of_its_row(seed):
    weight = matrix(20, 50, seed)
    weight[3] = 0.0
    small = reduced.reduce(weight, "int8")
    bound = np.abs(weight).max(1, keepdims=True) / 254 * (1 + 1e-5)
    assert (np.abs(reduced.restore(small) - weight) <= bound).all()
    assert not np.asarray(reduced.restore(small))[3].any()
    np.testing.assert_allclose(np.abs(reduced.restore(small)).max(1), np.abs(weight).max(1), rtol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_reduced_stays_as_it_is_when_reduced_again(kind):
    once = reduced.reduce(matrix(7, 9), kind)
    np.testing.assert_array_equal(reduced.reduce(reduced.restore(once), kind).weight, once.weight)


@settings(max_examples=12, deadline=None)
@given(rows=st.integers(1, 41), inner=st.integers(1, 300), columns=st.integers(1, 7), kind=st.sampled_from(KINDS))
def test_the_kernel_multiplies_the_weight_whatever_the_sizes(kernel, rows, inner, columns, kind):
    weight, x = reduced.reduce(matrix(rows, inner), kind), vectors(inner, columns)
    check_product(weight, x, reduced.product(weight, jnp.asarray(x)))


@pytest.mark.parametrize("kind", KINDS)
def test_the_kernel_shares_large_weights_among_threads(kernel, kind):
    weight, x = reduced.reduce(matrix(1031, 517), kind), vectors(517, 3)
    call = jax.jit(reduced.product)
    first = call(weight, jnp.asarray(x))
    check_product(weight, x, first)
    for _ in range(50):
        np.testing.assert_array_equal(call(weight, jnp.asarray(x)), first)


@pytest.mark.parametrize("kind", KINDS)
def test_batches_of_columns(kernel, kind):
    weight, x = reduced.reduce(matrix(5, 70), kind), vectors(2, 3, 70, 4)
    both = jax.vmap(jax.vmap(reduced.product, (None, 0)), (None, 0))(weight, jnp.asarray(x))
    check_product(weight, x, both)


@pytest.mark.parametrize("kind", KINDS)
def test_many_columns_are_rounded_to_bfloat16_where_that_pays(kernel, monkeypatch, kind):
    monkeypatch.setattr(native, "multiplies_bfloat16", lambda: True)
    weight, x = reduced.reduce(matrix(33, 70), kind), vectors(70, reduced.MANY)
    y = reduced.product(weight, jnp.asarray(x))
    check_product(weight, x, y, 2.0**-9 + ROUNDING)
    check_product(weight, np.asarray(jnp.asarray(x, jnp.bfloat16), np.float32), y)
    monkeypatch.setattr(native, "multiplies_bfloat16", lambda: False)
    check_product(weight, x, reduced.product(weight, jnp.asarray(x)))


@pytest.mark.parametrize("kind", KINDS)
def test_powers_of_two_pass_through(kernel, kind):
    weight, x = reduced.reduce(matrix(6, 100), kind), jnp.asarray(vectors(100, 1))
    for power in (-60, 60):
        scaled = reduced.product(weight, x * 2.0**power)
        np.testing.assert_allclose(scaled, reduced.product(weight, x) * 2.0**power, rtol=1e-6)
    np.testing.assert_array_equal(reduced.product(weight, 0.0 * x), np.zeros((6, 1)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_is_seen_behind_the_kernel(kernel, kind, bad):
    weight, x = reduced.reduce(matrix(6, 100), kind), jnp.asarray(vectors(100, 1)).at[7].set(bad)
    assert not np.isfinite(reduced.product(weight, x)).any()


@pytest.mark.parametrize("kind", KINDS)
def test_inside_a_loop_the_weight_stays_small(kernel, kind):
    weight = reduced.reduce(matrix(96, 96) / np.float32(1e4), kind)

    def loop(weight, x):
        return jax.lax.scan(lambda x, _: (jnp.tanh(reduced.product(weight, x)), x), x, length=5)

    compiled = jax.jit(loop).lower(weight, jnp.ones((96, 1))).compile()
    last, seen = compiled(weight, jnp.ones((96, 1)))
    x = np.ones((96, 1))
    for row in seen:
        np.testing.assert_allclose(row, x, atol=1e-5)
        x = np.tanh(exact(weight, x))
    np.testing.assert_allclose(last, x, atol=1e-5)
    assert "f32[96,96]" not in compiled.as_text()
    assert "zeggs_" in compiled.as_text()


@pytest.mark.parametrize("kind", KINDS)
def test_batched_weights_are_refused(kernel, kind):
    weights = jax.tree.map(lambda *rows: jnp.stack(rows), *[reduced.reduce(matrix(3, 4, s), kind) for s in range(2)])
    with pytest.raises(Exception, match="batch the columns instead"):
        jax.block_until_ready(jax.vmap(reduced.product)(weights, jnp.ones((2, 4, 1))))


@pytest.mark.parametrize("kind", KINDS)
def test_without_a_compiler_the_numbers_are_the_same(without_compiler, kind):
    assert "no C++ compiler was found" in native.problem()
    weight, x = matrix(300, 260), vectors(260, 2)
    small = reduced.reduce(weight, kind)
    settled = reduced.with_precision({"w": jnp.asarray(weight)}, kind)["w"]
    np.testing.assert_array_equal(settled, reduced.restore(small))
    check_product(small, x, reduced.product(small, jnp.asarray(x)))
    check_product(small, x, reduced.product(settled, jnp.asarray(x)))


def test_only_large_matrices_are_reduced(kernel):
    tree = {"large": jnp.ones((256, 256)), "small": jnp.ones((255, 256)), "bias": jnp.ones(1 << 16)}
    made = reduced.with_precision(tree, "int8")
    assert isinstance(made["large"], reduced.Reduced)
    assert made["small"] is tree["small"]
    assert made["bias"] is tree["bias"]
    assert reduced.with_precision(tree, "float32") == tree


def test_plain_weights_are_multiplied_plainly():
    weight, x = jnp.asarray(matrix(4, 5)), jnp.asarray(vectors(5, 2))
    np.testing.assert_array_equal(reduced.product(weight, x), weight @ x)


@pytest.mark.parametrize(
    ("weight", "kind", "says"),
    [
        (np.ones((2, 3), np.float32) * np.nan, "int8", "finite matrix"),
        (np.ones((2, native.MOST_COLUMNS + 1), np.float32), "int8", "65536 are the most"),
    ],
)
def test_what_cannot_be_reduced_is_refused(weight, kind, says):
    with pytest.raises(ValueError, match=says):
        reduced.reduce(weight, kind)
