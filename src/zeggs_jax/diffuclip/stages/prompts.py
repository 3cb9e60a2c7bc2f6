"""Stage 4, text and motion prompts (Sec. 6.1.2): windows of motion and captions of their takes come together.

Takes of one style are no negatives of each other: what a caption is to find is any window of its style.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Float32, Int

from ...data import scale
from ...training.step import TrainState, begin, make_step, trained
from .. import prompts, wording
from ..config import DiffuclipConfig
from ..prompts import Hashed, Head
from .stage import Material, Params, Stage, optimiser, window

STRETCHES = 4  # of a take, that its anchor is the mean of
SHORTEST_S = 2.0  # of a window; the longest is `learn_prompts.seconds`
FORGOTTEN = 0.1  # share of a caption's words that training leaves out
COSINE = 0.5  # weight of 1 - cosine of a window and its own caption, beside the contrast


class Batch(NamedTuple):
    """Windows, and one caption of each."""

    motion: Float[ArrayLike, "B N D"]  # scaled
    mask: Bool[ArrayLike, "B N"]
    style: Int[ArrayLike, " B"]
    texts: dict[str, Any]  # the captions as each head reads them, [B, ...]


class Captions(NamedTuple):
    """All captions of a corpus, read once."""

    index: dict[str, int]
    features: dict[str, Any]  # rows


def stage(config: DiffuclipConfig, material: Material, params: dict[str, Params]) -> Stage:
    """The stage; all text heads that can be trained are: "words", and "sentences" where its package is installed."""
    settings, steps = config.learn_prompts, optimiser(config.learn_prompts)
    captions = read_captions(config, material)
    held = _batch(config, material, captions, 0, "valid")
    judge = jax.jit(partial(_embedded, config))
    known = wording.known([text for take in material.takes if take.split == "train" for text in take.captions])

    def start(key: Array) -> TrainState:
        drawn = prompts.init(key, config, material.skeleton)
        networks = {name: drawn[name] for name in ("motion", *captions.features) if name in drawn}
        return begin(networks, steps, settings.ema is not None)

    def validate(state: TrainState) -> dict[str, float]:
        motion, texts = jax.tree.map(np.asarray, judge(trained(state), held))
        return _found(motion, texts, np.asarray(held.style))

    return Stage(
        begin=start,
        step=make_step(partial(loss_fn, config), steps, config.seed, ema=settings.ema),
        batch=lambda k: _batch(config, material, captions, k, "train"),
        finish=lambda state: {**trained(state), "known": known, "anchors": anchors(trained(state), config, material)},
        validate=validate if any(take.split == "valid" for take in material.takes) else None,
    )


def anchors(params: Params, config: DiffuclipConfig, material: Material) -> Float32[np.ndarray, "K P"]:
    """The prompt of every take of the training: the mean of stretches spread over it, of unit length."""
    longest, found = config.prompts.frames, []
    embed = jax.jit(jax.vmap(partial(prompts.encode_motion, params, config)))
    for take in (take for take in material.takes if take.split == "train"):
        starts = np.linspace(0, max(len(take.motion) - longest, 0), STRETCHES).round().astype(int)
        motion, mask = (np.stack(x) for x in zip(*(window(take.motion, int(s), longest) for s in starts), strict=True))
        mean = np.asarray(embed(scale.apply(material.motion_scale, motion), mask)).mean(axis=0)
        found.append(mean / np.linalg.norm(mean))
    return np.asarray(found, np.float32)


def read_captions(config: DiffuclipConfig, material: Material) -> Captions:
    """The captions of all takes, as the heads that are trained read them."""
    texts = sorted({text for take in material.takes for text in take.captions})
    heads: list[Head] = ["clip"] if config.prompts.text == "clip" else ["words"]
    if heads == ["words"] and wording.installed():
        heads.append("sentences")
    rows: dict[str, Any] = {head: wording.features(texts, config.prompts, head) for head in heads}
    if "words" in rows:  # no longer than the longest
        length = rows["words"].mask.any(axis=0).sum()
        rows["words"] = Hashed(*(leaf[:, :length] for leaf in rows["words"]))
    return Captions({text: row for row, text in enumerate(texts)}, rows)


def loss_fn(
    config: DiffuclipConfig, params: Params, batch: Batch, keys: Array, step: Array
) -> tuple[Array, dict[str, Array]]:
    """Contrast both ways and cosine, the mean over the text heads."""
    motion, texts = _embedded(config, params, batch, keys)
    style = jnp.asarray(batch.style)
    same = style[:, None] == style[None, :]
    terms = {}
    for name, text in texts.items():
        terms[f"contrast_{name}"] = contrast(motion @ text.T / config.prompts.temperature, same)
        terms[f"cosine_{name}"] = COSINE * (1.0 - jnp.mean(jnp.sum(motion * text, axis=-1)))
    return jnp.asarray(sum(terms.values())) / len(texts), terms


def contrast(scores: Float[Array, "B B"], same: Bool[Array, "B B"]) -> Float[Array, ""]:
    """CLIP's loss with several right answers: the mean, both ways, of -log of the share that the right ones have.

    With one right answer in each row it is Eq. 4-5, halved.
    """

    def way(scores: Array) -> Array:
        right = jax.nn.logsumexp(jnp.where(same, scores, -jnp.inf), axis=-1)
        return jnp.mean(jax.nn.logsumexp(scores, axis=-1) - right)

    return (way(scores) + way(scores.T)) / 2.0


def _embedded(
    config: DiffuclipConfig, params: Params, batch: Batch, keys: Array | None = None
) -> tuple[Array, dict[str, Array]]:
    """(windows, captions by head) in the prompt space."""
    split = None if keys is None else jax.vmap(partial(jax.random.split, num=2))(keys)
    first, second = (None, None) if split is None else (split[:, 0], split[:, 1])
    over = None if keys is None else 0
    motion = jax.vmap(partial(prompts.encode_motion, params, config), (0, 0, over))(
        jnp.asarray(batch.motion), jnp.asarray(batch.mask), first
    )
    encode = jax.vmap(partial(prompts.encode_text, params, config), (0, over))
    return motion, {head: encode(rows, second) for head, rows in batch.texts.items()}


def _batch(config: DiffuclipConfig, material: Material, captions: Captions, k: int, split: str) -> Batch:
    """Batch k: windows of random length at random places of random takes, each with a random caption of its take."""
    settings, draw = config.learn_prompts, np.random.default_rng([config.seed, 4, k])
    styles = sorted({take.style for take in material.takes})
    takes = [take for take in material.takes if take.split == split] or list(material.takes)
    longest = min(config.prompts.frames, round(settings.seconds / config.frame_time))
    shortest = min(longest, round(SHORTEST_S / config.frame_time))
    rows, labels, texts = [], [], []
    for i in draw.permutation(np.resize(draw.permutation(len(takes)), settings.batch)).tolist():
        take = takes[i]
        frames = int(draw.integers(shortest, longest + 1))
        start = int(draw.integers(0, max(len(take.motion) - frames, 0) + 1))
        rows.append(window(take.motion[: start + frames], start, longest))
        labels.append(styles.index(take.style))
        texts.append(captions.index[take.captions[draw.integers(len(take.captions))]])
    motion, mask = (np.stack(column) for column in zip(*rows, strict=True))
    motion = (motion - material.motion_scale.mean) / material.motion_scale.std
    features = jax.tree.map(lambda leaf: leaf[np.array(texts)], captions.features)
    if split == "train" and "words" in features:
        features["words"] = _forget(features["words"], draw)
    return Batch(np.asarray(motion, np.float32), mask, np.array(labels, np.int32), features)


def _forget(text: Hashed, draw: np.random.Generator) -> Hashed:
    """Some words of each caption left out."""
    kept = text.mask & (draw.random(text.mask.shape) >= FORGOTTEN)
    return text._replace(mask=np.where(kept.any(axis=-1, keepdims=True), kept, text.mask))


def _found(
    motion: Float32[np.ndarray, "B P"], texts: dict[str, Float32[np.ndarray, "B P"]], style: Int[np.ndarray, " B"]
) -> dict[str, float]:
    """Loss, and the share of captions whose best window (and the other way round) is of their style, by head."""
    told: dict[str, float] = {}
    for name, text in texts.items():
        scores = text @ motion.T
        told[f"text_to_motion_{name}"] = float(np.mean(style[scores.argmax(axis=1)] == style))
        told[f"motion_to_text_{name}"] = float(np.mean(style[scores.argmax(axis=0)] == style))
    return {"loss": 1.0 - float(np.mean(list(told.values()))), **told}
