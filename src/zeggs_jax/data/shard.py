"""A clip's arrays on disk while a corpus is prepared: one file each, whole or not there, named by what made it."""

import hashlib
import json
import os
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float32

from zeggs_jax.data.prepared import skeleton_from_json, skeleton_to_json
from zeggs_jax.data.statistics import Moments
from zeggs_jax.motion.skeleton import Skeleton

VERSION = 1  # of what `prepare` computes from a clip; one more makes all shards of older versions stale
NAMES = "[0-9a-f]" * 32 + ".npz"  # of all shards, as a glob


class Rows(NamedTuple):
    """One row of each kind for every frame of a take."""

    speech: Float32[np.ndarray, "T S"]
    pose: Float32[np.ndarray, "T D"]  # pose vectors, see motion/pose.py
    root_pos: Float32[np.ndarray, "T 3"]  # cm, world
    root_rot: Float32[np.ndarray, "T 4"]  # world
    look: Float32[np.ndarray, "T 3"]  # from the root to the gaze, cm, root frame


class MadeTake(NamedTuple):
    """A take as arrays, with the moments of its rows but the first and last two, as released."""

    gaze: Float32[np.ndarray, "3"]  # cm, world
    rows: Rows
    speech: Moments
    pose: Moments
    look: Moments


class Body(NamedTuple):
    """What all clips of a corpus must share."""

    skeleton: Skeleton
    frame_time: float  # s


class Shard(NamedTuple):
    """All takes of a clip, one for each pace, by name."""

    body: Body
    takes: dict[str, MadeTake]


_TAKE = jax.tree.structure(MadeTake(0, Rows(*5 * [0]), *3 * [Moments(0, 0, 0)]))  # type: ignore[arg-type]


def key(settings: dict[str, Any]) -> str:
    """A name for what is made with these settings, other for any other ones."""
    text = json.dumps({"version": VERSION, **settings}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def write(path: Path, shard: Shard) -> None:
    """The file appears whole or not at all."""
    body = {
        "skeleton": skeleton_to_json(shard.body.skeleton),
        "frame_time": shard.body.frame_time,
        "takes": list(shard.takes),
    }
    leaves = jax.tree.leaves(list(shard.takes.values()))
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    try:
        with partial.open("wb") as file:
            np.savez(file, *leaves, body=np.frombuffer(json.dumps(body).encode(), np.uint8))
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def read_body(path: Path) -> Body:
    """The body alone; ValueError where the file is damaged."""
    with _opened(path) as arrays:
        return _body(_about(arrays))


def read(path: Path) -> Shard:
    """What `write` wrote; ValueError where the file is damaged."""
    with _opened(path) as arrays:
        about, per_take = _about(arrays), _TAKE.num_leaves
        leaves = [arrays[f"arr_{number}"] for number in range(per_take * len(about["takes"]))]
        takes = [jax.tree.unflatten(_TAKE, leaves[at : at + per_take]) for at in range(0, len(leaves), per_take)]
        return Shard(_body(about), dict(zip(about["takes"], takes, strict=True)))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The file's arrays, each checked against its sum when it is read."""
    try:
        with path.open("rb") as file, np.load(file) as arrays:
            yield arrays
    except (zipfile.BadZipFile, zlib.error, KeyError, EOFError, ValueError) as error:
        raise ValueError(f"'{path}' is damaged ({error}); delete it and prepare again.") from error


def _about(arrays: Any) -> dict[str, Any]:
    return json.loads(arrays["body"].tobytes())


def _body(about: dict[str, Any]) -> Body:
    return Body(skeleton_from_json(about["skeleton"]), about["frame_time"])
