"""CLIP (Radford et al. 2021): its text and image towers, with the public weights from a local Hugging Face folder.

Both are frozen here: a text or a picture becomes a vector of `projection` numbers, not yet of unit length.
"""

import warnings
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Float32, Int, Int32
from numpy import ndarray

from ..nn.layers import Dense
from . import bert, safetensors_folder
from .config import PromptsConfig

Params = Any
Kind = Literal["text", "image"]
MEAN, STD = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)  # of red, green, blue
TOGETHER = 32  # texts at once
DEFAULTS: dict[str, dict[str, Any]] = {  # what Hugging Face leaves out of config.json
    "text": {"hidden_size": 512, "intermediate_size": 2048, "num_attention_heads": 8, "eos_token_id": 49407},
    "image": {"hidden_size": 768, "intermediate_size": 3072, "num_attention_heads": 12, "eos_token_id": 0},
    "both": {
        "num_hidden_layers": 12, "hidden_act": "quick_gelu", "layer_norm_eps": 1e-5, "vocab_size": 49408,
        "max_position_embeddings": 77, "image_size": 224, "patch_size": 32,
    },
}  # fmt: skip


class Sizes(NamedTuple):
    """What config.json says of a tower."""

    width: int
    inner: int
    layers: int
    heads: int
    activation: str  # quick_gelu or gelu
    eps: float
    projection: int
    vocabulary: int  # of the text tower
    places: int  # tokens at most
    end: int  # the token whose vector stands for the text
    pixels: int  # of the image tower, the picture's width and height
    patch: int


class Tower(NamedTuple):
    """A loaded tower."""

    sizes: Sizes
    params: Params


