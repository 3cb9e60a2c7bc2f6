"""Stage 5, video prompts (Sec. 6.2.1): rendered motions come to lie where the motion encoder puts them (Eq. 18)."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Float32

from ...data import scale
from ...data.scale import Scale
from ...motion import kinematics
from ...motion.skeleton import Skeleton
from ...training.step import TrainState, begin, make_step, trained
from .. import clip, prompts, rendering, representation, video_encoder
from ..config import DiffuclipConfig
from .prompts import SHORTEST_S
from .stage import Material, Params, Stage, optimiser, window

NOISE = 0.02  # of the pictures that are learnt from


class Batch(NamedTuple):
    """Windows of motion."""

    motion: Float[ArrayLike, "B N D"]  # not scaled
    mask: Bool[ArrayLike, "B N"]


class Frozen(NamedTuple):
    """What is not trained."""

    prompts: Params
    tower: Params  # CLIP's for images, or None
    motion_scale: Scale


def stage(config: DiffuclipConfig, material: Material, params: dict[str, Params]) -> Stage:
    """The stage; its model is that of the stage before with a leaf "video" more."""
    settings, steps = config.learn_video, optimiser(config.learn_video)
    tower, vector = None, 0
    if config.prompts.image == "clip":
        loaded = clip.load(clip.folder_of(config.prompts), "image")
        tower, vector = loaded.params, loaded.sizes.projection
    frozen = Frozen(params["prompts"], tower, material.motion_scale)
    loss = partial(loss_fn, config, material.skeleton)
    judge = jax.jit(lambda params, held, frozen: loss(params, held, _keys(0, len(held.mask)), None, frozen)[0])
    held = _batch(config, material, 0, "valid")

    def validate(state: TrainState) -> dict[str, float]:
        return {"loss": float(judge(trained(state), held, frozen))}

    return Stage(
        begin=lambda key: begin(video_encoder.init(key, config, vector), steps, settings.ema is not None),
        step=make_step(loss, steps, config.seed, ema=settings.ema, frozen=frozen),
        batch=lambda k: _batch(config, material, k, "train"),
        finish=lambda state: {**params["prompts"], "video": trained(state)},
        validate=validate if any(take.split == "valid" for take in material.takes) else None,
    )


def loss_fn(
    config: DiffuclipConfig,
    skeleton: Skeleton,
    params: Params,
    batch: Batch,
    keys: Array,
    step: Array | None,
    frozen: Frozen,
) -> tuple[Array, dict[str, Array]]:
    """Eq. 18: 1 - cosine of the motion's prompt and its video's. Without a `step` nothing is dropped."""

    def one(motion: Array, mask: Array, key: Array) -> Array:
        place, grain, drop = jax.random.split(key, 3)
        aim = prompts.encode_motion(frozen.prompts, config, scale.apply(frozen.motion_scale, motion), mask)
        images = film(config, skeleton, motion, mask, place)
        images = images + NOISE * jax.random.normal(grain, images.shape)
        seen = prompts.see(config, images, frozen.tower)
        made = video_encoder.encode(params, config, seen, None if step is None else drop)
        return 1.0 - jnp.sum(jax.lax.stop_gradient(aim) * made)

    apart = jnp.mean(jax.vmap(one)(jnp.asarray(batch.motion), jnp.asarray(batch.mask), keys))
    return apart, {"apart": apart}


def film(
    config: DiffuclipConfig,
    skeleton: Skeleton,
    motion: Float[ArrayLike, "N D"],
    mask: Bool[ArrayLike, " N"],
    key: Array | None = None,
) -> Float[Array, "V H W 3"]:
    """A motion (not scaled) as a video, its pictures evenly spread over it; by a random camera, or from the front."""
    motion, mask = jnp.asarray(motion), jnp.asarray(mask)
    axes = motion[:, representation.ROOT :].reshape(len(motion), -1, 2, 3)
    place = representation.ground(motion[:, : representation.ROOT], axes)
    chosen = jnp.round(jnp.linspace(0.0, jnp.maximum(mask.sum() - 1, 0), config.prompts.video_frames)).astype(jnp.int32)
    offsets = np.asarray(skeleton.offsets, np.float32)
    points = kinematics.axes_positions(place[chosen], axes[chosen], offsets, skeleton.parents)
    middle = jnp.mean(place[chosen], axis=0)
    view = rendering.front(middle) if key is None else rendering.camera(key, middle)
    shape = rendering.figure(skeleton)
    return jax.lax.map(lambda joints: rendering.render(joints, shape, view, config.prompts.pixels), points)


def _batch(config: DiffuclipConfig, material: Material, k: int, split: str) -> Batch:
    """Batch k: windows of random length at random places of random takes."""
    settings, draw = config.learn_video, np.random.default_rng([config.seed, 7, k])
    takes = [take for take in material.takes if take.split == split] or list(material.takes)
    longest = min(config.prompts.frames, round(settings.seconds / config.frame_time))
    shortest = min(longest, round(SHORTEST_S / config.frame_time))
    rows: list[Any] = []
    for i in draw.integers(len(takes), size=settings.batch).tolist():
        motion: Float32[np.ndarray, "T D"] = takes[i].motion
        frames = int(draw.integers(shortest, longest + 1))
        start = int(draw.integers(0, max(len(motion) - frames, 0) + 1))
        rows.append(window(motion[: start + frames], start, longest))
    motions, masks = (np.stack(column) for column in zip(*rows, strict=True))
    return Batch(np.asarray(motions, np.float32), masks)


def _keys(seed: int, count: int) -> Array:
    return jax.random.split(jax.random.key(seed), count)
