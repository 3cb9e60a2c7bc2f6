"""A style library and its file: one .npz of stacked arrays, marked with the checkpoint whose embeddings they are."""

import os
import zipfile
from collections import Counter
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from ..motion import pose
from ..motion.features import Motion
from .checkpoints import digest
from .model import Model, StyleDistribution
from .style_clip import Entry

FORMAT = "zeggs style library 1"
BUNDLED = Path(str(files("zeggs_jax.zeroeggs") / "pretrained" / "library.npz"))
WHOLE = (-1, -1)  # the frames of a clip that was not cut
DAMAGED = (KeyError, ValueError, TypeError, IndexError, OSError, EOFError, zipfile.BadZipFile)


class Library(NamedTuple):
    """Styles of one model."""

    model: str  # digest of the model
    entries: tuple[Entry, ...]  # each with a name of its own


def save(path: str | Path, library: Library) -> Path:
    """Writes a library as .npz, whole or not at all; the same library gives the same bytes.

    Raises:
        ValueError: a name that is no .npz, no entries, or two of one name.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise ValueError(f"'{path}' is no name for a style library; give one that ends in .npz.")
    check(library, f"the library for '{path.name}'")
    temporary = path.with_name(f".{path.name}.part")
    with temporary.open("wb") as file:
        np.savez_compressed(file, **_pack(library))
    os.replace(temporary, path)
    return path


def load(path: str | Path, model: Model) -> Library:
    """A library that `save` wrote, for the same model.

    Raises:
        FileNotFoundError: nothing there.
        ValueError: no library, a damaged one, one with two entries of one name, or one of another checkpoint.
    """
    path = Path(path)
    if not path.is_file():
        wrong = "is a folder" if path.is_dir() else "does not exist"
        raise FileNotFoundError(f"style library '{path}' {wrong}; make one with 'zeggs embed'.")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            if str(archive["format"]) != FORMAT:
                raise ValueError(f"its format is not '{FORMAT}'")
            library = _unpack({key: archive[key] for key in archive.files})
    except DAMAGED as error:
        raise ValueError(f"'{path}' is not a style library, or damaged; make one with 'zeggs embed'.") from error
    check(library, f"style library '{path.name}'")
    if library.model != digest(model):
        raise ValueError(f"style library '{path.name}' was made with another checkpoint; embed its clips again.")
    return library


def bundled(model: Model) -> Library:
    """The library of the bundled model: all clips it was trained on, and the bundled styles with their first poses.

    ValueError for any other model, which has no library until one is made.
    """
    return load(BUNDLED, model)


def is_bundled(model: Model) -> bool:
    """Whether it is the bundled model, which has a library of its own."""
    with np.load(BUNDLED, allow_pickle=False) as archive:
        return str(archive["model"]) == digest(model)


def check(library: Library, what: str) -> Library:
    """The library itself; a ValueError, which begins with `what`, where it has no entries or two of one name."""
    if not library.entries:
        raise ValueError(f"{what} is empty; embed one clip or more.")
    name, times = Counter(entry.name for entry in library.entries).most_common(1)[0]
    if times > 1:
        raise ValueError(f"{what} has {times} entries called '{name}'; give each clip a name of its own.")
    return library


def _pack(library: Library) -> dict[str, Any]:
    entries = library.entries
    exact = np.full_like(entries[0].distribution.mean, np.nan)  # stands for the variance of a style that has none
    spreads = [entry.distribution.log_var for entry in entries]
    started = [(k, entry.start) for k, entry in enumerate(entries) if entry.start is not None]
    poses = [jax.tree.map(lambda x: x[0], start.pose) for _, start in started]
    return {
        "format": FORMAT,
        "model": library.model,
        "names": np.array([entry.name for entry in entries]),
        "styles": np.array([entry.style for entry in entries]),
        "sources": np.array([entry.source for entry in entries]),
        "frames": np.array([entry.frames or WHOLE for entry in entries], np.int32),  # [N, 2]
        "mean": np.array([entry.distribution.mean for entry in entries], np.float32),  # [N, Z]
        "log_var": np.array([exact if s is None else s for s in spreads], np.float32),  # [N, Z]
        "started": np.array([k for k, _ in started], np.int32),  # [S]: which entries have a start
        "gaze": np.array([start.gaze for _, start in started], np.float32),  # [S, 3]
        "root_pos": np.array([p.root.pos for p in poses], np.float32),  # [S, 3]
        "root_rot": np.array([p.root.rot for p in poses], np.float32),  # [S, 4]
        "pose": np.array([pose.to_vector(p) for p in poses], np.float32),  # [S, D]
    }


def _unpack(stored: Mapping[str, Any]) -> Library:
    count, log_var = len(stored["mean"]), stored["log_var"]
    if any(len(stored[key]) != count for key in ("names", "styles", "sources", "frames")):
        raise ValueError("its columns differ in length")
    if log_var.shape != stored["mean"].shape or not np.isfinite(stored["mean"]).all():
        raise ValueError("its embeddings are damaged")
    starts = {int(k): _start(stored, row) for row, k in enumerate(stored["started"])}
    entries = []
    for k in range(count):
        spread = None if np.isnan(log_var[k]).all() else log_var[k]
        begin, end = (int(number) for number in stored["frames"][k])
        entries.append(
            Entry(
                name=str(stored["names"][k]),
                style=str(stored["styles"][k]),
                source=str(stored["sources"][k]),
                frames=None if (begin, end) == WHOLE else (begin, end),
                distribution=StyleDistribution(stored["mean"][k], spread),
                start=starts.get(k),
            )
        )
    return Library(str(stored["model"]), tuple(entries))


def _start(stored: Mapping[str, Any], row: int) -> Motion:
    one = slice(row, row + 1)
    root = pose.Root(stored["root_pos"][one], stored["root_rot"][one])
    return Motion(pose.from_vector(stored["pose"][one], root), stored["gaze"][row])
