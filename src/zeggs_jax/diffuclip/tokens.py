"""Sec. 5: timed words as tokens that a text encoder reads, of one length, each with the time of its word."""

import re
import zlib
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32, Shaped
from numpy import ndarray

from ..speech.transcript import Word
from .config import JointConfig

BUCKETS = 4096  # rows of the table that words and their letters are hashed to; row 0 is nothing
PIECES = 16  # ids of one hashed word: itself, then its n-grams
GRAMS = (3, 4)  # letters of an n-gram

Reader = Callable[[Sequence[str]], tuple[Shaped[ndarray, "n ..."], Int[ndarray, " n"]]]
"""Words in order -> the tokens' features, and to which word each token belongs (in order)."""


class Tokens(NamedTuple):
    """A piece of transcript; the features are ids of hashed words [S, 16], vectors [S, 384] or ids of T5 [S]."""

    features: Shaped[ndarray, "S ..."]  # zeros in the padding
    mask: Bool[ndarray, " S"]
    times: Float32[ndarray, " S"]  # s, the middle of the token's word


def between(words: Sequence[Word], start_s: float, stop_s: float) -> tuple[Word, ...]:
    """The words whose middle lies in [start_s, stop_s), their times unchanged."""
    return tuple(word for word in words if start_s <= (word.start + word.end) / 2 < stop_s)


def tokenize(words: Sequence[Word], config: JointConfig, reader: Reader | None = None, zero_s: float = 0.0) -> Tokens:
    """The words as `config.words` tokens: padded, or cut at the end; times from `zero_s` on.

    `reader` makes the tokens: `hashed` (the default, for the encoder "words"), `minilm.reader` or `t5.reader`. No
    words give a mask without a True.
    """
    length = config.words
    features, owners = (reader or hashed)([word.text for word in words])
    count = min(len(owners), length)
    padded = np.zeros((length, *features.shape[1:]), features.dtype)
    padded[:count] = features[:count]
    times = np.zeros(length, np.float32)
    times[:count] = [(words[k].start + words[k].end) / 2 - zero_s for k in owners[:count]]
    return Tokens(padded, np.arange(length) < count, times)


def stack(tokens: Sequence[Tokens]) -> Tokens:
    """A batch: one row of each leaf for each piece."""
    return Tokens(*(np.stack(leaves) for leaves in zip(*tokens, strict=True)))


def hashed(texts: Sequence[str]) -> tuple[Int32[ndarray, "n 16"], Int[ndarray, " n"]]:
    """One token for each word: rows of a table of `BUCKETS` for the word and for its 3- and 4-grams, then zeros.

    Case and punctuation do not count. No vocabulary: a word never heard shares the n-grams of those it is alike.
    """
    ids = np.zeros((len(texts), PIECES), np.int32)
    for row, text in zip(ids, texts, strict=True):
        found = [1 + zlib.crc32(piece.encode()) % (BUCKETS - 1) for piece in pieces(text)[:PIECES]]
        row[: len(found)] = found
    return ids, np.arange(len(texts))


def pieces(text: str) -> tuple[str, ...]:
    """A word in small letters without punctuation, then its n-grams with < and > at its ends."""
    word = re.sub(r"[\W_]", "", text).lower() or text.strip()
    marked = f"<{word}>"
    return (word, *(marked[k : k + n] for n in GRAMS for k in range(len(marked) - n + 1)))
