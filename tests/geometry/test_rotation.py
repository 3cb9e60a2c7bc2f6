"""Two-axis rotations: what comes out is a rotation, whatever goes in; round trips; gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.geometry import quaternion, rotation

numbers = st.floats(-10, 10).map(lambda x: round(x, 2))
two_axes = st.tuples(*[numbers] * 6).map(lambda x: np.array(x).reshape(2, 3))
to_matrix = jax.jit(rotation.axes_to_matrix)


@settings(deadline=None)
@given(two_axes.filter(lambda xy: np.linalg.norm(np.cross(*xy)) > 1.0))
def test_any_two_axes_give_a_rotation_that_keeps_the_first(xy):
    m = np.asarray(to_matrix(jnp.asarray(xy, jnp.float32)))
    np.testing.assert_allclose(m.T @ m, np.eye(3), atol=1e-5)
    assert np.linalg.det(m) > 0.99
    np.testing.assert_allclose(m[:, 0], xy[0] / np.linalg.norm(xy[0]), atol=1e-6)
    assert m[:, 1] @ xy[1] > 0  # the second axis keeps its side
    np.testing.assert_allclose(m[:, 2] @ xy[1], 0, atol=1e-4)  # and its plane


def test_axes_and_quaternions_come_back():
    q = np.random.default_rng(0).normal(size=(5, 7, 4))
    q = (q / np.linalg.norm(q, axis=-1, keepdims=True)).astype(np.float32)
    back = np.asarray(rotation.axes_to_quaternion(rotation.quaternion_to_axes(q)))
    np.testing.assert_allclose(back * np.sign(np.sum(back * q, axis=-1, keepdims=True)), q, atol=1e-6)
    axes = rotation.quaternion_to_axes(q)
    np.testing.assert_allclose(
        axes[..., 1, :], quaternion.rotate(q, jnp.broadcast_to(jnp.eye(3)[1], (5, 7, 3))), atol=1e-6
    )


def test_a_batch_of_three_is_crossed_along_the_last_axis():
    """The release crosses the first axis of length 3 and gets something else here."""
    xy = np.random.default_rng(1).normal(size=(3, 2, 3)).astype(np.float32)
    one_by_one = jnp.stack([rotation.axes_to_matrix(x) for x in xy])
    np.testing.assert_allclose(rotation.axes_to_matrix(xy), one_by_one, atol=1e-6)


@pytest.mark.parametrize("xy", [np.zeros((2, 3)), [[1.0, 0, 0], [2.0, 0, 0]], [[0.0, 0, 0], [0, 1.0, 0]]])
def test_degenerate_axes_have_finite_gradients(xy):
    slope = jax.jacrev(rotation.axes_to_matrix)(jnp.asarray(xy, jnp.float32))
    assert np.isfinite(slope).all()
