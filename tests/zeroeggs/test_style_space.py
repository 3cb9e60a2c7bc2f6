"""Laws of the style space's algebra."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.zeroeggs import style_space as space
from zeggs_jax.zeroeggs.model import StyleDistribution

Z = 5


@pytest.fixture(params=range(3))
def some(request):
    """Four embeddings."""
    return np.random.default_rng(request.param).normal(size=(4, Z)).astype(np.float32)


def close(a, b, tolerance=1e-5):
    np.testing.assert_allclose(a, b, atol=tolerance, rtol=tolerance)


def test_a_blend_is_a_weighted_sum_of_any_weights(some):
    a, b, *_ = some
    close(space.blend(np.stack([a, b]), [0.0, 1.0]), b)
    close(space.blend(np.stack([a, b]), [2.0, -1.0]), a + (a - b))


@pytest.mark.parametrize(("one", "other"), [(0.5, 2.0), (-1.0, 1.7)])
def test_intensity_is_a_scaling_about_the_centre(some, one, other):
    style, centre, *_ = some
    np.testing.assert_array_equal(space.intensify(style, centre, 1.0), style)  # to the bit
    close(space.intensify(style, centre, 0.0), centre)
    twice = space.intensify(space.intensify(style, centre, one), centre, other)
    close(twice, space.intensify(style, centre, one * other), 1e-4)
    close(space.intensify(centre, centre, one), centre)


def test_a_transfer_is_arithmetic(some):
    style, to, away, _ = some
    np.testing.assert_array_equal(space.transfer(style, to, to), style)
    close(space.transfer(space.transfer(style, to, away), away, to), style)
    close(space.transfer(away, to, away), to)


def test_ways_have_their_ends(some):
    a, b, centre, _ = some
    walked = space.line(a, b, 5)
    np.testing.assert_array_equal(walked[0], a)
    np.testing.assert_array_equal(walked[-1], b)
    close(walked[2], 0.5 * (a + b))
    turned = space.arc(a, b, 5, centre)
    close(turned[0], a, 1e-4)
    close(turned[-1], b, 1e-4)
    close(turned, space.arc(b, a, 5, centre)[::-1], 1e-4)


def test_an_arc_keeps_its_radius_and_turns_evenly():
    centre = jnp.arange(Z, dtype=jnp.float32)
    a, b = (centre + 2.0 * jnp.eye(Z)[k] for k in (0, 3))
    away = space.arc(a, b, 7, centre) - centre[None]
    close(jnp.linalg.norm(away, axis=1), jnp.full(7, 2.0))
    steps = jnp.arccos(jnp.sum(away[1:] * away[:-1], axis=1) / 4.0)
    close(steps, jnp.full(6, np.pi / 12), 1e-4)
    straight = space.line(a, b, 7) - centre[None]
    assert jnp.linalg.norm(straight, axis=1).min() < 1.5  # the line comes nearer: what the arc is for


@pytest.mark.parametrize("degrees", [0.0, 1e-3, 0.1, 179.9, 179.999, 180.0])
def test_an_arc_of_no_angle_or_of_half_a_turn_is_the_line(degrees):
    angle = np.radians(degrees)
    a, b = jnp.array([1.0, 0.0]), jnp.array([np.cos(angle), np.sin(angle)], jnp.float32)
    close(space.arc(a, b, 9, jnp.zeros(2)), space.line(a, b, 9), 2e-3)


def test_an_arc_changes_smoothly_with_its_angle():
    @jax.jit
    @jax.vmap
    def middle(angle):
        return space.arc(jnp.array([1.0, 0.0]), jnp.array([jnp.cos(angle), jnp.sin(angle)]), 3, jnp.zeros(2))[1]

    angles = jnp.linspace(0.0, np.pi, 721)
    middles = middle(angles)
    assert np.isfinite(middles).all()
    assert jnp.abs(jnp.diff(middles, axis=0)).max() < 0.05
    assert np.isfinite(space.arc(jnp.zeros(2), jnp.ones(2), 3, jnp.zeros(2))).all()  # from the centre itself


@pytest.mark.parametrize("way", [space.line, lambda a, b, n: space.arc(a, b, n, a)])
def test_a_way_has_two_ends(way):
    with pytest.raises(ValueError, match=r"1 steps has no two ends; ask for at least 2"):
        way(jnp.zeros(Z), jnp.ones(Z), 1)


def test_variations_spread_with_temperature_about_the_mean():
    style = StyleDistribution(jnp.arange(Z, dtype=jnp.float32), jnp.log(jnp.full(Z, 0.25)))
    key = jax.random.key(3)
    np.testing.assert_array_equal(space.vary(key, style, 4, 0.0), jnp.tile(style.mean[None], (4, 1)))
    many = space.vary(key, style, 2000, 2.0)
    close(many.mean(0), style.mean, 0.1)
    close(many.std(0), jnp.full(Z, 1.0), 0.1)
    close(many - style.mean[None], 2.0 * (space.vary(key, style, 2000, 1.0) - style.mean[None]), 1e-4)
    assert len(np.unique(many[:, 0])) > 1950


def test_a_style_that_is_no_distribution_does_not_vary():
    style = StyleDistribution(jnp.ones(Z), None)
    np.testing.assert_array_equal(space.vary(jax.random.key(0), style, 3, 5.0), jnp.ones((3, Z)))


def test_the_prior_is_a_unit_gaussian_times_the_temperature():
    drawn = space.prior(jax.random.key(1), Z, 2000)
    close(drawn.mean(0), jnp.zeros(Z), 0.1)
    close(drawn.std(0), jnp.ones(Z), 0.1)
    close(space.prior(jax.random.key(1), Z, 2000, 0.5), 0.5 * drawn)
    np.testing.assert_array_equal(space.prior(jax.random.key(1), Z, 3, 0.0), jnp.zeros((3, Z)))


def test_a_style_held_and_styles_stitched():
    a, b = jnp.zeros(Z), jnp.ones(Z)
    assert space.hold(b, 7).shape == (7, Z)
    both = space.stitch(jnp.stack([a, b]), (0.3, 0.7), 10)
    np.testing.assert_array_equal(both[:, 0], [0.0] * 3 + [1.0] * 7)
    assert space.boundaries((0.1,) * 10, 84)[-1] == 84


def test_the_algebra_is_differentiable_and_jits():
    a, b, c = (space.prior(jax.random.key(k), Z, 1)[0] for k in range(3))

    @jax.jit
    def far(a, amount):
        moved = space.intensify(space.transfer(a, b, c), c, amount)
        return (space.arc(moved, b, 3, c)[1] ** 2).sum()

    for gradient in jax.grad(far, (0, 1))(a, 1.5):
        assert np.isfinite(gradient).all()
