"""How one noise is made of several prompts: guidance (Eq. 17), parts of the body (Eq. 19), behind a clean context."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from . import body_parts, denoiser, diffusion, sampling
from .config import DiffuclipConfig
from .denoiser import Conditions, Memory
from .sampling import Settings


class Wish(NamedTuple):
    """What the prompts ask of a chunk: one for the whole body, or one for each part."""

    styles: Float[Array, "O P"]  # prompts
    scales: Float[Array, " O"]  # how far each is followed: s of Eq. 17; 0 is no prompt, 1 is plain
    masks: Bool[Array, "O C"]  # the channels that each prompt is for; every channel has one


def whole(style: Float[ArrayLike, " P"], scale: float | int, config: DiffuclipConfig) -> Wish:
    """One prompt for the whole body."""
    every = jnp.ones((1, config.latent_size), bool)
    return Wish(jnp.asarray(style)[None], jnp.full(1, float(scale)), every)


@partial(jax.jit, static_argnames=("config", "settings", "seam"))
def extend(
    params: Any,
    config: DiffuclipConfig,
    settings: Settings,
    seam: float,
    context: Float[Array, "P C"],
    count: ArrayLike,
    noise: Float[Array, "K C"],
    told: tuple[Conditions, Wish],
    key: Array,
) -> Float[Array, "K C"]:
    """A chunk of latents behind the first `count` of `context`, as `sampling.rollout` asks for.

    Of the denoiser's `params`. The window's conditions hold the audio of context, chunk and `ahead` latents more; their
    own style is not read. `seam` is w_body of Eq. 19: 0 leaves out its gradient, and half of the time.
    """
    conditions, wish = told
    of_context, of_steps = jax.random.split(key)
    level = jnp.float32(settings.context_level)
    drawn = jax.random.normal(of_context, context.shape)
    schedule = diffusion.schedule(config.diffusion)
    seen = context if settings.context_level == 0.0 else diffusion.diffuse(schedule, context, drawn, level)
    branches = _branches(conditions, wish)
    remember = partial(denoiser.remember, params, config, seen, level, seen=jnp.arange(len(context)) < count)
    memory = jax.vmap(remember, in_axes=(BRANCHES,))(branches)
    heard = jax.lax.dynamic_slice_in_dim(conditions.rhythm, count, len(noise) + config.denoiser.ahead)
    branches = branches._replace(rhythm=heard)

    def one(z: Array, level: Array, branch: Conditions, memory: Memory) -> Array:
        return denoiser.apply_after(params, config, z, level, branch, count, memory)

    def noises(z: Float[Array, "K C"], level: Float[Array, " K"]) -> Float[Array, "O K C"]:
        found = jax.vmap(one, in_axes=(None, None, BRANCHES, 0))(z, level, branches, memory)
        return jax.vmap(diffusion.guide, in_axes=(0, None, 0))(found[:-1], found[-1], wish.scales)

    def evaluate(z: Float[Array, "K C"], level: Float[Array, " K"]) -> Float[Array, "K C"]:
        return body_parts.predict(partial(noises, level=level), z, wish.masks, seam)

    return sampling.denoise(evaluate, config.diffusion, settings, noise, of_steps)


BRANCHES = Conditions(None, None, None, None, None, 0, 0)  # type: ignore[arg-type]  # prompts differ, the rest does not


def _branches(conditions: Conditions, wish: Wish) -> Conditions:
    """Each prompt and no prompt, side by side."""
    styles = jnp.concatenate([wish.styles, jnp.zeros_like(wish.styles[:1])])
    return conditions._replace(style=styles, prompted=jnp.arange(len(styles)) < len(wish.styles))
