"""Poses: packing is lossless and in the release's order, the root integrates, rebasing moves just it."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.geometry import quaternion
from zeggs_jax.motion.pose import (
    Root,
    from_vector,
    gaze_direction,
    integrate,
    rebase,
    relative,
    size,
    to_vector,
)


def root(seed: int = 0, yaw: float | None = None) -> Root:
    rng = np.random.default_rng(seed)
    half = rng.uniform(-1.5, 1.5) if yaw is None else yaw / 2
    pos = np.array([*rng.normal(size=2) * 50, 0.0])[[0, 2, 1]]
    return Root(jnp.asarray(pos, jnp.float32), jnp.array([math.cos(half), 0, math.sin(half), 0], jnp.float32))


@settings(deadline=None, max_examples=10)
@given(st.integers(1, 8), st.sampled_from([(), (4,), (2, 3)]))
def test_packing_is_lossless(joints, lead):
    vector = np.arange(math.prod(lead) * size(joints), dtype=np.float32).reshape(*lead, size(joints))
    place = Root(jnp.zeros((*lead, 3)), jnp.zeros((*lead, 4)))
    pose = from_vector(vector, place)
    np.testing.assert_array_equal(to_vector(pose), vector)
    assert pose.joint_axes.shape == (*lead, joints, 2, 3)


def test_order_is_the_release_s():
    pose = from_vector(np.arange(size(75), dtype=np.float32), root())
    assert size(75) == 1131
    firsts = [float(part.reshape(-1)[0]) for part in pose[1:]]
    assert firsts == [0, 3, 6, 231, 681, 906]
    assert float(pose.joint_axes[2, 1, 0]) == 231 + 2 * 6 + 3


def test_a_vector_of_another_length_is_refused():
    with pytest.raises(ValueError, match="got 1132"):
        from_vector(np.zeros(1132, np.float32), root())


def test_walking_straight_and_on_a_circle():
    """One second ahead is one second ahead; a steady turn and pace close a circle."""
    here, dt = root(yaw=math.pi / 2), 0.01
    for _ in range(100):
        here = integrate(here, jnp.array([0.0, 0, 30.0]), jnp.zeros(3), dt)
    np.testing.assert_allclose(here.pos - root(yaw=math.pi / 2).pos, [30, 0, 0], atol=0.1)

    walk = jax.jit(integrate)
    start = here = root(1)
    for _ in range(200):
        here = walk(here, jnp.array([0.0, 0, 30.0]), jnp.array([0.0, math.pi, 0.0]), 0.01)
    np.testing.assert_allclose(here.pos, start.pos, atol=1e-2)
    np.testing.assert_allclose(here.rot, -start.rot, atol=1e-4)  # once round is the other sign


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 1000))
def test_integration_does_not_depend_on_the_world(seed):
    """Equivariance: move the world, integrate; or integrate, move the world."""
    here, origin = root(seed), root(seed + 1)
    vel, ang = jnp.asarray(np.random.default_rng(seed).normal(size=(2, 3)) * 20, jnp.float32)
    a = relative(integrate(here, vel, ang, 0.1), origin)
    b = integrate(relative(here, origin), vel, ang, 0.1)
    np.testing.assert_allclose(a.pos, b.pos, atol=1e-3)
    np.testing.assert_allclose(a.rot, b.rot, atol=1e-5)


def test_gaze_is_seen_from_the_root():
    here = root(3, yaw=math.pi / 2)  # faces +X
    np.testing.assert_allclose(gaze_direction(here, here.pos + jnp.array([100.0, 0, 0])), [0, 0, 100], atol=1e-4)


def test_rebasing_on_itself_is_the_origin_and_changes_nothing_else():
    pose = from_vector(np.random.default_rng(0).normal(size=size(4)).astype(np.float32), root(2))
    moved = rebase(pose, pose.root)
    np.testing.assert_allclose(moved.root.pos, [0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(moved.root.rot, [1, 0, 0, 0], atol=1e-6)
    np.testing.assert_array_equal(to_vector(moved), to_vector(pose))
    assert np.isfinite(quaternion.log(moved.root.rot)).all()
