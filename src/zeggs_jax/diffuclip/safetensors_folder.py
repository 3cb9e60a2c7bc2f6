"""A model folder as Hugging Face lays it out: config.json, weights in safetensors (in one file or in shards).

A safetensors file is eight bytes with the length of its header, the header in JSON (name -> type, shape, place) and
the numbers; it is read here without a package, and only those tensors that are asked for.
"""

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float32

SINGLE, INDEX, CONFIG = "model.safetensors", "model.safetensors.index.json", "config.json"
TYPES = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "BF16": "<u2"}
NameOf = Callable[[tuple[str, ...]], str]  # the path of one of our leaves -> the tensor's name in the file


class Place(NamedTuple):
    """Where a tensor lies."""

    file: Path
    begin: int  # byte
    dtype: str  # one of TYPES, or another that is refused when it is read
    shape: tuple[int, ...]


def config(folder: str | Path, *kinds: str) -> dict[str, Any]:
    """The folder's config.json.

    Raises:
        FileNotFoundError: no such folder, or no config.json in it.
        ValueError: no JSON, or another "model_type" than one of `kinds`.
    """
    path = Path(folder) / CONFIG
    if not path.is_file():
        raise FileNotFoundError(f"'{folder}' has no {CONFIG}; give a model folder in Hugging Face's layout.")
    found = _json(path)
    if kinds and found.get("model_type") not in kinds:
        raise ValueError(
            f"'{folder}' holds a model of type {found.get('model_type')!r}, expected {' or '.join(map(repr, kinds))}; "
            "give a folder of that architecture."
        )
    return found


def places(folder: str | Path) -> dict[str, Place]:
    """All tensors of the folder by name, from model.safetensors or from the shards that its index names.

    Raises:
        FileNotFoundError: no weights, or a shard that is missing.
        ValueError: a file that is not in safetensors' format, or is cut off.
    """
    folder = Path(folder)
    if (folder / SINGLE).is_file():
        files = [folder / SINGLE]
    elif (folder / INDEX).is_file():
        with _told(folder / INDEX):
            files = [folder / name for name in sorted(set(_json(folder / INDEX)["weight_map"].values()))]
    else:
        raise FileNotFoundError(f"'{folder}' has neither {SINGLE} nor {INDEX}; save the weights as safetensors.")
    found: dict[str, Place] = {}
    for file in files:
        found |= _header(file)
    return found


def _json(path: Path) -> dict[str, Any]:
    with _told(path):
        found = json.loads(path.read_text("utf-8"))
        return dict(found.items())


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """What goes wrong while a broken file is taken apart, in one sentence."""
    try:
        yield
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"'{path}' is damaged or of another format ({error}); download the folder again.") from error


def _header(file: Path) -> dict[str, Place]:
    if not file.is_file():
        raise FileNotFoundError(f"the shard '{file}' is missing; download the folder again.")
    with _told(file), file.open("rb") as stream:
        size = file.stat().st_size
        length = int.from_bytes(stream.read(8), "little")
        if not 0 < length <= size - 8:
            raise ValueError(f"a header of {length} bytes in a file of {size}")
        listed = json.loads(stream.read(length))
        found = {}
        for name, entry in listed.items():
            if name == "__metadata__":
                continue
            begin, end = (8 + length + int(offset) for offset in entry["data_offsets"])
            if end > size:
                raise ValueError(f"'{name}' ends at byte {end} of {size}")
            found[name] = Place(file, begin, str(entry["dtype"]), tuple(map(int, entry["shape"])))
        return found


def read(place: Place) -> Float32[np.ndarray, "..."]:
    """The numbers of a tensor, in float32; ValueError for a type that is no floating-point number."""
    if place.dtype not in TYPES:
        raise ValueError(f"a tensor in '{place.file}' is of type {place.dtype}; expected one of {', '.join(TYPES)}.")
    raw = np.fromfile(place.file, TYPES[place.dtype], math.prod(place.shape), offset=place.begin).reshape(place.shape)
    if place.dtype == "BF16":  # the upper half of a float32
        return (raw.astype(np.uint32) << 16).view(np.float32)
    return raw.astype(np.float32)


def load(folder: str | Path, like: Any, name_of: NameOf) -> Any:
    """Our parameters from the folder's: `like` (pytree of arrays or shapes) says which leaves and of what shape.

    Raises:
        ValueError: a tensor that is missing or of another shape; it is named.
        OSError: see `places`.
    """
    known = places(folder)

    def leaf(path: Any, shape: Any) -> Float32[Array, "..."]:
        name = name_of(tuple(str(key.key) for key in path))
        if name not in known:
            raise ValueError(f"'{folder}' has no tensor '{name}'; give weights of the architecture in {CONFIG}.")
        if known[name].shape != tuple(shape.shape):
            raise ValueError(
                f"'{name}' in '{folder}' is of shape {known[name].shape}, expected {tuple(shape.shape)}; give weights "
                f"of the architecture in {CONFIG}."
            )
        return jnp.asarray(read(known[name]))

    return jax.tree_util.tree_map_with_path(leaf, like)


def tokenizer(folder: str | Path) -> Any:
    """The folder's tokenizer.json as a `tokenizers.Tokenizer` without padding or cutting.

    Raises:
        ValueError: the package is not installed, the file is not there or does not read.
    """
    try:
        from tokenizers import Tokenizer
    except ImportError as error:
        raise ValueError("tokenizer.json needs the package 'tokenizers': pip install 'zeggs-jax[prompts]'.") from error
    path = Path(folder) / "tokenizer.json"
    try:
        found = Tokenizer.from_str(path.read_text("utf-8"))
    except Exception as error:  # the package raises nothing narrower
        raise ValueError(f"'{path}' is missing or no tokenizer ({error}); save the fast tokenizer there.") from error
    found.no_padding()
    found.no_truncation()
    return found
