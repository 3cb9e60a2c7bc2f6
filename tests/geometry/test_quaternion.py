"""Quaternions: group laws, round trips, thresholds and gradients, in float32 and float64."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.geometry import quaternion as Q

ORDERS = ["".join(order) for order in itertools.permutations("xyz")]
DTYPES = [np.float32, np.float64]
EDGES = [0.0, 1e-12, 1e-8, 9e-6, 1.1e-5, 1e-4, 1e-2, math.pi - 1e-4, math.pi - 1e-7, math.pi, math.pi + 1e-6]

angles = st.sampled_from(EDGES) | st.floats(-math.pi, math.pi)
components = st.floats(-1.0, 1.0).map(lambda x: round(x, 3))
axes = st.tuples(components, components, components).filter(lambda a: np.linalg.norm(a) > 0.1)


@st.composite
def unit(draw):
    """A unit quaternion, often next to no rotation or to a half turn."""
    axis, half = np.array(draw(axes)), draw(angles) / 2
    return np.concatenate([[math.cos(half)], math.sin(half) * axis / np.linalg.norm(axis)])


vectors = st.tuples(*[st.floats(-100, 100).map(lambda x: round(x, 2))] * 3).map(np.array)
laws = settings(deadline=None, max_examples=60)


def run(function, *arguments, dtype=np.float64):
    """Call compiled, in one precision; checks that it is kept."""
    with jax.enable_x64(dtype is np.float64):
        result = jax.jit(function)(*(jnp.asarray(x, dtype) for x in arguments))
        assert result.dtype == dtype
        return np.asarray(result)


multiply, rotate, inverse = Q.multiply, Q.rotate, Q.inverse
close = {np.float32: 3e-6, np.float64: 1e-12}


@laws
@given(unit(), unit(), unit(), st.sampled_from(DTYPES))
def test_unit_quaternions_are_a_group(q, p, r, dtype):
    left = run(multiply, run(multiply, q, p, dtype=dtype), r, dtype=dtype)
    right = run(multiply, q, run(multiply, p, r, dtype=dtype), dtype=dtype)
    np.testing.assert_allclose(left, right, atol=close[dtype])
    none = run(multiply, q, run(inverse, q, dtype=dtype), dtype=dtype)
    np.testing.assert_allclose(none, [1, 0, 0, 0], atol=close[dtype])


@laws
@given(unit(), unit(), vectors, st.sampled_from(DTYPES))
def test_a_product_turns_by_the_right_factor_first(q, p, v, dtype):
    atol = close[dtype] * (1 + np.linalg.norm(v))
    twice = run(rotate, q, run(rotate, p, v, dtype=dtype), dtype=dtype)
    once = run(rotate, run(multiply, q, p, dtype=dtype), v, dtype=dtype)
    np.testing.assert_allclose(twice, once, atol=atol)
    np.testing.assert_allclose(np.linalg.norm(once), np.linalg.norm(v), atol=atol)
    np.testing.assert_allclose(run(Q.to_matrix, q, dtype=dtype) @ v, run(rotate, q, v, dtype=dtype), atol=atol)


def test_turning_x_a_quarter_about_z_gives_y():
    quarter = np.array([math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4)])
    np.testing.assert_allclose(run(rotate, quarter, [1.0, 0.0, 0.0]), [0, 1, 0], atol=1e-15)


@laws
@given(axes, angles, st.sampled_from(DTYPES))
def test_exp_and_log_are_inverse(axis, angle, dtype):
    v = np.array(axis) / np.linalg.norm(axis) * abs(angle)
    q = run(Q.from_scaled_axis, v, dtype=dtype)
    back = run(Q.to_scaled_axis, q, dtype=dtype)
    # under the threshold the vector part is divided by 1.00001, as released
    np.testing.assert_allclose(back, v, atol=close[dtype] + 1.1e-5 * abs(angle) * (abs(angle) < 2.1e-5))


@laws
@given(unit(), st.sampled_from(DTYPES))
def test_log_goes_the_way_of_the_sign(q, dtype):
    """Both signs are one rotation: with w > 0 the angle is at most pi."""
    for signed in (q, -q):
        turn = run(Q.to_scaled_axis, signed, dtype=dtype)
        small = run(Q.to_scaled_axis, run(Q.positive, signed, dtype=dtype), dtype=dtype)
        assert np.linalg.norm(small) <= math.pi + 1e-5
        if np.linalg.norm(q[1:]) > 1e-4:
            np.testing.assert_allclose(
                run(Q.to_matrix, run(Q.from_scaled_axis, turn, dtype=dtype), dtype=dtype),
                run(Q.to_matrix, q, dtype=dtype),
                atol=10 * close[dtype],
            )


def test_a_step_below_the_threshold_shortens_as_released():
    for v, length in (
        ([0.0, 0.0, 0.0], 1 / 1.00001),
        ([0.0, 1.9e-5, 0.0], 1 / 1.00001),
        ([0.0, 2.1e-5, 0.0], 1.0),
    ):
        np.testing.assert_allclose(np.linalg.norm(run(Q.from_scaled_axis, v)), length, rtol=1e-9)


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles_are_products_of_three_turns(order):
    """Against plain matrices: "zyx" is R_z R_y R_x."""

    def about(axis, angle):
        i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        m = np.eye(3)
        m[i, i] = m[j, j] = math.cos(angle)
        m[i, j], m[j, i] = -math.sin(angle), math.sin(angle)
        return m

    angles = np.random.default_rng(0).uniform(-math.pi, math.pi, (20, 3))
    ours = run(lambda e: Q.to_matrix(Q.from_euler(e, order)), angles)
    for m, turns in zip(ours, angles, strict=True):
        expected = np.linalg.multi_dot([about(axis, turn) for axis, turn in zip(order, turns, strict=True)])
        np.testing.assert_allclose(m, expected, atol=1e-14)


@pytest.mark.parametrize("order", ORDERS)
@laws
@given(first=angles, middle=st.floats(-1.55, 1.55), last=angles, dtype=st.sampled_from(DTYPES))
def test_euler_angles_come_back(order, first, middle, last, dtype):
    """Within the middle angle's range the angles themselves, up to whole turns (1.55 is next to the lock)."""
    given_angles = np.array([first, middle, last])
    back = run(_there_and_back[order], given_angles, dtype=dtype)
    error = (back - given_angles + math.pi) % (2 * math.pi) - math.pi
    np.testing.assert_allclose(error, 0, atol=close[dtype] * 10 / math.cos(middle))