class Blocks(nn.Module):
    """Pre-normalised transformer blocks; each token sees those that `open_` lets it see."""

    sizes: Sizes

    @nn.compact
    def __call__(self, x: Float[Array, "T E"], open_: Bool[Array, "T T"]) -> Float[Array, "T E"]:
        s = self.sizes
        for k in range(s.layers):
            y = bert.norm(s.eps, f"norm1_{k}")(x)
            query, key, value = (
                Dense(s.width, name=f"{name}_{k}")(y).reshape(len(x), s.heads, -1) for name in ("q", "k", "v")
            )
            scores = jnp.einsum("qhd,khd->hqk", query, key) / np.sqrt(s.width // s.heads)
            weights = jax.nn.softmax(jnp.where(open_[None], scores, -jnp.inf), axis=-1)
            mixed = jnp.einsum("hqk,khd->qhd", weights, value).reshape(x.shape)
            x = x + Dense(s.width, name=f"out_{k}")(mixed)
            y = Dense(s.inner, name=f"fc1_{k}")(bert.norm(s.eps, f"norm2_{k}")(x))
            y = y * jax.nn.sigmoid(1.702 * y) if s.activation == "quick_gelu" else jax.nn.gelu(y, approximate=False)
            x = x + Dense(s.width, name=f"fc2_{k}")(y)
        return x


class TextTower(nn.Module):
    """Tokens, padded behind their end -> a vector."""

    sizes: Sizes

    @nn.compact
    def __call__(self, ids: Int[Array, " S"]) -> Float[Array, " P"]:
        s, draw = self.sizes, nn.initializers.normal(0.02)
        table = self.param("tokens", draw, (s.vocabulary, s.width))
        places = self.param("places", draw, (s.places, s.width))
        causal = jnp.tril(jnp.ones((len(ids), len(ids)), bool))
        x = Blocks(s, name="blocks")(table[ids] + places[: len(ids)], causal)
        x = bert.norm(s.eps, "norm")(x)
        # The older public files say that a text ends with token 2, and mean the last of the vocabulary.
        end = jnp.argmax(ids if s.end == 2 else ids == s.end)
        return self.param("projection", draw, (s.projection, s.width)) @ x[end]


class ImageTower(nn.Module):
    """A picture, normalised -> a vector."""

    sizes: Sizes

    @nn.compact
    def __call__(self, image: Float[Array, "H W 3"]) -> Float[Array, " P"]:
        s, draw = self.sizes, nn.initializers.normal(0.02)
        rows = s.pixels // s.patch
        kernel = self.param("patches", draw, (s.width, 3, s.patch, s.patch))
        cut = image.reshape(rows, s.patch, rows, s.patch, 3)
        x = jnp.einsum("ahbwc,echw->abe", cut, kernel).reshape(rows * rows, s.width)
        x = jnp.concatenate([self.param("class", draw, (s.width,))[None], x])
        x = x + self.param("places", draw, (rows * rows + 1, s.width))
        x = Blocks(s, name="blocks")(bert.norm(s.eps, "enter_norm")(x), jnp.ones((len(x), len(x)), bool))
        return self.param("projection", draw, (s.projection, s.width)) @ bert.norm(s.eps, "norm")(x[:1])[0]


def folder_of(config: PromptsConfig) -> Path:
    """The folder that the settings name; ValueError where they name none."""
    if not config.clip:
        raise ValueError(
            "prompts by CLIP need its weights: set prompts.clip to a local folder of openai/clip-vit-large-patch14, or "
            'prompts.text to "words" and prompts.image to "small".'
        )
    return Path(config.clip)


@cache
def load(folder: Path, kind: Kind) -> Tower:
    """One tower of a CLIP folder (config.json and safetensors); kept for the next call.

    Raises:
        ValueError: another architecture, a tensor that is missing or of another shape.
        OSError: no such folder or file.
    """
    sizes = _sizes(folder, kind)
    tower = _network(kind, sizes)
    given = jnp.zeros(1, jnp.int32) if kind == "text" else jnp.zeros((sizes.pixels, sizes.pixels, 3))
    like = jax.eval_shape(tower.init, jax.random.key(0), given)["params"]
    return Tower(sizes, safetensors_folder.load(folder, like, partial(_name, kind)))


def _network(kind: Kind, sizes: Sizes) -> TextTower | ImageTower:
    return TextTower(sizes) if kind == "text" else ImageTower(sizes)


def _sizes(folder: Path, kind: Kind) -> Sizes:
    told = safetensors_folder.config(folder, "clip")
    own = told.get("text_config" if kind == "text" else "vision_config")
    c = DEFAULTS["both"] | DEFAULTS[kind] | (own if isinstance(own, dict) else {})
    sizes = Sizes(
        c["hidden_size"], c["intermediate_size"], c["num_hidden_layers"], c["num_attention_heads"], c["hidden_act"],
        c["layer_norm_eps"], told.get("projection_dim", 512), c["vocab_size"], c["max_position_embeddings"],
        c["eos_token_id"], c["image_size"], c["patch_size"],
    )  # fmt: skip
    if sizes.activation not in ("quick_gelu", "gelu"):
        raise ValueError(
            f"'{folder}' has the activation '{sizes.activation}'; expected a CLIP with quick_gelu or gelu."
        )
    return sizes


NAMES = {
    "q": "self_attn.q_proj", "k": "self_attn.k_proj", "v": "self_attn.v_proj", "out": "self_attn.out_proj",
    "norm1": "layer_norm1", "norm2": "layer_norm2", "fc1": "mlp.fc1", "fc2": "mlp.fc2",
}  # fmt: skip
TEXT = {
    "tokens": "text_model.embeddings.token_embedding.weight",
    "places": "text_model.embeddings.position_embedding.weight",
    "norm": "text_model.final_layer_norm",
    "projection": "text_projection.weight",
}
IMAGE = {
    "patches": "vision_model.embeddings.patch_embedding.weight",
    "class": "vision_model.embeddings.class_embedding",
    "places": "vision_model.embeddings.position_embedding.weight",
    "enter_norm": "vision_model.pre_layrnorm",  # as it is spelt there
    "norm": "vision_model.post_layernorm",
    "projection": "visual_projection.weight",
}


def _name(kind: Kind, path: tuple[str, ...]) -> str:
    """Hugging Face's name of one of our leaves."""
    last = {"scale": ".weight", "weight": ".weight", "bias": ".bias"}
    if path[0] == "blocks":
        layer, number = path[1].rsplit("_", 1)
        model = "text_model" if kind == "text" else "vision_model"
        return f"{model}.encoder.layers.{number}.{NAMES[layer]}{last[path[2]]}"
    return (TEXT if kind == "text" else IMAGE)[path[0]] + (last[path[1]] if len(path) > 1 else "")


def encode_image(params: Params, sizes: Sizes, image: Float[ArrayLike, "H W 3"]) -> Float[Array, " P"]:
    """The vector of a picture, 0 to 1; ValueError for one of another size than the tower reads."""
    image = jnp.asarray(image)
    if image.shape[:2] != (sizes.pixels, sizes.pixels):
        raise ValueError(
            f"this CLIP reads pictures of {sizes.pixels} pixels, these have {image.shape[0]}: set prompts.pixels."
        )
    normal = (image - np.array(MEAN, np.float32)[None, None]) / np.array(STD, np.float32)[None, None]
    return jnp.asarray(ImageTower(sizes).apply({"params": params}, normal))


def embed_texts(folder: Path, texts: Sequence[str]) -> Float32[ndarray, "K P"]:
    """The vectors of texts; one of more than 75 tokens is cut with a warning. ValueError, OSError: see `load`."""
    tower, tokenizer = load(folder, "text"), safetensors_folder.tokenizer(folder)
    rows = [_padded(tokenizer, text, tower.sizes.places) for text in texts]
    made = []
    for k in range(0, len(rows), TOGETHER):
        some = np.stack(rows[k : k + TOGETHER])
        whole = np.pad(some, ((0, TOGETHER - len(some)), (0, 0)), mode="edge")
        made.append(np.asarray(_encode_texts(tower.sizes, tower.params, whole))[: len(some)])
    return np.concatenate(made)


@partial(jax.jit, static_argnums=0)
def _encode_texts(sizes: Sizes, params: Params, ids: Int[Array, "B S"]) -> Float[Array, "B P"]:
    return jax.vmap(lambda one: jnp.asarray(TextTower(sizes).apply({"params": params}, one)))(ids)


def _padded(tokenizer: Any, text: str, places: int) -> Int32[ndarray, " S"]:
    """The tokens of a text with its beginning and end, padded by the end."""
    ids = tokenizer.encode(text).ids
    if len(ids) > places:
        told = f"the prompt '{text[:40]}...' has {len(ids) - 2} tokens; CLIP reads the first {places - 2}."
        warnings.warn(told, stacklevel=4)
        ids = [*ids[: places - 1], ids[-1]]
    return np.array(ids + [ids[-1]] * (places - len(ids)), np.int32)
