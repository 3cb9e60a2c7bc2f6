"""The diffusion process (Sec. 6.1, 6.2): schedules, DDPM, DDIM and DPM-Solver++ steps, guidance (Eq. 17); no network.

Level n runs from 0, clean, to N, noise. A level is one number for all latents or one for each of them, so that clean
latents of the past and noisy ones lie in one window. Latents have unit variance.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Float32

from .config import DiffusionConfig

COSINE_OFFSET = 0.008  # of Nichol and Dhariwal 2021, Eq. 17
LAST = 4e-5  # share of the signal's variance left at level N; the linear schedule ends there too
LINEAR = (1e-4, 0.02)  # first and last beta of Ho et al. 2020, for 1000 levels
TINY = 1e-6

Latents = Float[Array, "L C"]
Level = Float[ArrayLike, "*L"]  # of all latents or of each


class Schedule(NamedTuple):
    """How much is left of the signal at each level."""

    alpha_bar: Float32[Array, " N1"]  # share of the variance that is signal at levels 0..N; 1 at level 0, falling


class Before(NamedTuple):
    """What DPM-Solver++ keeps of the step before; at the first step `level` is the one it starts from."""

    clean: Latents  # its estimate
    level: Level


def schedule(config: DiffusionConfig) -> Schedule:
    """The schedule that the config names, with `steps` levels above 0 (gap 9).

    The cosine one is mixed with LAST, so that z_0 can be told from the noise at every level.
    """
    steps = config.steps
    if config.schedule == "linear":
        first, last = (beta * 1000.0 / steps for beta in LINEAR)
        betas = np.minimum(np.linspace(first, last, steps), 0.999)
        return Schedule(jnp.asarray(np.concatenate([[1.0], np.cumprod(1.0 - betas)]), jnp.float32))
    part = (np.arange(steps + 1) / steps + COSINE_OFFSET) / (1.0 + COSINE_OFFSET)
    left = np.cos(part * math.pi / 2.0) ** 2
    left = (left - left[-1]) / (left[0] - left[-1])
    return Schedule(jnp.asarray(LAST + (1.0 - LAST) * left, jnp.float32))


def levels(config: DiffusionConfig, steps: int) -> Float32[np.ndarray, " steps1"]:
    """Levels N to 0 that a solver visits in so many steps, whole numbers evenly apart.

    Raises:
        ValueError: no step, or more steps than levels.
    """
    if not 1 <= steps <= config.steps:
        raise ValueError(f"{steps} denoising steps were asked for; expected 1 to {config.steps}, the model's levels.")
    return np.round(np.linspace(config.steps, 0, steps + 1)).astype(np.float32)


def amounts(schedule: Schedule, level: Level) -> tuple[Float[Array, "*L"], Float[Array, "*L"]]:
    """(alpha, sigma), what signal and noise are multiplied with at a level; linear in variance between whole levels."""
    table, level = schedule.alpha_bar, jnp.asarray(level, jnp.float32)
    below = jnp.clip(jnp.floor(level), 0, len(table) - 2).astype(jnp.int32)
    part = level - below
    kept = (1.0 - part) * table[below] + part * table[below + 1]
    return jnp.sqrt(kept), jnp.sqrt(jnp.maximum(1.0 - kept, 0.0))


def diffuse(schedule: Schedule, clean: Latents, noise: Latents, level: Level) -> Latents:
    """z_n = alpha z_0 + sigma noise."""
    alpha, sigma = _columns(schedule, level, clean)
    return alpha * clean + sigma * noise


def estimate(schedule: Schedule, z: Latents, noise: Latents, level: Level) -> Latents:
    """The z_0 that z_n and its noise make: Tweedie's formula when the noise is the mean of all that are possible."""
    alpha, sigma = _columns(schedule, level, z)
    return (z - sigma * noise) / alpha


