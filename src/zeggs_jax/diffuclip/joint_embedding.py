"""Sec. 5: gestures and transcripts in one space; which words matter for the gesture (Eq. 7).

Text: T5's encoder, or a small encoder over hashed words or MiniLM's vectors. Gesture: BERT's encoder over the quantised
latents. Both are pooled by their maximum over time (Eq. 3) and trained to agree (Eq. 4-6).
"""

from functools import cache
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ..nn.attention import positions
from ..nn.layers import Dense
from . import bert, minilm, t5
from .config import DiffuclipConfig, JointConfig
from .tokens import BUCKETS, PIECES, Reader, Tokens, hashed

Params = Any
FAR = 1e9  # takes padding out of a maximum


class Text(NamedTuple):
    """A transcript in the joint space."""

    words: Float[Array, "S D"]  # Z^t, zeros in the padding
    pooled: Float[Array, " D"]  # z^t, zeros where there are no words


class Gesture(NamedTuple):
    """A gesture in the joint space."""

    latents: Float[Array, "L D"]  # Z^g, zeros in the padding
    pooled: Float[Array, " D"]  # z^g


class Words(nn.Module):
    """Hashed words or given vectors -> as many vectors of the joint space, each aware of the others."""

    config: JointConfig

    @nn.compact
    def __call__(self, features: Array, mask: Bool[Array, " S"], deterministic: bool = True) -> Float[Array, "S D"]:
        c = self.config
        if c.text == "words":
            table = jnp.asarray(self.param("table", nn.initializers.normal(0.5), (BUCKETS, c.width)))
            heard = features > 0
            count = jnp.maximum(heard.sum(1, keepdims=True), 1)
            features = jnp.where(heard[..., None], table[features], 0.0).sum(1) / jnp.sqrt(count)
        return _Contextual(c.text_layers, c.heads, c.width, c.dropout, name="encoder")(features, mask, deterministic)


class Gestures(nn.Module):
    """Quantised latents -> as many vectors of the joint space; those that are `hidden` are replaced by one learnt."""

    config: JointConfig

    @nn.compact
    def __call__(
        self, quantised: Float[Array, "L C"], mask: Bool[Array, " L"], hidden: Bool[Array, " L"], deterministic: bool
    ) -> Float[Array, "L D"]:
        c = self.config
        covered = self.param("covered", nn.initializers.normal(0.02), quantised.shape[-1:])
        shown = jnp.where(hidden[:, None], jnp.broadcast_to(covered, quantised.shape), quantised)
        return _Contextual(c.layers, c.heads, c.width, c.dropout, name="encoder")(shown, mask, deterministic)


class _Contextual(nn.Module):
    """A dense layer, sinusoidal positions and BERT's blocks."""

    layers: int
    heads: int
    width: int
    dropout: float

    @nn.compact
    def __call__(self, x: Float[Array, "T in"], mask: Bool[Array, " T"], deterministic: bool) -> Float[Array, "T D"]:
        x = Dense(self.width, gain=1.0, zero_bias=True, name="enter")(x) + positions(len(x), self.width)
        x = bert.norm(1e-5, "enter_norm")(x)
        x = nn.Dropout(self.dropout, deterministic=deterministic)(x)
        return bert.Encoder(self.layers, self.heads, self.dropout, 1e-5, name="blocks")(x, mask, deterministic)


def init(key: Array, config: DiffuclipConfig, t5_params: Params | None = None) -> Params:
    """Both encoders with drawn parameters, or with a T5 that was loaded (`t5.load`); leaves "text" and "gesture".

    Raises:
        ValueError: a T5 of another width than `config.joint.width`.
    """
    joint = config.joint
    keys = jax.random.split(key)
    seen = jnp.ones(2, bool)
    if joint.text == "t5":
        text = t5.init(keys[0], t5_config(joint)) if t5_params is None else t5_params
        if (width := text["embedding"].shape[1]) != joint.width:
            raise ValueError(f"this T5's vectors are of {width} numbers, expected {joint.width}; set joint.width.")
    else:
        features = jnp.zeros((2, PIECES), jnp.int32) if joint.text == "words" else jnp.zeros((2, minilm.WIDTH))
        text = Words(joint).init(keys[0], features, seen)["params"]
    return {"text": text, "gesture": init_gesture(keys[1], config)}


def init_gesture(key: Array, config: DiffuclipConfig) -> Params:
    """The gesture encoder alone, with drawn parameters."""
    seen = jnp.ones(2, bool)
    return Gestures(config.joint).init(key, jnp.zeros((2, config.latent_size)), seen, ~seen, True)["params"]


@cache
def reader(config: JointConfig) -> Reader:
    """What makes the encoder's tokens of words; kept, since a tokenizer takes long to open.

    Raises:
        ValueError, OSError: "t5" without a folder in `config`, or what `t5.reader` and `minilm.reader` raise.
    """
    if config.text == "words":
        return hashed
    if config.text == "minilm":
        return minilm.reader()
    if not config.folder:
        raise ValueError("joint.text is 't5', whose words are cut by its tokenizer; set joint.folder to T5's folder.")
    return t5.reader(config.folder)


def t5_config(joint: JointConfig) -> t5.T5Config:
    """T5's form at the joint space's sizes: T5-base at the paper's."""
    return t5.T5Config(
        width=joint.width, layers=joint.text_layers, heads=joint.heads, head_width=joint.width // joint.heads,
        inner=4 * joint.width, dropout=joint.dropout,
    )  # fmt: skip


