"""The encoder of T5 (Raffel et al. 2020) for fine-tuning, with weights of a Hugging Face folder (T5, T5 v1.1, mT5)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int, Int32

from . import safetensors_folder
from .bert import HIDDEN
from .tokens import Reader

Params = Any
DISTANCE, EPS = 128, 1e-6  # of all published T5s


@dataclass(frozen=True)
class T5Config:
    """Sizes of the encoder; the defaults are T5-base's."""

    vocabulary: int = 32128
    width: int = 768
    layers: int = 12
    heads: int = 12
    head_width: int = 64
    inner: int = 3072
    gated: bool = False  # GELU times a second product (v1.1, mT5) instead of ReLU
    buckets: int = 32  # of relative positions
    dropout: float = 0.1


class Linear(nn.Module):
    """W x without a bias, weight (features, in), drawn with a standard deviation of `std`."""

    features: int
    std: float

    @nn.compact
    def __call__(self, x: Float[Array, "S in"]) -> Float[Array, "S out"]:
        weight = self.param("weight", nn.initializers.normal(self.std), (self.features, x.shape[-1]))
        return jnp.tensordot(x, weight, axes=((-1,), (1,)))


class RMSNorm(nn.Module):
    """x over its root mean square, times a weight."""

    @nn.compact
    def __call__(self, x: Float[Array, "S E"]) -> Float[Array, "S E"]:
        weight = self.param("weight", nn.initializers.ones, x.shape[-1:])
        normal = x * jax.lax.rsqrt(jnp.square(x).mean(-1, keepdims=True) + EPS)
        return normal * jnp.broadcast_to(weight, x.shape)


class Attention(nn.Module):
    """Multi-head attention, its products not divided by a length but moved by the relative positions."""

    config: T5Config

    @nn.compact
    def __call__(self, x: Float[Array, "S E"], bias: Float[Array, "H S S"], deterministic: bool) -> Float[Array, "S E"]:
        c = self.config
        stds = {"q": (c.width * c.head_width) ** -0.5, "k": c.width**-0.5, "v": c.width**-0.5}
        query, key, value = (
            Linear(c.heads * c.head_width, std, name=name)(x).reshape(len(x), c.heads, -1) for name, std in stds.items()
        )
        weights = jax.nn.softmax(jnp.einsum("qhd,khd->hqk", query, key) + bias, axis=-1)
        weights = nn.Dropout(c.dropout)(weights, deterministic=deterministic)
        mixed = jnp.einsum("hqk,khd->qhd", weights, value).reshape(len(x), -1)
        return Linear(c.width, (c.heads * c.head_width) ** -0.5, name="o")(mixed)


class FeedForward(nn.Module):
    """Two products with ReLU between, or with a GELU gate."""

    config: T5Config

    @nn.compact
    def __call__(self, x: Float[Array, "S E"], deterministic: bool) -> Float[Array, "S E"]:
        c = self.config
        wide = partial(Linear, c.inner, c.width**-0.5)
        if c.gated:
            inner = jax.nn.gelu(wide(name="wi_0")(x), approximate=True) * wide(name="wi_1")(x)
        else:
            inner = jax.nn.relu(wide(name="wi")(x))
        inner = nn.Dropout(c.dropout)(inner, deterministic=deterministic)
        return Linear(c.width, c.inner**-0.5, name="wo")(inner)


class Encoder(nn.Module):
    """Embedding and blocks; each block normalises before, and adds after."""

    config: T5Config

    @nn.compact
    def __call__(
        self, ids: Int[Array, " S"], mask: Bool[Array, " S"], deterministic: bool = True
    ) -> Float[Array, "S E"]:
        c = self.config
        drop = nn.Dropout(c.dropout, deterministic=deterministic)
        table = jnp.asarray(self.param("embedding", nn.initializers.normal(1.0), (c.vocabulary, c.width)))
        shifts = self.param("positions", nn.initializers.normal(c.width**-0.5), (c.buckets, c.heads))
        bias = shifts[buckets(len(ids), c.buckets)].transpose(2, 0, 1)
        bias = jnp.where(mask[None, None, :], bias, HIDDEN)
        x = drop(table[ids])
        for k in range(c.layers):
            attention, feed_forward = Attention(c, name=f"attention{k}"), FeedForward(c, name=f"feed_forward{k}")
            x = x + drop(attention(RMSNorm(name=f"attention_norm{k}")(x), bias, deterministic))
            x = x + drop(feed_forward(RMSNorm(name=f"feed_forward_norm{k}")(x), deterministic))
        return drop(RMSNorm(name="norm")(x))


