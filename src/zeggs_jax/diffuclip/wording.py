"""Texts as the prompt space's text heads read them: hashed words, MiniLM's vectors (extra `prompts`), or CLIP's."""

import importlib.util
import warnings
import zlib
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int32

from . import clip, minilm, tokens
from .config import PromptsConfig

Head = Literal["clip", "words", "sentences"]
LONGEST = 48  # words of a text that the head "words" reads


class Hashed(NamedTuple):
    """A text as the head "words" reads it."""

    ids: Int32[np.ndarray, "*b S 16"]
    mask: Bool[np.ndarray, "*b S"]


def installed() -> bool:
    """Is MiniLM here, which the head "sentences" stands on?"""
    return all(importlib.util.find_spec(package) for package in (minilm.PACKAGE, "tokenizers"))


def features(texts: Sequence[str], config: PromptsConfig, head: Head) -> Hashed | Float32[np.ndarray, "K V"]:
    """What a head reads of each text: hashed words [K, S, 16] and their mask [K, S], or vectors of CLIP or MiniLM.

    A text that is too long is cut with a warning.

    Raises:
        ValueError: an empty text; no folder with CLIP, or one of another size; the extra `prompts` is missing.
        OSError: the folder or one of its files is not there.
    """
    for text in texts:
        if not any(letter.isalnum() for letter in text):
            raise ValueError(f"the prompt {text!r} has no words; describe how the body moves, 'an old, tired person'.")
    if head == "words":
        rows = [_hash(text) for text in texts]
        return Hashed(*(np.stack(leaf) for leaf in zip(*rows, strict=True)))
    if head == "sentences":
        return np.asarray(minilm.embed(list(texts)), np.float32)
    vectors = clip.embed_texts(clip.folder_of(config), texts)
    if vectors.shape[1] != config.size:
        raise ValueError(
            f"this CLIP's vectors have {vectors.shape[1]} numbers, the prompt space {config.size}: "
            "set prompts.size to CLIP's."
        )
    return vectors


def known(texts: Sequence[str]) -> Int32[np.ndarray, " n"]:
    """Hashes of all words of the captions trained on, sorted, for `unseen`."""
    return np.unique([_key(word) for text in texts for word in text.split()]).astype(np.int32)


def unseen(seen: Int32[np.ndarray, " n"], text: str) -> list[str]:
    """The words of a prompt that are not among the ones `seen`; none where it is not known which these are."""
    hashes = set(np.asarray(seen).tolist())
    return [word for word in text.split() if hashes and _key(word) not in hashes]


def _hash(text: str) -> Hashed:
    words = text.split()
    if len(words) > LONGEST:
        told = f"the prompt '{text[:40]}...' has {len(words)} words; only the first {LONGEST} count."
        warnings.warn(told, stacklevel=4)
    ids, _ = tokens.hashed(words[:LONGEST])
    return Hashed(np.pad(ids, ((0, LONGEST - len(ids)), (0, 0))), np.arange(LONGEST) < len(ids))


def _key(word: str) -> int:
    return zlib.crc32(tokens.pieces(word)[0].encode()) >> 1
