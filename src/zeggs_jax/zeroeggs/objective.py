"""The objective of training (Sec. 3.5): one clip unrolled in closed loop, Eq. 2 over a batch, with its randomness.

Encoders and terms are written for one clip and batched, the decoder's loop for the batch. A clip's randomness comes
from its own key, so that a batch gives the same numbers at once, in parts and on several devices.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..data.augment import Mirror, augment
from ..data.scale import Scales
from ..data.windows import Batch, Located, Piece, Recorded, gather
from ..motion.pose import Pose, from_vector
from ..nn.compute import Compute, each
from ..training.step import LossFn, Metrics
from . import losses, unrolled
from .config import ZeroEggsConfig
from .decoder import Frame
from .losses import Terms
from .model import Params, StyleDistribution, encode_speech, encode_style, reparameterise
from .settings import TrainConfig


class Draws(NamedTuple):
    """The randomness in one clip's loss."""

    style: Float[Array, " Z"]  # normal draw of the reparameterisation
    speech_dropout: Array | None  # keys; None: no dropout
    style_dropout: Array | None


class Setting(NamedTuple):
    """What the loss needs besides parameters and data; fixed for a run."""

    config: TrainConfig
    scales: Scales
    parents: tuple[int, ...]
    mirror: Mirror | None = None  # of the corpus's body, where it has one


def draw(key: Array, config: ZeroEggsConfig) -> Draws:
    """The randomness of one clip."""
    noise, speech, style = jax.random.split(key, 3)
    return Draws(jax.random.normal(noise, (config.style_size,)), speech, style)


def no_draws(config: ZeroEggsConfig) -> Draws:
    """No randomness: the mean of the style, no dropout."""
    return Draws(jnp.zeros(config.style_size), None, None)


def unroll(params: Params, batch: Batch, draws: Draws, setting: Setting) -> tuple[Pose, StyleDistribution]:
    """The bodies that the networks make of the clips' speech, examples and first frames, and the styles they saw."""
    given, first, style = jax.vmap(partial(_told, params, setting=setting))(batch, draws)
    config, compute = setting.config.model, _compute(setting)
    made = unrolled.rollout(params["decoder"], config.decoder, setting.scales, first, given, config.frame_time, compute)
    return made, style


def _compute(setting: Setting) -> Compute:
    return Compute(setting.config.matmul, setting.config.remat)


def _told(params: Params, clip: Batch, draws: Draws, setting: Setting) -> tuple[Frame, Pose, StyleDistribution]:
    """What the decoder is given of one clip, its first pose, and the style it was drawn from."""
    config, scales, compute = setting.config.model, setting.scales, _compute(setting)
    speech = encode_speech(params, config, scales, jnp.asarray(clip.speech), draws.speech_dropout, compute)
    if config.labels:
        style = StyleDistribution(jax.nn.one_hot(clip.label, len(config.labels)), None)
    else:
        style = encode_style(
            params, config, scales, jnp.asarray(clip.example), clip.example_length, draws.style_dropout, compute
        )
    drawn, frames = reparameterise(style, draws.style), speech.shape[0]
    held, gaze = (jnp.broadcast_to(a, (frames, *a.shape)) for a in (drawn, jnp.asarray(clip.gaze)))
    return Frame(speech, held, gaze), begin(clip), style


def begin(clip: Batch) -> Pose:
    """The pose in which a clip's body begins: its first, or another clip's where the clip's own root is."""
    own = jax.tree.map(lambda a: jnp.asarray(a[0]), clip.poses)
    foreign = clip.foreign
    if foreign is None:
        return own
    other = from_vector(jnp.asarray(foreign.pose), own.root)
    return jax.tree.map(lambda a, b: jnp.where(foreign.chosen, a, b), other, own)


def compare(predicted: Pose, target: Pose, gaze: Float[ArrayLike, "3"], setting: Setting) -> Terms:
    """The weighted terms of a clip's unrolled body; `gaze` is the point [cm] that it faces."""
    model = setting.config.model
    held = jnp.broadcast_to(gaze, predicted.root.pos.shape)
    return losses.reconstruction(predicted, target, held, setting.parents, model.frame_time, model.decoder.facing)


def batch_loss(params: Params, batch: Batch, draws: Draws, step: ArrayLike, setting: Setting) -> tuple[Array, Metrics]:
    """ZeroEGGS Eq. 2 over a batch, and its terms with their weights; `step` counts the updates done before."""
    predicted, style = unroll(params, batch, draws, setting)
    terms = each(partial(compare, setting=setting), predicted, batch.poses, batch.gaze)
    divergence, config = jax.vmap(losses.kl)(style), setting.config
    return weigh(terms, divergence, losses.kl_weight(step, config.kl_limit, config.kl_middle, config.kl_slope))


def weigh(terms: Terms, divergence: Float[Array, " B"], kl_weight: ArrayLike) -> tuple[Array, Metrics]:
    """The loss of a batch from the terms and divergences [B] of its clips, and its parts."""
    means = jax.tree.map(jnp.mean, terms)
    weighted = jnp.asarray(kl_weight) * jnp.mean(divergence)
    return losses.total(means, weighted), {**means._asdict(), "kl": weighted}


def loss_fn(setting: Setting) -> LossFn:
    """The loss with the randomness of each clip drawn from its key, of batches that are augmented if they are to be.

    Where batches are only located, the packed corpus is its last argument.
    """
    config = setting.config
    augmented = partial(augment, by=setting.mirror, window=config.windows.window, frame_time=config.model.frame_time)

    def loss(
        params: Params, batch: Batch | Recorded, keys: Array, step: Array, packed: Piece | None = None
    ) -> tuple[Array, Metrics]:
        if packed is not None and isinstance(batch, Recorded) and isinstance(batch.piece, Located):
            batch = batch._replace(piece=gather(packed, batch.piece))
        batch = jax.vmap(augmented)(batch) if isinstance(batch, Recorded) else batch
        draws = jax.vmap(partial(draw, config=config.model))(keys)
        return batch_loss(params, batch, draws, step, setting)

    return loss