def buckets(length: int, count: int) -> Int32[np.ndarray, "S S"]:
    """The bucket of key k as seen by query q: half for each side; single places first, then wider and wider ones."""
    ahead = np.arange(length)[None, :] - np.arange(length)[:, None]
    half = count // 2
    exact, distance = half // 2, np.abs(ahead)
    with np.errstate(divide="ignore"):
        far = exact + np.log(distance / exact) / np.log(DISTANCE / exact) * (half - exact)
    near = np.where(distance < exact, distance, np.minimum(np.maximum(far, 0.0).astype(np.int64), half - 1))
    return (near + np.where(ahead > 0, half, 0)).astype(np.int32)


def init(key: Array, config: T5Config) -> Params:
    """Drawn parameters."""
    ids = jnp.zeros(2, jnp.int32)
    return Encoder(config).init(key, ids, ids == 0)["params"]


def apply(
    params: Params,
    ids: Int[ArrayLike, " S"],
    mask: Bool[ArrayLike, " S"],
    key: Array | None = None,
    dropout: float = 0.1,
) -> Float[Array, "S E"]:
    """The vectors of a sentence's tokens; sizes are those of `params`; with a key, some are dropped."""
    rngs = None if key is None else {"dropout": key}
    encoder, ids, mask = Encoder(config_of(params, dropout)), jnp.asarray(ids), jnp.asarray(mask)
    return jnp.asarray(encoder.apply({"params": params}, ids, mask, key is None, rngs=rngs))


def config_of(params: Params, dropout: float = 0.1) -> T5Config:
    """The sizes that parameters are of."""
    vocabulary, width = params["embedding"].shape
    count, heads = params["positions"].shape
    inner = params["feed_forward0"]["wo"]["weight"].shape[1]
    return T5Config(
        vocabulary, width, sum(name.startswith("attention_norm") for name in params), heads,
        params["attention0"]["q"]["weight"].shape[0] // heads, inner, "wi_0" in params["feed_forward0"], count, dropout,
    )  # fmt: skip


def load(folder: str | Path) -> Params:
    """The encoder's parameters of a folder with config.json and weights in safetensors.

    Raises:
        ValueError, OSError: no such folder, another architecture, a tensor that is missing or of another shape.
    """
    told = safetensors_folder.config(folder, "t5", "mt5", "umt5")
    form = str(told.get("feed_forward_proj", "relu"))
    if told["model_type"] == "umt5" or form not in ("relu", "gated-gelu"):
        raise ValueError(f"'{folder}' is a {told['model_type']} with '{form}'; give a T5, T5 v1.1 or mT5.")
    if told.get("relative_attention_max_distance", DISTANCE) != DISTANCE:
        raise ValueError(f"'{folder}' has positions up to {told['relative_attention_max_distance']}; expected 128.")
    try:
        config = T5Config(
            told["vocab_size"], told["d_model"], told["num_layers"], told["num_heads"], told["d_kv"], told["d_ff"],
            form == "gated-gelu", told.get("relative_attention_num_buckets", 32),
        )  # fmt: skip
    except KeyError as error:
        raise ValueError(f"'{folder}': its config.json has no {error}; give a T5's folder.") from error
    table = "shared.weight" if "shared.weight" in safetensors_folder.places(folder) else "encoder.embed_tokens.weight"
    like = jax.eval_shape(lambda: init(jax.random.key(0), config))
    return safetensors_folder.load(folder, like, partial(_name, table))


def _name(table: str, path: tuple[str, ...]) -> str:
    """Hugging Face's name of one of our leaves."""
    first, *rest = path
    if first in ("embedding", "positions", "norm"):
        bias = "encoder.block.0.layer.0.SelfAttention.relative_attention_bias.weight"
        return {"embedding": table, "positions": bias, "norm": "encoder.final_layer_norm.weight"}[first]
    kind = first.rstrip("0123456789")
    block = f"encoder.block.{first.removeprefix(kind)}.layer.{int(kind.startswith('feed_forward'))}"
    if kind.endswith("norm"):
        return f"{block}.layer_norm.weight"
    return ".".join([block, "SelfAttention" if kind == "attention" else "DenseReluDense", *rest])


def reader(folder: str | Path) -> Reader:
    """Words as ids of the folder's tokenizer.json; a word may be of several tokens.

    Raises:
        ValueError: no tokenizer.json that reads, or the package `tokenizers` is not installed.
    """
    tokenizer = safetensors_folder.tokenizer(folder)

    def read(texts: Sequence[str]) -> tuple[Int32[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        if not texts:
            return np.zeros(0, np.int32), np.zeros(0, np.int64)
        made = tokenizer.encode(list(texts), is_pretokenized=True, add_special_tokens=False)
        return np.array(made.ids, np.int32), np.array(made.word_ids, np.int64)

    return read
