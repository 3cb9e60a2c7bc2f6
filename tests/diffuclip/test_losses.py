"""Laws of the denoiser's losses (Eq. 14-16), of the short denoising behind them, and of the levels it is trained at."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import diffusion, losses
from zeggs_jax.diffuclip.config import SMALL, DiffuclipConfig
from zeggs_jax.diffuclip.stages.denoiser import levels

L, C = 12, 5
CLEAN, DRAWN, OTHER = jnp.asarray(np.random.default_rng(3).normal(size=(3, L, C)), jnp.float32)


def with_short(steps):
    return replace(SMALL, diffusion=replace(SMALL.diffusion, short_steps=steps))


def test_the_noise_loss_is_the_mean_over_what_is_counted():
    counted = jnp.arange(L) >= 4
    found = losses.noise(OTHER, DRAWN, counted)
    np.testing.assert_allclose(found, np.mean((np.asarray(OTHER) - np.asarray(DRAWN))[4:] ** 2), rtol=1e-6)
    changed = OTHER.at[2].set(100.0)
    assert losses.noise(changed, DRAWN, counted) == found
    assert losses.noise(OTHER, DRAWN, jnp.zeros(L, bool)) == 0.0


def test_of_a_velocity_the_weighted_error_is_the_velocitys_own():
    schedule = diffusion.schedule(SMALL.diffusion)
    level = jnp.linspace(1.0, SMALL.diffusion.steps, L)
    z = diffusion.diffuse(schedule, CLEAN, DRAWN, level)
    alpha, sigma = (x[:, None] for x in diffusion.amounts(schedule, level))
    true, velocity = alpha * DRAWN - sigma * CLEAN, OTHER
    noise = diffusion.noise_of(schedule, z, velocity, level)
    weight = losses.noise_weight(SMALL, schedule, level)
    found = losses.noise(noise, DRAWN, jnp.ones(L, bool), weight)
    np.testing.assert_allclose(found, jnp.mean((velocity - true) ** 2), rtol=1e-3)
    assert (losses.noise_weight(DiffuclipConfig(), schedule, level) == 1.0).all()


def test_cosines_are_of_directions_and_finite_at_zero():
    a = DRAWN[0]
    np.testing.assert_allclose(losses.cosine(a, 3.0 * a), 1.0, rtol=1e-5)
    np.testing.assert_allclose(losses.cosine(a, -a), -1.0, rtol=1e-5)
    assert np.isfinite(jax.grad(losses.cosine)(jnp.zeros(C), a)).all()


def test_the_short_denoising_with_a_perfect_network_gives_the_latents_back_and_leaves_the_context():
    config, noisy = with_short(3), jnp.arange(L) >= 5
    schedule = diffusion.schedule(config.diffusion)

    def perfect(z, level):
        alpha, sigma = (x[:, None] for x in diffusion.amounts(schedule, level))
        return (z - alpha * CLEAN) / jnp.maximum(sigma, 1e-3)

    made = losses.short_denoising(config, schedule, perfect, CLEAN, DRAWN, noisy)
    np.testing.assert_allclose(made, CLEAN, atol=1e-3)
    assert (made[:5] == CLEAN[:5]).all()
    idle = losses.short_denoising(config, schedule, lambda z, level: jnp.zeros_like(z), CLEAN, DRAWN, noisy)
    assert float(jnp.abs(idle[5:] - CLEAN[5:]).max()) > 0.1


def test_the_gradient_of_the_short_denoising_reaches_the_network():
    config, noisy = with_short(2), jnp.ones(L, bool)
    schedule = diffusion.schedule(config.diffusion)

    def far(gain):
        made = losses.short_denoising(config, schedule, lambda z, level: gain * z, CLEAN, DRAWN, noisy)
        return jnp.sum(made**2)

    slope, step = jax.grad(far)(0.3), 1e-3
    np.testing.assert_allclose(slope, (far(0.3 + step) - far(0.3 - step)) / (2 * step), rtol=2e-2)


@pytest.mark.parametrize("seed", range(4))
def test_levels_are_zero_on_a_clean_prefix_and_positive_behind_it(seed):
    level, noisy = levels(jax.random.key(seed), SMALL, 48)
    level, noisy = np.asarray(level), np.asarray(noisy)
    assert ((level > 0) == noisy).all()
    assert noisy[-1]
    assert (np.diff(noisy.astype(int)) >= 0).all()
    assert level.max() <= SMALL.diffusion.steps


def test_levels_of_the_paper_are_one_for_the_window():
    config = replace(SMALL, diffusion=replace(SMALL.diffusion, per_token=False))
    level, noisy = levels(jax.random.key(0), config, 48)
    assert noisy.all()
    assert len(np.unique(level)) == 1


def test_shares_of_own_levels_and_lengths_of_context_are_as_configured():
    drawn, noisy = jax.vmap(lambda key: levels(key, SMALL, 48))(jax.random.split(jax.random.key(1), 400))
    starts = 48 - np.asarray(noisy).sum(axis=1)
    assert starts.min() == 0
    assert starts.max() == SMALL.diffusion.context
    several = [len(np.unique(row[start:])) > 1 for row, start in zip(np.asarray(drawn), starts, strict=True)]
    assert abs(np.mean(several) - SMALL.diffusion.independent) < 0.06
