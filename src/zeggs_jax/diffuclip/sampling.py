"""From noise to latents (Sec. 6.1): all of a window at once, or chunk after chunk behind clean ones (Eq. 9).

No network inside: `evaluate` finds the noise in latents at given levels, `extend` makes a chunk. The fixed sizes of a
chunk and its context let one compiled function make motion of any length, in constant memory.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Float32, Int

from . import diffusion
from .config import DiffusionConfig
from .diffusion import Before, Schedule

Solver = Literal["dpm", "ddim", "ddpm"]
Latents = Float[Array, "L C"]
Evaluate = Callable[[Latents, Float[Array, " L"]], Latents]
"""(noisy latents, level of each) -> their noise."""
Extend = Callable[[Float32[np.ndarray, "P C"], int, Float32[np.ndarray, "K C"], Any, Array], Float[Array, "K C"]]
"""(context, how many of its latents are there, noise of a chunk, conditions of the window, key) -> the chunk."""


@dataclass(frozen=True)
class Settings:
    """How latents are sampled. The paper: solver ddpm, 1000 steps, chunk 1."""

    solver: Solver = "dpm"  # DPM-Solver++(2M), DDIM, or the ancestral steps of DDPM
    steps: int = 20
    eta: float = 0.0  # of DDIM: 1 draws as much noise as DDPM
    chunk: int = 8  # latents made at once
    context: int = 40  # most clean latents that are seen before them
    context_level: float = 0.0  # a little noise on the context keeps errors from growing; 0 is none

    def __post_init__(self) -> None:
        if self.solver not in ("dpm", "ddim", "ddpm"):
            raise ValueError(f"solver is '{self.solver}'; expected dpm, ddim or ddpm.")
        if self.chunk < 1 or self.context < 0 or self.steps < 1:
            raise ValueError(
                f"chunks of {self.chunk} latents behind {self.context} in {self.steps} steps were asked for; expected "
                "at least 1 latent, 0 before it and 1 step."
            )
        if not 0.0 <= self.eta <= 1.0:
            raise ValueError(f"eta is {self.eta:g}; expected 0, nothing drawn, to 1, as much as DDPM draws.")


def denoise(
    evaluate: Evaluate,
    config: DiffusionConfig,
    settings: Settings,
    noise: Float[Array, "L C"],
    key: Array,
    prefix: Float[ArrayLike, "P C"] | None = None,
) -> Float[Array, "L C"]:
    """Latents from `noise`, behind a clean `prefix` if there is one; `evaluate` sees both, and the prefix stays.

    Raises:
        ValueError: more steps than the model has levels.
    """
    schedule, grid = diffusion.schedule(config), jnp.asarray(diffusion.levels(config, settings.steps))
    known = jnp.zeros((0, noise.shape[1])) if prefix is None else jnp.asarray(prefix)

    def step(state: tuple[Latents, Before], given: tuple[Array, Array, Array]) -> tuple[tuple[Latents, Before], None]:
        (z, before), (here, there, drawn) = state, given
        level = jnp.concatenate([jnp.zeros(len(known)), jnp.full(len(noise), here)])
        found = evaluate(jnp.concatenate([known, z]), level)[len(known) :]
        return _step(settings, schedule, z, found, here, there, before, drawn), None

    keys = jax.random.split(key, settings.steps)
    start = (noise, Before(jnp.zeros_like(noise), grid[0]))
    (made, _), _ = jax.lax.scan(step, start, (grid[:-1], grid[1:], keys))
    return made


def _step(
    settings: Settings,
    schedule: Schedule,
    z: Latents,
    found: Latents,
    here: Array,
    there: Array,
    before: Before,
    key: Array,
) -> tuple[Latents, Before]:
    """A step of the solver that the settings name; `before` changes for the one that looks back."""
    if settings.solver == "dpm":
        return diffusion.dpm_step(schedule, z, found, here, there, before)
    if settings.solver == "ddim" and not settings.eta:
        return diffusion.ddim_step(schedule, z, found, here, there), before
    drawn = jax.random.normal(key, z.shape)
    if settings.solver == "ddim":
        return diffusion.ddim_step(schedule, z, found, here, there, settings.eta, drawn), before
    return diffusion.ddpm_step(schedule, z, found, here, there, drawn), before


def rollout(
    extend: Extend,
    settings: Settings,
    conditions_at: Callable[[int, int], Any],
    latents: int,
    channels: int,
    key: Array,
    prefix: Float[np.ndarray, "P C"] | None = None,
) -> Iterator[Float32[np.ndarray, "k C"]]:
    """Chunks of latents, one behind the other, `latents` in all, after a clean `prefix` that is not among them.

    `conditions_at(first, length)` tells of the window that begins at latent `first` of the whole, prefix included; its
    length is always context + chunk. The noise of a latent follows from the key and its place alone, so that the same
    key gives the same beginning whatever the length, and chunks of another size begin from the same noise.
    """
    size, chunk = settings.context, settings.chunk
    context, done = np.zeros((size, channels), np.float32), 0
    if prefix is not None:
        done, kept = len(prefix), np.asarray(prefix, np.float32)[max(len(prefix) - size, 0) :]
        context[: len(kept)] = kept
    end, of_noise, of_steps = done + latents, *jax.random.split(key)
    while done < end:
        count = min(done, size)
        told = conditions_at(done - count, size + chunk)
        made = np.asarray(
            extend(context, count, noise_of(of_noise, done, chunk, channels), told, jax.random.fold_in(of_steps, done))
        )[: end - done]
        yield made
        done += len(made)
        context = _behind(context, count, made)


def noise_of(key: Array, first: int, latents: int, channels: int) -> Float32[np.ndarray, "L C"]:
    """The noise that latents `first`.. begin from."""
    return np.asarray(_drawn(key, np.arange(first, first + latents), channels))


def _draw(key: Array, places: Int[Array, " L"], channels: int) -> Float[Array, "L C"]:
    return jax.vmap(lambda place: jax.random.normal(jax.random.fold_in(key, place), (channels,)))(places)


_drawn = jax.jit(_draw, static_argnames="channels")


def _behind(
    context: Float32[np.ndarray, "P C"], count: int, made: Float32[np.ndarray, "k C"]
) -> Float32[np.ndarray, "P C"]:
    """The context after a chunk: as much of the past as fits, from the front."""
    kept = np.concatenate([context[:count], made])[-len(context) :] if len(context) else context
    following = np.zeros_like(context)
    following[: len(kept)] = kept
    return following