def noise_of(schedule: Schedule, z: Latents, velocity: Latents, level: Level) -> Latents:
    """The noise of z_n from its velocity v = alpha noise - sigma z_0 (Salimans and Ho 2022).

    A network whose output is v gives z_0 = alpha z_n - sigma v, which is well conditioned where alpha is nearly 0.
    """
    alpha, sigma = _columns(schedule, level, z)
    return sigma * z + alpha * velocity


def ddpm_step(schedule: Schedule, z: Latents, noise: Latents, here: Level, there: Level, drawn: Latents) -> Latents:
    """One ancestral step to a lower level (Ho et al. 2020, Eq. 6-7), with fresh noise `drawn`."""
    (alpha, sigma), (alpha_to, sigma_to) = _columns(schedule, here, z), _columns(schedule, there, z)
    kept = alpha / alpha_to
    beta, variance = 1.0 - kept**2, jnp.maximum(sigma**2, TINY**2)
    mean = (alpha_to * beta * estimate(schedule, z, noise, here) + kept * sigma_to**2 * z) / variance
    return jnp.where(sigma > 0.0, mean + jnp.sqrt(jnp.maximum(beta, 0.0) * sigma_to**2 / variance) * drawn, z)


def ddim_step(
    schedule: Schedule,
    z: Latents,
    noise: Latents,
    here: Level,
    there: Level,
    eta: float | int = 0.0,
    drawn: Latents | None = None,
) -> Latents:
    """One step to a lower level (Song et al. 2021, Eq. 12); eta 0 draws nothing, eta 1 is the ancestral step."""
    alpha, sigma = _columns(schedule, here, z)
    alpha_to, sigma_to = _columns(schedule, there, z)
    clean = estimate(schedule, z, noise, here)
    if not eta or drawn is None:
        return alpha_to * clean + sigma_to * noise
    fresh = eta * sigma_to / jnp.maximum(sigma, TINY) * jnp.sqrt(jnp.maximum(1.0 - (alpha / alpha_to) ** 2, 0.0))
    fresh = jnp.minimum(fresh, sigma_to)
    return alpha_to * clean + jnp.sqrt(jnp.maximum(sigma_to**2 - fresh**2, 0.0)) * noise + fresh * drawn


def dpm_step(
    schedule: Schedule, z: Latents, noise: Latents, here: Level, there: Level, before: Before
) -> tuple[Latents, Before]:
    """One step of DPM-Solver++(2M) (Lu et al. 2022, Algorithm 2), and what the next one needs.

    Of second order by the estimate of the step before; the first and the last step, to level 0, are of first order.
    """
    (alpha, sigma), (alpha_to, sigma_to) = _columns(schedule, here, z), _columns(schedule, there, z)
    alpha_from, sigma_from = _columns(schedule, before.level, z)
    clean = estimate(schedule, z, noise, here)
    now, last = _log_snr(alpha, sigma), _log_snr(alpha_from, sigma_from)
    usable = (now - last > TINY) & (sigma_to > TINY)
    ahead = (_log_snr(alpha_to, sigma_to) - now) / jnp.where(usable, now - last, 1.0) / 2.0
    towards = clean + jnp.where(usable, ahead, 0.0) * (clean - before.clean)
    ratio = sigma_to / jnp.maximum(sigma, TINY)
    stepped = ratio * z + (alpha_to - alpha * ratio) * towards
    return jnp.where(sigma > 0.0, stepped, z), Before(clean, here)


def guide(conditional: Latents, unconditional: Latents, scale: Float[ArrayLike, ""]) -> Latents:
    """Classifier-free guidance (Eq. 17): s E(P) + (1 - s) E(no prompt)."""
    scale = jnp.asarray(scale)
    return scale * conditional + (1.0 - scale) * unconditional


def _columns(schedule: Schedule, level: Level, z: Latents) -> tuple[Array, Array]:
    """(alpha, sigma) as columns that multiply latents."""
    return tuple(jnp.broadcast_to(x[..., None], z.shape) for x in amounts(schedule, level))  # type: ignore[return-value]


def _log_snr(alpha: Array, sigma: Array) -> Array:
    return jnp.log(alpha) - jnp.log(jnp.maximum(sigma, TINY))