def encode_text(params: Params, config: DiffuclipConfig, spoken: Tokens, key: Array | None = None) -> Text:
    """E_T: Z^t and z^t of a piece of transcript; with a key, some numbers are dropped as in training."""
    features, mask = jnp.asarray(spoken.features), jnp.asarray(spoken.mask)
    if config.joint.text == "t5":
        made = t5.apply(params["text"], features, mask, key, config.joint.dropout)
    else:
        rngs = None if key is None else {"dropout": key}
        made = Words(config.joint).apply({"params": params["text"]}, features, mask, key is None, rngs=rngs)
    return Text(*_pooled(jnp.asarray(made), mask))


def encode_gesture(
    params: Params,
    config: DiffuclipConfig,
    quantised: Float[ArrayLike, "L C"],
    mask: Bool[ArrayLike, " L"],
    hidden: Bool[ArrayLike, " L"] | None = None,
    key: Array | None = None,
) -> Gesture:
    """E_G: Z^g and z^g of quantised latents (on the scale of `Encoded.quantised`); `hidden` ones are covered up."""
    rngs = None if key is None else {"dropout": key}
    mask = jnp.asarray(mask)
    hidden = jnp.zeros(mask.shape, bool) if hidden is None else jnp.asarray(hidden)
    variables = {"params": params["gesture"]}
    made = Gestures(config.joint).apply(variables, jnp.asarray(quantised), mask, hidden, key is None, rngs=rngs)
    return Gesture(*_pooled(jnp.asarray(made), mask))


def _pooled(x: Float[Array, "T D"], mask: Bool[Array, " T"]) -> tuple[Float[Array, "T D"], Float[Array, " D"]]:
    """Eq. 3: the maximum over time of what is no padding."""
    seen = mask[:, None]
    most = jnp.where(seen, x, -FAR).max(axis=0)
    return jnp.where(seen, x, 0.0), jnp.where(mask.any(), most, 0.0)


def saliency(
    words: Float[ArrayLike, "S D"],
    pooled: Float[ArrayLike, " D"],
    mask: Bool[ArrayLike, " S"],
    mode: Literal["paper", "rescaled"],
    sharpness: float,
) -> Float[Array, " S"]:
    """Eq. 7: how much each word matters for the gesture; 0 in the padding.

    "paper": softmax of the dot products, which sums to 1. "rescaled": softmax of the cosines over `sharpness`, times
    the number of words, so that words that matter alike have 1 and leave the attention of Eq. 12 as it is.
    """
    words, pooled, mask = jnp.asarray(words), jnp.asarray(pooled), jnp.asarray(mask)
    if mode == "paper":
        return _softmax(words @ pooled, mask)
    return mask.sum() * _softmax(unit(words) @ unit(pooled) / sharpness, mask)


def _softmax(scores: Float[Array, " S"], mask: Bool[Array, " S"]) -> Float[Array, " S"]:
    return jnp.where(mask, jax.nn.softmax(jnp.where(mask, scores, -FAR)), 0.0)


def unit(x: Float[ArrayLike, "*b D"]) -> Float[Array, "*b D"]:
    """Vectors of length 1; zero, with a finite gradient, where they are zero."""
    x = jnp.asarray(x)
    return x * jax.lax.rsqrt(jnp.square(x).sum(-1, keepdims=True) + 1e-12)


def contrastive(z_t: Float[ArrayLike, "B D"], z_g: Float[ArrayLike, "B D"], temperature: float) -> Float[Array, ""]:
    """Eq. 4-5: a gesture is to be told its transcript among the batch's, plus the other way round."""
    scores = jnp.asarray(z_g) @ jnp.asarray(z_t).T / temperature
    return _chosen(scores) + _chosen(scores.T)


def _chosen(scores: Float[Array, "B B"]) -> Float[Array, ""]:
    """Mean of -log of the softmax at each row's own column."""
    return -jnp.diagonal(jax.nn.log_softmax(scores, axis=-1)).mean()


def distilled(
    student: tuple[Float[ArrayLike, "B D"], Float[ArrayLike, "B D"]],
    teacher: tuple[Float[ArrayLike, "B D"], Float[ArrayLike, "B D"]],
    temperature: float,
    weight: float | Float[Array, ""],
) -> Float[Array, ""]:
    """Eq. 6: (1 - w) L_contrast + w (KL(p~ || p) of both directions); each (z_t, z_g), the teacher fixed."""
    soft_t, soft_g = (jax.lax.stop_gradient(jnp.asarray(z)) for z in teacher)
    z_t, z_g = map(jnp.asarray, student)
    apart = _divergence(soft_g @ soft_t.T, z_g @ z_t.T, temperature)
    apart += _divergence(soft_t @ soft_g.T, z_t @ z_g.T, temperature)
    return (1.0 - weight) * contrastive(z_t, z_g, temperature) + weight * apart


def _divergence(told: Float[Array, "B B"], made: Float[Array, "B B"], temperature: float) -> Float[Array, ""]:
    """Mean over the rows of KL(softmax(told) || softmax(made))."""
    aim, found = (jax.nn.log_softmax(scores / temperature, axis=-1) for scores in (told, made))
    return (jnp.exp(aim) * (aim - found)).sum(-1).mean()
