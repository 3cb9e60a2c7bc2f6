"""Training of ZeroEGGS (Sec. 4): speech, a style example and the first pose in, closed loop, Eq. 2 out.

RUN holds config.json, log.jsonl (every term of Eq. 2) and checkpoints/step_*; `load_model(RUN)` reads the newest.
The same call on the same folder goes on from there, with the numbers of a run that was never stopped.
"""

import dataclasses
import hashlib
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..data import windows
from ..data.prepared import Prepared, load
from ..data.scale import Scales
from ..data.windows import Batch
from ..training import checkpoint, loop
from ..training.loop import Metrics, TrainState
from ..training.optimiser import radam, stepped_rate
from . import losses
from .checkpoints import describe
from .config import ZeroEggsConfig, to_dict
from .losses import Terms
from .model import Params, StyleDistribution, decode, encode_speech, encode_style, init, reparameterise
from .run_folder import check_same, write_json
from .run_folder import prepared as prepared  # what `train` trains on, made if need be
from .settings import TrainConfig
from .settings import read_config as read_config


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


def draw(key: Array, config: ZeroEggsConfig) -> Draws:
    """The randomness of one clip."""
    noise, speech, style = jax.random.split(key, 3)
    return Draws(jax.random.normal(noise, (config.style_size,)), speech, style)


def clip_loss(params: Params, clip: Batch, draws: Draws, setting: Setting) -> tuple[Terms, Array]:
    """The weighted terms of one clip (a Batch without its leading axis) and its style's KL divergence."""
    config, scales = setting.config.model, setting.scales
    speech = encode_speech(params, config, scales, jnp.asarray(clip.speech), draws.speech_dropout)
    if config.labels:
        style = StyleDistribution(jax.nn.one_hot(clip.label, len(config.labels)), None)
    else:
        style = encode_style(
            params, config, scales, jnp.asarray(clip.example), clip.example_length, draws.style_dropout
        )
    drawn = reparameterise(style, draws.style)
    frames = speech.shape[0]
    first = jax.tree.map(lambda a: a[0], clip.poses)
    hold = partial(jnp.broadcast_to, shape=(frames, drawn.shape[0]))
    gaze = jnp.broadcast_to(clip.gaze, (frames, 3))
    predicted = decode(params, config, scales, first, speech, hold(drawn), gaze)
    terms = losses.reconstruction(predicted, clip.poses, gaze, setting.parents, config.frame_time)
    return terms, losses.kl(style)


def batch_loss(params: Params, batch: Batch, draws: Draws, step: ArrayLike, setting: Setting) -> tuple[Array, Metrics]:
    """ZeroEGGS Eq. 2 over a batch, and its terms with their weights; `step` counts the updates done before."""
    config = setting.config
    terms, divergence = jax.vmap(partial(clip_loss, setting=setting), in_axes=(None, 0, 0))(params, batch, draws)
    terms = jax.tree.map(jnp.mean, terms)
    weight = losses.kl_weight(step, config.kl_limit, config.kl_middle, config.kl_slope)
    weighted = weight * jnp.mean(divergence)
    return losses.total(terms, weighted), {**terms._asdict(), "kl": weighted}


def loss_fn(setting: Setting) -> loop.LossFn:
    """The loss with its randomness drawn from a key."""

    def loss(params: Params, batch: Batch, key: Array, step: Array) -> tuple[Array, Metrics]:
        keys = jax.random.split(key, batch.label.shape[0])
        draws = jax.vmap(partial(draw, config=setting.config.model))(keys)
        return batch_loss(params, batch, draws, step, setting)

    return loss


def optimiser(config: TrainConfig) -> Any:
    """The release's RAdam with its learning-rate steps."""
    return radam(stepped_rate(config.learning_rate, config.decay), eps=config.eps)


def train(folder: str | Path, out: str | Path, config: TrainConfig, progress: bool = True) -> TrainState:
    """Train on the prepared corpus in `folder` (see `prepared`), writing the run to folder `out`.

    Goes on where the run in `out` stopped. ValueError when it was started with other settings or on another
    corpus, when a label model's labels are not the corpus's styles, or when the loss is no longer finite;
    KeyboardInterrupt after Ctrl-C, with all work saved.
    """
    arrays, out = load(folder), Path(out)
    config = fit_config(config, arrays)
    corpus = hashlib.sha256((Path(folder) / "manifest.json").read_bytes()).hexdigest()
    metadata = {**describe(config.model, arrays.skeleton), "training": to_dict(config), "corpus": corpus}
    setting, transform = Setting(config, arrays.scales, arrays.skeleton.parents), optimiser(config)
    state = jax.eval_shape(lambda: loop.begin(init(jax.random.key(0), config.model), transform))
    if found := loop.checkpoints(out):
        check_same(found[-1], metadata, out)
        state = _load(found[-1], state, arrays.scales)
    else:
        state = loop.begin(init(jax.random.key(config.seed), config.model), transform)
    write_json(out / "config.json", to_dict(config))
    return loop.fit(
        state,
        loop.make_step(loss_fn(setting), transform, config.seed),
        lambda k: windows.batch(arrays, config.seed, k, config.windows),
        out,
        loop.Plan(config.steps, config.log_every, config.checkpoint_every, config.keep),
        lambda path, state: checkpoint.save(path, _tree(state, arrays.scales), metadata),
        progress,
    )


def fit_config(config: TrainConfig, corpus: Prepared) -> TrainConfig:
    """The config with the corpus's joints, frame time and number of speech features."""
    model = config.model
    if model.labels and model.labels != corpus.styles:
        raise ValueError(
            f"the config has labels {', '.join(model.labels)}; the corpus has styles {', '.join(corpus.styles)}: "
            "they must be the same, in this order."
        )
    speech = dataclasses.replace(model.speech, features=corpus.speech.shape[1])
    joints = len(corpus.skeleton)
    model = dataclasses.replace(model, joints=joints, frame_time=corpus.frame_time, speech=speech)
    return dataclasses.replace(config, model=model)


def _tree(state: TrainState, scales: Scales) -> dict[str, Any]:
    return {**state._asdict(), "scales": scales._asdict()}


def _load(path: Path, like: TrainState, scales: Scales) -> TrainState:
    """The state in a checkpoint, which must have the shapes of `like`."""
    tree, _ = checkpoint.load(path, _tree(like, scales))
    return TrainState(*(jax.tree.map(jnp.asarray, tree[name]) for name in TrainState._fields))
