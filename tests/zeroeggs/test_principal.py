"""Laws of a library's principal components and of its cloud."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.zeroeggs import style_space as space

N, Z = 40, 6


@pytest.fixture(scope="module")
def points():
    """Forty embeddings whose spread falls from axis to axis, turned anyhow, away from the origin."""
    draw = np.random.default_rng(0)
    turn, _ = np.linalg.qr(draw.normal(size=(Z, Z)))
    spread = np.array([4.0, 2.0, 1.0, 0.5, 0.25, 0.1])
    return jnp.asarray((draw.normal(size=(N, Z)) * spread) @ turn.T + 3.0, jnp.float32)


@pytest.fixture(scope="module")
def components(points):
    return space.principal(points)


def close(a, b, tolerance=1e-4):
    np.testing.assert_allclose(a, b, atol=tolerance, rtol=tolerance)


def test_axes_are_orthonormal_and_sorted_and_their_signs_fixed(points, components):
    close(components.axes @ components.axes.T, jnp.eye(Z))
    assert (jnp.diff(components.std) < 0).all()
    close(components.share.sum(), 1.0)
    largest = jnp.take_along_axis(components.axes, jnp.abs(components.axes).argmax(1, keepdims=True), axis=1)
    assert (largest > 0).all()
    shuffled = space.principal(points[::-1])
    close(shuffled.axes, components.axes, 1e-3)


def test_coordinates_have_unit_spread_and_are_uncorrelated(points, components):
    along = np.asarray(jax.vmap(space.coordinates, (None, 0))(components, points))
    close(along.mean(0), np.zeros(Z), 1e-3)
    close(np.cov(along.T), np.eye(Z), 1e-2)


def test_the_shares_are_those_of_the_variance(points, components):
    variance = np.linalg.eigvalsh(np.cov(np.asarray(points, np.float64).T))[::-1]
    close(components.share, variance / variance.sum(), 1e-4)
    close(components.std, np.sqrt(variance), 1e-3)


def test_an_embedding_is_restored_from_its_coordinates(points, components):
    close(space.restore(components, space.coordinates(components, points[5])), points[5])
    close(space.restore(components, jnp.zeros(Z)), components.mean)


def test_few_points_span_few_directions_and_project_onto_them(points):
    flat = space.principal(points[:4])
    assert flat.axes.shape == (3, Z)
    for z in points[:4]:
        close(space.restore(flat, space.coordinates(flat, z)), z, 1e-3)
    outside = points[20]
    projected = space.restore(flat, space.coordinates(flat, outside))
    assert jnp.linalg.norm(projected - outside) > 0.1
    close(flat.axes @ (projected - outside), jnp.zeros(3), 1e-3)


def test_a_move_is_counted_in_standard_deviations(points, components):
    z = points[0]
    moved = space.move(components, z, {1: 2.0, 3: -0.5})
    close(space.coordinates(components, moved) - space.coordinates(components, z), [2.0, 0, -0.5, 0, 0, 0], 1e-3)
    close(space.move(components, moved, {1: -2.0, 3: 0.5}), z)
    np.testing.assert_array_equal(space.move(components, z, {}), z)
    halves = space.move(components, space.move(components, z, {2: 0.5}), {2: 0.5})
    close(halves, space.move(components, z, {2: 1.0}))


@pytest.mark.parametrize("number", [0, -1, Z + 1])
def test_a_component_that_is_not_there(components, points, number):
    with pytest.raises(ValueError, match=rf"component {number} was asked for, but the library has components 1 to {Z}"):
        space.move(components, points[0], {number: 1.0})


@pytest.mark.parametrize("fit", [space.principal, space.cloud])
@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        (jnp.ones((1, Z)), "a library of 1 embedding has no"),
        (jnp.arange(2.0 * Z).reshape(2, Z), "a library of 2 embeddings has no"),
        (jnp.ones((5, Z)), "5 equal embeddings"),
        (jnp.full((5, Z), jnp.nan), "not finite"),
    ],
)
def test_points_without_directions(fit, points, sentence):
    with pytest.raises(ValueError, match=rf"{sentence}.*embed 3 or more clips that differ"):
        fit(points)


def test_the_farthest_point_lies_at_one_and_the_mean_at_zero(points):
    cloud = space.cloud(points)
    far = jax.vmap(space.outlying, (None, 0))(cloud, points)
    close(far.max(), 1.0, 1e-5)
    assert space.outlying(cloud, points.mean(0)) < 1e-4


def test_distance_grows_in_proportion_to_intensity(points):
    cloud = space.cloud(points)
    amounts = jnp.linspace(0.0, 3.0, 13)
    far = jax.vmap(lambda a: space.outlying(cloud, space.intensify(points[7], cloud.mean, a)))(amounts)
    close(far, amounts * space.outlying(cloud, points[7]), 1e-4)


def test_distance_does_not_depend_on_the_space_s_frame(points):
    """Without shrinkage under any affine map; with it under moves, turns and one scale for all."""
    z = points[3] * 1.7
    skew = np.random.default_rng(5).normal(size=(Z, Z)).astype(np.float32) + 3.0 * np.eye(Z, dtype=np.float32)
    turn, _ = np.linalg.qr(skew)
    for by, shrinkage in ((skew, 0.0), (0.1 * turn, 0.1)):
        plain = space.outlying(space.cloud(points, shrinkage), z)
        mapped = space.outlying(space.cloud(points @ by.T - 1.0, shrinkage), by @ z - 1.0)
        close(mapped, plain, 5e-3)
    stretched = jnp.diag(jnp.array([1.0, 1.0, 1.0, 1.0, 1.0, 30.0]))
    shrunk = space.outlying(space.cloud(points), z)
    assert jnp.abs(space.outlying(space.cloud(points @ stretched.T), stretched @ z) - shrunk) > 0.01


def test_a_direction_that_the_library_has_not_is_far_but_not_endlessly():
    flat = np.linspace(-1.0, 1.0, 20, dtype=np.float32)[:, None] * np.eye(3, dtype=np.float32)[:1]
    cloud = space.cloud(flat)
    along, across = (space.outlying(cloud, jnp.eye(3)[k]) for k in (0, 1))
    assert 0.9 < along < 1.1
    assert 2.0 < across < 10.0


def test_the_nearest_are_the_nearest(points):
    indices, distances = space.nearest(points, points[11] + 1e-3, 4)
    assert int(indices[0]) == 11
    assert (jnp.diff(distances) >= 0).all()
    every, _ = space.nearest(points, points[11], 10 * N)
    assert sorted(every.tolist()) == list(range(N))
