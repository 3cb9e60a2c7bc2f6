"""The diffusion process: its schedules' laws, every solver against a target in closed form, guidance's identities."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import diffusion
from zeggs_jax.diffuclip.config import DiffusionConfig
from zeggs_jax.diffuclip.sampling import Settings, denoise

COSINE, LINEAR = DiffusionConfig(), DiffusionConfig(schedule="linear")
SCHEDULE = diffusion.schedule(COSINE)
MEAN, SPREAD = 0.7, 0.4  # of the target


def pair(rows=6, channels=3):
    keys = jax.random.split(jax.random.key(0))
    return tuple(jax.random.normal(key, (rows, channels)) for key in keys)


def gaussian(z, level):
    """The noise that is expected in z when the clean latents are N(MEAN, SPREAD^2): known in closed form."""
    alpha, sigma = (jnp.broadcast_to(x[..., None], z.shape) for x in diffusion.amounts(SCHEDULE, level))
    return sigma * (z - alpha * MEAN) / (alpha**2 * SPREAD**2 + sigma**2)


@pytest.mark.parametrize("config", [COSINE, LINEAR, DiffusionConfig(steps=50), DiffusionConfig(50, "linear")])
def test_the_signal_falls_from_one_to_almost_nothing(config):
    kept = np.asarray(diffusion.schedule(config).alpha_bar, np.float64)
    assert len(kept) == config.steps + 1
    assert kept[0] == 1.0
    assert (np.diff(kept) < 0).all()
    assert 0 < kept[-1] < 1e-3


def test_schedules_are_the_published_ones():
    kept = np.asarray(diffusion.schedule(LINEAR).alpha_bar)
    np.testing.assert_allclose(kept[1], 1 - 1e-4, rtol=1e-6)
    np.testing.assert_allclose(kept[1000] / kept[999], 1 - 0.02, rtol=1e-4)
    n = np.arange(1001) / 1000
    cosine = np.cos((n + 0.008) / 1.008 * np.pi / 2) ** 2
    np.testing.assert_allclose(SCHEDULE.alpha_bar, cosine / cosine[0], atol=5e-5)


def test_estimate_undoes_diffuse_at_a_level_for_each_latent():
    clean, noise = pair()
    level = jnp.array([0.0, 1.0, 250.5, 500.0, 800.0, 990.0])
    diffuse = jax.jit(diffusion.diffuse)
    z = diffuse(SCHEDULE, clean, noise, level)
    np.testing.assert_array_equal(z[0], clean[0])
    np.testing.assert_allclose(diffusion.estimate(SCHEDULE, z, noise, level), clean, atol=2e-4)
    for row in range(6):
        np.testing.assert_array_equal(z[row], diffuse(SCHEDULE, clean, noise, level[row])[row])


def test_the_velocity_tells_noise_and_clean_latents():
    clean, noise = pair()
    level = jnp.array([0.0, 1.0, 250.5, 500.0, 999.0, 1000.0])
    alpha, sigma = (jnp.broadcast_to(x[:, None], clean.shape) for x in diffusion.amounts(SCHEDULE, level))
    z, velocity = alpha * clean + sigma * noise, alpha * noise - sigma * clean
    np.testing.assert_allclose(diffusion.noise_of(SCHEDULE, z, velocity, level), noise, atol=1e-5)
    np.testing.assert_allclose(alpha * z - sigma * velocity, clean, atol=1e-5)


def test_levels_go_down_to_zero():
    np.testing.assert_array_equal(diffusion.levels(COSINE, 4), [1000, 750, 500, 250, 0])
    assert (np.diff(diffusion.levels(COSINE, 1000)) == -1).all()
    for steps in (0, 1001):
        with pytest.raises(ValueError, match=f"{steps} denoising steps"):
            diffusion.levels(COSINE, steps)


def test_ddpm_is_ddim_with_all_its_noise():
    z, noise = pair()
    drawn = jax.random.normal(jax.random.key(2), z.shape)
    for here, there in ((1000.0, 999.0), (600.0, 400.0), (50.0, 49.0), (30.0, 0.0)):
        ddpm = diffusion.ddpm_step(SCHEDULE, z, noise, here, there, drawn)
        ddim = diffusion.ddim_step(SCHEDULE, z, noise, here, there, 1.0, drawn)
        np.testing.assert_allclose(ddpm, ddim, atol=2e-3 if here == 1000 else 2e-5)


def test_ddim_draws_nothing_and_follows_the_true_noise_back():
    clean, noise = pair()
    z = diffusion.diffuse(SCHEDULE, clean, noise, 700.0)
    back = diffusion.ddim_step(SCHEDULE, z, noise, 700.0, 200.0)
    np.testing.assert_allclose(back, diffusion.diffuse(SCHEDULE, clean, noise, 200.0), atol=1e-5)


@pytest.mark.parametrize("solver", ["ddim", "ddpm", "dpm"])
def test_clean_latents_stay_clean(solver):
    """Level 0 in a window with others: unchanged and finite, also in the gradient."""
    z, noise = pair()
    level = jnp.array([0.0, 0.0, 0.0, 500.0, 500.0, 500.0])
    there = jnp.where(level > 0, 250.0, 0.0)

    def step(z):
        if solver == "ddim":
            return diffusion.ddim_step(SCHEDULE, z, noise, level, there)
        if solver == "ddpm":
            return diffusion.ddpm_step(SCHEDULE, z, noise, level, there, noise)
        return diffusion.dpm_step(SCHEDULE, z, noise, level, there, diffusion.Before(z, level))[0]

    stepped = step(z)
    np.testing.assert_array_equal(stepped[:3], z[:3])
    assert np.abs(stepped[3:] - z[3:]).min() > 0
    assert np.isfinite(jax.grad(lambda z: step(z).sum())(z)).all()


@pytest.mark.parametrize(
    ("solver", "steps", "near"),
    [("ddim", 1000, 0.01), ("ddim", 50, 0.05), ("dpm", 20, 0.05), ("dpm", 200, 0.01), ("ddpm", 1000, 0.03)],
)
def test_every_solver_recovers_a_gaussian(solver, steps, near):
    noise = jax.random.normal(jax.random.key(3), (20_000, 1))
    made = denoise(gaussian, COSINE, Settings(solver, steps), noise, jax.random.key(4))
    assert abs(float(made.mean()) - MEAN) < near
    assert abs(float(made.std()) - SPREAD) < near


def exact(noise):
    """Where the way without noise ends: quantiles are kept."""
    return MEAN + SPREAD * (noise - np.sqrt(float(SCHEDULE.alpha_bar[-1])) * MEAN) / np.sqrt(
        float(SCHEDULE.alpha_bar[-1]) * SPREAD**2 + 1.0 - float(SCHEDULE.alpha_bar[-1])
    )


def test_the_faster_solver_is_faster():
    noise = jnp.linspace(-2, 2, 9)[:, None]

    def error(solver, steps):
        made = denoise(gaussian, COSINE, Settings(solver, steps), noise, jax.random.key(0))
        return float(np.abs(made - exact(noise)).max())

    coarse, fine, fast = error("ddim", 20), error("ddim", 40), error("dpm", 20)
    assert 1.5 < coarse / fine < 2.5  # of first order
    assert fast < fine / 2
    assert error("dpm", 80) < fast / 4  # of second order


def test_guidance_runs_through_both_predictions():
    told, untold = pair()
    np.testing.assert_array_equal(diffusion.guide(told, untold, 1.0), told)
    np.testing.assert_array_equal(diffusion.guide(told, untold, 0.0), untold)
    np.testing.assert_allclose(diffusion.guide(told, untold, 3.0) - told, 2 * (told - untold), atol=1e-5)
