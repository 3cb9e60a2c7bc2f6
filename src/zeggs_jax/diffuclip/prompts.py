"""Sec. 6.1.2: style prompts in one space: a motion encoder aligned with text, as MotionCLIP (Tevet et al. 2022).

Text comes through one of three heads: "clip", CLIP's frozen text tower from a local folder; "words", a small encoder of
hashed words that is trained with the motion encoder; "sentences", a small network on the vectors of a frozen sentence
encoder (MiniLM, extra `prompts`), for wordings that no caption of the corpus has. Videos: video_encoder.py.
"""

import warnings
from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Float32, Int32

from ..motion.skeleton import Skeleton
from ..nn.attention import positions
from ..nn.layers import Dense
from . import bert, clip, joint_embedding, minilm, tokens, video_encoder, wording
from .config import DiffuclipConfig, JointConfig, PromptsConfig
from .joint_embedding import unit
from .wording import Hashed, Head

Params = Any
TEXT_LAYERS = 2  # of the head "words"


class MotionEncoder(nn.Module):
    """Scaled motion -> prompt space: `patch` frames are one token, a learnt class token before them is the result."""

    config: PromptsConfig

    @nn.compact
    def __call__(
        self, motion: Float[Array, "N D"], mask: Bool[Array, " N"], deterministic: bool = True
    ) -> Float[Array, " size"]:
        c = self.config
        frames, columns = motion.shape
        last = jnp.maximum(mask.sum() - 1, 0)
        held = motion[jnp.minimum(jnp.arange(frames + -frames % c.patch), last)]  # beyond the end it stands still
        seen = jnp.pad(mask, (0, -frames % c.patch)).reshape(-1, c.patch).any(axis=1)
        x = Dense(c.width, gain=1.0, zero_bias=True, name="enter")(held.reshape(-1, c.patch * columns))
        first = self.param("class", nn.initializers.normal(0.02), (1, c.width))
        x = jnp.concatenate([first, x + positions(len(x), c.width)])
        x = nn.Dropout(c.dropout, deterministic=deterministic)(bert.norm(1e-5, "enter_norm")(x))
        seen = jnp.concatenate([jnp.ones(1, bool), seen])
        x = bert.Encoder(c.layers, c.heads, c.dropout, 1e-5, name="blocks")(x, seen, deterministic)
        return unit(Dense(c.size, gain=1.0, zero_bias=True, name="leave")(x[0]))


class WordsHead(nn.Module):
    """Hashed words -> prompt space."""

    config: PromptsConfig

    @nn.compact
    def __call__(
        self, ids: Int32[Array, "S 16"], mask: Bool[Array, " S"], deterministic: bool = True
    ) -> Float[Array, " size"]:
        c = self.config
        reader = JointConfig("words", c.width, heads=c.heads, text_layers=TEXT_LAYERS, dropout=c.dropout)
        x = joint_embedding.Words(reader, name="words")(ids, mask, deterministic)
        pooled = jnp.where(mask[:, None], x, 0.0).sum(0) / jnp.maximum(mask.sum(), 1)
        return unit(Dense(c.size, gain=1.0, zero_bias=True, name="leave")(pooled))


class SentencesHead(nn.Module):
    """A sentence's vector -> prompt space."""

    config: PromptsConfig

    @nn.compact
    def __call__(self, vector: Float[Array, " V"], deterministic: bool = True) -> Float[Array, " size"]:
        c = self.config
        x = nn.Dropout(c.dropout, deterministic=deterministic)(vector * np.sqrt(minilm.WIDTH))
        x = jax.nn.gelu(Dense(2 * c.width, name="widen")(x))
        x = nn.Dropout(c.dropout, deterministic=deterministic)(x)
        return unit(Dense(c.size, gain=1.0, zero_bias=True, name="leave")(x))


def init(key: Array, config: DiffuclipConfig, skeleton: Skeleton) -> Params:
    """Leaves "motion", "words" and "sentences" (neither with CLIP's text), "known" (hashes of the words seen).

    Training adds "anchors", the prompts of the motions seen (`ground`), and "video".
    """
    c, keys = config.prompts, jax.random.split(key, 3)
    frames, seen = jnp.zeros((c.patch, 3 + 6 * len(skeleton))), jnp.ones(c.patch, bool)
    params = {"motion": MotionEncoder(c).init(keys[0], frames, seen)["params"], "known": np.zeros(0, np.int32)}
    if c.text == "words":
        ids = jnp.zeros((2, tokens.PIECES), jnp.int32)
        params["words"] = WordsHead(c).init(keys[1], ids, jnp.ones(2, bool))["params"]
        params["sentences"] = SentencesHead(c).init(keys[2], jnp.zeros(minilm.WIDTH))["params"]
    return params