@pytest.mark.parametrize("order", ORDERS)
@laws
@given(q=unit(), dtype=st.sampled_from(DTYPES))
def test_euler_angles_describe_the_same_rotation(order, q, dtype):
    same = run(_matrix_by_euler[order], q, dtype=dtype)
    np.testing.assert_allclose(same, run(Q.to_matrix, q, dtype=dtype), atol=20 * close[dtype])


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("middle", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize("dtype", DTYPES)
def test_gimbal_lock_keeps_the_rotation(order, middle, dtype):
    """Exactly at the lock and through the change of formulas next to it."""
    away = np.concatenate([[0.0], np.logspace(-9, -1, 33)])
    angles = np.stack([np.full_like(away, 2.5), middle * (1 - away / 2), np.full_like(away, -1.2)], axis=-1)
    q = run(_quaternion[order], angles, dtype=dtype)
    ours = run(_matrix_by_euler[order], q, dtype=dtype)
    np.testing.assert_allclose(ours, run(Q.to_matrix, q, dtype=dtype), atol=20 * close[dtype])


_quaternion = {order: lambda e, order=order: Q.from_euler(e, order) for order in ORDERS}
_there_and_back = {order: lambda e, order=order: Q.to_euler(Q.from_euler(e, order), order) for order in ORDERS}
_matrix_by_euler = {
    order: lambda q, order=order: Q.to_matrix(Q.from_euler(Q.to_euler(q, order), order)) for order in ORDERS
}


def test_unknown_euler_order_is_refused():
    for order in ("zyz", "zy", "ZYX"):
        with pytest.raises(ValueError, match="is not one of xyz"):
            Q.from_euler(np.zeros(3), order)


@laws
@given(unit(), st.sampled_from(DTYPES))
def test_matrices_come_back_up_to_sign(q, dtype):
    back = run(Q.from_matrix, run(Q.to_matrix, q, dtype=dtype), dtype=dtype)
    np.testing.assert_allclose(back * np.sign(back @ q), q, atol=close[dtype])


@laws
@given(axes, axes)
def test_between_turns_one_direction_into_the_other(a, b):
    a, b = np.array(a), np.array(b)
    cosine = a @ b / np.linalg.norm(a) / np.linalg.norm(b)
    turned = run(rotate, run(Q.normalize, run(Q.between, a, b)), a)
    if cosine > -1 + 1e-6:
        np.testing.assert_allclose(turned / np.linalg.norm(a), b / np.linalg.norm(b), atol=1e-7)


def test_unroll_leaves_no_jump_and_the_same_rotations():
    rng = np.random.default_rng(0)
    smooth = np.cumsum(rng.normal(0, 0.1, (50, 3, 4)), axis=0) + np.array([3.0, 0, 0, 0])
    smooth /= np.linalg.norm(smooth, axis=-1, keepdims=True)
    flipped = smooth * rng.choice([-1.0, 1.0], (50, 3, 1))
    unrolled = run(Q.unroll, flipped)
    assert (np.sum(unrolled[1:] * unrolled[:-1], axis=-1) > 0).all()
    np.testing.assert_array_equal(unrolled[0], flipped[0])
    np.testing.assert_array_equal(np.abs(unrolled), np.abs(flipped))


@laws
@given(unit(), axes, st.floats(-3.0, 3.0), st.floats(0.0, 1.0), st.sampled_from(DTYPES))
def test_slerp_turns_at_constant_speed(q, axis, angle, t, dtype):
    def step(part):
        return run(Q.from_scaled_axis, np.array(axis) / np.linalg.norm(axis) * angle * part)

    end, expected = run(multiply, step(1.0), q), run(multiply, step(t), q)
    np.testing.assert_allclose(run(Q.slerp, q, end, t, dtype=dtype), expected, atol=1e-5)


GRADIENTS = {
    "exp": (Q.exp, [[0.0, 0, 0], [1e-5, 0, 0], [math.pi, 0, 0], [1e-20, 0, 0]]),
    "from_scaled_axis": (Q.from_scaled_axis, [[0.0, 0, 0], [0, math.pi, 0], [0, 2 * math.pi, 0]]),
    "log": (Q.log, [[1.0, 0, 0, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [1, 1e-20, 0, 0]]),
    "positive": (Q.positive, [[0.0, 1, 0, 0], [1, 0, 0, 0]]),
    "normalize": (Q.normalize, [[0.0, 0, 0, 0], [1, 0, 0, 0]]),
    "from_matrix": (
        lambda q: Q.from_matrix(Q.to_matrix(q)),
        [[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0.5, 0.5, 0.5, 0.5]],
    ),
    "slerp to itself": (lambda q: Q.slerp(q, q, 0.5), [[1.0, 0, 0, 0], [0, 1, 0, 0]]),
    "slerp to its opposite": (lambda q: Q.slerp(q, -q, 0.5), [[1.0, 0, 0, 0], [0, 1, 0, 0]]),
    "between": (lambda v: Q.between(v, -v), [[0.0, 0, 0], [0, 0, 1]]),
    **{
        f"to_euler {order}": (
            lambda q, order=order: Q.to_euler(q, order),
            [[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
            + [[math.sqrt(0.5), *(sign * math.sqrt(0.5) * axis)] for axis in np.eye(3) for sign in (1, -1)]
            + [[0.5, 0.5, 0.5, 0.5], [0.5, -0.5, 0.5, 0.5]],
        )
        for order in ORDERS
    },
}


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", GRADIENTS)
def test_gradients_are_finite(name, dtype):
    function, points = GRADIENTS[name]
    slope = run(jax.vmap(jax.jacrev(function)), np.array(points), dtype=dtype)
    assert np.isfinite(slope).all()


def test_gradient_of_a_small_turn_is_half():
    slope = run(jax.jacrev(Q.from_scaled_axis), np.zeros(3))
    np.testing.assert_allclose(slope, np.concatenate([np.zeros((1, 3)), 0.5 * np.eye(3)]), atol=1e-5)
