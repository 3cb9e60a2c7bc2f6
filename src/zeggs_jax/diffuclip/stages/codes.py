"""Stage 1, the codes (Sec. 4): encoder and decoder by gradient descent, codebooks by moving averages, part by part."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from ...data import scale
from ...training.step import Metrics, TrainState
from .. import body_parts, quantiser, representation, vqvae
from ..config import DiffuclipConfig
from ..quantiser import Book
from .stage import Material, Params, Stage, optimiser

NETWORKS = ("encoder", "decoder")  # what is learnt by gradients
JUDGED = 64  # windows of the split valid that are judged
Nets = Params  # encoder and decoder of every part


class Windows(NamedTuple):
    """Where the windows of a split can begin: a take is chosen by its length."""

    motions: list[np.ndarray]  # scaled, at least one window long
    chance: np.ndarray  # of each take

    def draw(self, rng: np.random.Generator, count: int, frames: int) -> Float[np.ndarray, "B T D"]:
        """`count` windows."""
        chosen = [self.motions[k] for k in rng.choice(len(self.motions), count, p=self.chance)]
        starts = [rng.integers(len(motion) - frames + 1) for motion in chosen]
        return np.stack([motion[start : start + frames] for motion, start in zip(chosen, starts, strict=True)])


def stage(config: DiffuclipConfig, material: Material, params: dict[str, Params]) -> Stage:
    """The VQ-VAE on random windows of the takes; nothing is needed of `params`."""
    del params
    settings, rate = config.learn_codes, config.codes.rate
    frames = max(1, round(settings.seconds / config.frame_time / rate)) * rate
    train = _windows(material, "train", frames)
    descent = optimiser(settings)

    def begin(key: Array) -> TrainState:
        made = vqvae.init(key, config, material.skeleton)
        nets = _nets(made)
        average = None if settings.ema is None else jax.tree.map(jnp.array, nets)
        return TrainState(jnp.zeros((), jnp.int32), made, descent.init(nets), average)

    def batch(k: int) -> Float[np.ndarray, "B T D"]:
        return train.draw(np.random.default_rng((config.seed, k)), settings.batch, frames)

    judged = _judged(material, frames)
    offsets, parents = np.asarray(material.skeleton.offsets, np.float32), material.skeleton.parents

    def validate(state: TrainState) -> dict[str, float]:
        return _judge(finish(state), config, material, judged, offsets, parents)

    return Stage(begin, jax.jit(partial(_step, config=config, descent=descent)), batch, finish, validate)


def finish(state: TrainState) -> Params:
    """The parameters to use: networks by their average where one is kept, codebooks as they are."""
    return state.params if state.average is None else _with_nets(state.params, state.average)


def loss(
    nets: Nets, params: Params, config: DiffuclipConfig, motion: Float[Array, "B T D"]
) -> tuple[Float[Array, ""], tuple[Metrics, dict[str, Array]]]:
    """Mean over the windows of reconstruction, velocity, acceleration and commitment; terms; Z [B, L, C] by part."""
    params = _with_nets(params, nets)
    made, latents, commit = [], {}, jnp.zeros(())
    for name in body_parts.names(config):
        part = params[name]
        z = jax.vmap(lambda x, part=part: vqvae.encode_part(part, config, x))(motion)
        coded = jax.vmap(partial(quantiser.quantise, vqvae.book(part)))(z)
        made.append(jax.vmap(lambda q, part=part: vqvae.decode_part(part, config, q))(coded.vectors))
        latents[name], commit = z, commit + coded.commit.mean() / len(params)
    columns = jnp.concatenate([params[name]["columns"] for name in body_parts.names(config)])
    error = jnp.concatenate(made, axis=-1) - motion[..., columns]
    terms = {"reconstruction": jnp.square(error).mean(), "commit": commit}
    terms["velocity"] = jnp.square(jnp.diff(error, axis=1)).mean()
    terms["acceleration"] = jnp.square(jnp.diff(error, n=2, axis=1)).mean()
    codes = config.codes
    total = terms["reconstruction"] + codes.commit * commit
    total = total + codes.velocity * terms["velocity"] + codes.acceleration * terms["acceleration"]
    return total, (terms, latents)


def _step(
    state: TrainState, batch: Float[Array, "B T D"], config: DiffuclipConfig, descent: optax.GradientTransformation
) -> tuple[TrainState, Metrics]:
    """One update of the networks, then of the codebooks."""
    settings, nets = config.learn_codes, _nets(state.params)
    (total, (terms, latents)), grads = jax.value_and_grad(loss, has_aux=True)(nets, state.params, config, batch)
    updates, opt_state = descent.update(grads, state.opt_state, nets)
    nets = optax.apply_updates(nets, updates)
    key = jax.random.fold_in(jax.random.key(config.seed), state.step)
    params = _with_nets(state.params, nets)
    for name, own in zip(latents, jax.random.split(key, len(latents)), strict=True):
        z = latents[name].reshape(-1, config.codes.latent)
        book = quantiser.update(Book(**params[name]["book"]), z, own, config.codes.decay, config.codes.revive)
        params[name] = params[name] | {"book": book._asdict()}
    average = state.average
    if settings.ema is not None:
        decay = jnp.minimum(settings.ema, (1.0 + state.step) / (10.0 + state.step))
        average = jax.tree.map(lambda a, p: a + (1.0 - decay) * (p - a), average, nets)
    metrics = {"loss": total, **terms, "gradient": optax.tree.norm(grads)}
    return TrainState(state.step + 1, params, opt_state, average), metrics


def _nets(params: Params) -> Nets:
    return {part: {name: own[name] for name in NETWORKS} for part, own in params.items()}


def _with_nets(params: Params, nets: Nets) -> Params:
    return {part: own | nets[part] for part, own in params.items()}


def _windows(material: Material, split: str, frames: int) -> Windows:
    """The takes of a split that hold a window, scaled; ValueError where none does."""
    found = [take for take in material.takes if take.split == split and len(take.motion) >= frames]
    if not found:
        raise ValueError(f"no clip of the split '{split}' is {frames} frames long; shorten learn_codes.seconds.")
    lengths = np.array([len(take.motion) - frames + 1 for take in found], float)
    scaled = [np.asarray(scale.apply(material.motion_scale, take.motion), np.float32) for take in found]
    return Windows(scaled, lengths / lengths.sum())


def _judged(material: Material, frames: int) -> Float[np.ndarray, "N T D"]:
    """Windows of the split valid, the same in every validation; of the split train where none is long enough."""
    splits = [take.split for take in material.takes if len(take.motion) >= frames]
    split = "valid" if "valid" in splits else "train"
    return _windows(material, split, frames).draw(np.random.default_rng(0), JUDGED, frames)


def _judge(
    params: Params,
    config: DiffuclipConfig,
    material: Material,
    motion: Float[np.ndarray, "N T D"],
    offsets: Float[np.ndarray, "J 3"],
    parents: tuple[int, ...],
) -> dict[str, float]:
    """What of the windows gets lost: cm by part of the body, drift of the root, and how the codes are used."""
    apart, drift, codes, total = _compare(params, config, material.motion_scale, motion, offsets, parents)
    told = {"loss": float(total), "error_cm": float(apart.mean()), "drift_cm": float(drift)}
    for part, joints in _shown(material, config).items():
        told[f"{part}_cm"] = float(apart[joints].mean())
    for k, name in enumerate(body_parts.names(config)):
        own = codes.reshape(-1, codes.shape[-1])[:, k * config.codes.quantisers : (k + 1) * config.codes.quantisers]
        spread, used = quantiser.perplexity(jnp.asarray(own), config.codes.codes)
        for q in range(config.codes.quantisers):
            told |= {f"{name}{q}_perplexity": float(spread[q]), f"{name}{q}_used": float(used[q])}
    return told


@partial(jax.jit, static_argnames=("config", "parents"))
def _compare(
    params: Params,
    config: DiffuclipConfig,
    motion_scale: scale.Scale,
    motion: Float[Array, "N T D"],
    offsets: Float[Array, "J 3"],
    parents: tuple[int, ...],
) -> tuple[Float[Array, " J"], Float[Array, ""], Array, Float[Array, ""]]:
    """Mean distance of every joint, both bodies above the same place; distance of the last places; codes; loss."""

    def one(x: Float[Array, "T D"]) -> tuple[Array, Array, Array]:
        z = vqvae.encode(params, config, x)
        quantised, codes = vqvae.quantise(params, config, z)
        pair = jnp.stack([x, vqvae.decode(params, config, quantised)])
        places = jax.vmap(lambda m: representation.positions(m, offsets, parents))(scale.invert(motion_scale, pair))
        path = places[:, :, :1] * jnp.array([1.0, 0.0, 1.0])[None, None, None]
        true, made = places - path
        return jnp.linalg.norm(true - made, axis=-1).mean(0), jnp.linalg.norm(path[0, -1] - path[1, -1]), codes

    apart, drift, codes = jax.lax.map(one, motion, batch_size=16)
    total, _ = loss(_nets(params), params, config, motion)
    return apart.mean(axis=0), drift.mean(), codes, total


def _shown(material: Material, config: DiffuclipConfig) -> dict[str, np.ndarray]:
    """Joints to tell the error of: each part's, and both hands and feet where the skeleton knows them."""
    body, roles = material.skeleton, vars(material.skeleton.roles)
    shown = {part: body_parts.joints(body, part) for part in body_parts.names(config)}
    for ends in ("hand", "foot"):
        names = [roles[f"{side}_{ends}"] for side in ("left", "right") if roles[f"{side}_{ends}"] is not None]
        if names:
            shown[ends] = np.array([body.index(name) for name in names])
    return shown