def encode_motion(
    params: Params,
    config: DiffuclipConfig,
    motion: Float[ArrayLike, "N D"],
    mask: Bool[ArrayLike, " N"],
    key: Array | None = None,
) -> Float[Array, " size"]:
    """The prompt that a scaled motion is, of unit length; `mask` is True up to its end. With a key: dropout."""
    variables, rngs = {"params": params["motion"]}, None if key is None else {"dropout": key}
    motion, mask = jnp.asarray(motion), jnp.asarray(mask)
    return jnp.asarray(MotionEncoder(config.prompts).apply(variables, motion, mask, key is None, rngs=rngs))


def encode_text(
    params: Params, config: DiffuclipConfig, features: Hashed | Float[ArrayLike, " V"], key: Array | None = None
) -> Float[Array, " size"]:
    """The prompt that one text is, of unit length, from its `wording.features`. With a key: dropout."""
    rngs = None if key is None else {"dropout": key}
    if isinstance(features, Hashed):
        ids, mask = map(jnp.asarray, features)
        made = WordsHead(config.prompts).apply({"params": params["words"]}, ids, mask, key is None, rngs=rngs)
        return jnp.asarray(made)
    vector = jnp.asarray(features)
    if config.prompts.text == "clip":  # MotionCLIP's space is CLIP's own
        return unit(vector)
    made = SentencesHead(config.prompts).apply({"params": params["sentences"]}, vector, key is None, rngs=rngs)
    return jnp.asarray(made)


def best_head(params: Params, config: DiffuclipConfig) -> Head:
    """The head for free wording: CLIP's; MiniLM's where it was trained and is installed; else that of hashed words."""
    if config.prompts.text == "clip":
        return "clip"
    return "sentences" if "sentences" in params and wording.installed() else "words"


def embed_texts(
    params: Params, config: DiffuclipConfig, texts: Sequence[str], head: Head | None = None
) -> Float32[np.ndarray, "K size"]:
    """The prompts that texts are, of unit length, by `head` or the best there is (`best_head`).

    Warns of a text that is cut and, with hashed words, of words that no caption of the training had. ValueError for an
    empty text.
    """
    head = head or best_head(params, config)
    features = wording.features(texts, config.prompts, head)
    if head == "words":
        for text in texts:
            if unknown := wording.unseen(params["known"], text):
                told = ", ".join(map(repr, unknown))
                warnings.warn(
                    f"the prompt '{text}' has words that the model has never read ({told}): only their letters count; "
                    "pip install 'zeggs-jax[prompts]' understands free wording.",
                    stacklevel=2,
                )
    return np.asarray(_embed(params, config, features))


@partial(jax.jit, static_argnames="config")
def _embed(params: Params, config: DiffuclipConfig, features: Any) -> Float[Array, "K size"]:
    return jax.vmap(partial(encode_text, params, config))(features)


def see(config: DiffuclipConfig, images: Float[Array, "V H W 3"], tower: Params = None) -> Float[Array, "V ..."]:
    """What the video encoder reads of pictures (0 to 1): themselves, or the vectors of CLIP's tower for images.

    The `tower` is loaded where it is not given; ValueError, OSError where there is none.
    """
    if config.prompts.image == "small":
        return images
    loaded = clip.load(clip.folder_of(config.prompts), "image")
    tower = loaded.params if tower is None else tower
    return jax.vmap(partial(clip.encode_image, tower, loaded.sizes))(images)


def encode_video(
    params: Params, config: DiffuclipConfig, images: Float[ArrayLike, "K V H W 3"]
) -> Float[Array, " size"]:
    """The prompt that a video is, of unit length: the mean of its stretches' (`video.read`), pictures from 0 to 1."""
    pictures = jnp.asarray(images)
    each = [video_encoder.encode(params["video"], config, see(config, stretch)) for stretch in pictures]
    return unit(jnp.mean(jnp.stack(each), axis=0))


def pick(
    prompt: Float[ArrayLike, " size"], candidates: Float[ArrayLike, "K size"], sharpness: float = 12.0, most: int = 3
) -> Float[Array, " K"]:
    """Weights of candidates (unit vectors) for a prompt, sum 1: softmax of the cosines times `sharpness`.

    All but the `most` nearest have weight 0, so that a mixture stays one of few.
    """
    cosines = jnp.asarray(candidates) @ jnp.asarray(prompt)
    few = jnp.sort(cosines)[-min(most, len(cosines))]
    return jax.nn.softmax(jnp.where(cosines >= few, sharpness * cosines, -jnp.inf))


def ground(params: Params, config: DiffuclipConfig, prompt: Float[ArrayLike, " size"]) -> Float32[np.ndarray, " size"]:
    """A text's or a video's prompt brought to where motions lie: the mixture of the nearest of the training (`pick`).

    Wording that no caption had lands beside the motions' part of the space, where the denoiser has learnt nothing.
    Unless the config's prompts are `grounded` and there are anchors, the prompt as it is, as the paper's.
    """
    if not config.prompts.grounded or "anchors" not in params:
        return np.asarray(prompt, np.float32)
    return np.asarray(unit(pick(prompt, params["anchors"]) @ jnp.asarray(params["anchors"])))
