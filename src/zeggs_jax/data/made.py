"""Made clips read from their folders, each with the recorded one that it goes with, its style and its provenance."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zeggs_jax.data import body as bodies
from zeggs_jax.data import counterparts
from zeggs_jax.data.recorded import Recorded, Truth, below, clip_of, read_notes, same
from zeggs_jax.motion.bvh import Clip

ALIKE = 0.2  # bones that are longer or shorter by this share are another unit or another person


class Made(NamedTuple):
    """A made clip and the recorded one that it goes with."""

    name: str
    path: Path
    clip: Clip
    truth: Recorded | None
    style: str | None
    provenance: Mapping[str, Any]  # what `zeggs generate` wrote beside it, or nothing


def read_groups(generated: Sequence[str], truth: Truth, rate_hz: float | None = None) -> dict[str, list[Made]]:
    """Made clips by group: each folder is one (called `NAME` where given as NAME=FOLDER), all single files another.

    Raises:
        ValueError, OSError: no such file or folder, a folder without clips, two groups of one name, a skeleton or rate
            that is not the truth's, bones of another length.
    """
    paths: dict[str, list[tuple[str, Path]]] = {}
    for text in generated:
        name, place = named(text)
        clips = below(place) if place.is_dir() else [(place.stem, place)]
        if place.is_dir() and not clips:
            raise ValueError(f"the folder '{place}' holds no clips; put the generated .bvh files there.")
        if place.is_dir() and name in paths:
            raise ValueError(f"two groups are called '{name}'; give one another name, as {name}2={place}.")
        paths.setdefault(name, []).extend(clips)
    by_name = {recorded.name: recorded for recorded in truth.clips}
    return {group: [_made(*item, truth, by_name, rate_hz) for item in items] for group, items in paths.items()}


def named(text: str) -> tuple[str, Path]:
    """(name of the group, its place) of a command line's word: FOLDER, FILE.bvh or NAME=FOLDER."""
    name, equals, place = text.partition("=")
    path = Path(text) if not equals or Path(text).exists() else Path(place)
    if equals and not name and path == Path(place):
        raise ValueError(f"'{text}' names a group without a name; give NAME=FOLDER or the folder alone.")
    if not path.exists():
        raise FileNotFoundError(f"there is no file or folder '{path}' to evaluate; check its name.")
    if path.is_file() and path.suffix.lower() != ".bvh":
        raise ValueError(f"'{path}' is no motion; give .bvh files or folders of them.")
    if equals and path == Path(place):
        return name, path
    return (path.resolve().name, path) if path.is_dir() else ("generated", path)


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _made(name: str, path: Path, truth: Truth, by_name: Mapping[str, Recorded], rate_hz: float | None) -> Made:
    clip, first = clip_of(path, rate_hz), truth.clips[0]
    same(first.clip, clip, first.path, path)
    clip = bodies.normalise_like(clip, truth.body, first.clip.skeleton, str(path))
    _same_size(first, clip, path)
    beside_it = path.with_suffix(".provenance.json")
    notes = read_notes(beside_it) if beside_it.is_file() else {}
    goes = counterparts.of_provenance(notes, list(by_name))
    called = counterparts.of_name(name, list(by_name))
    if called.truth is None and "/" in name:
        called = counterparts.of_name(name.rsplit("/", 1)[-1], list(by_name))
    if goes.truth is None:
        goes = counterparts.Counterpart(called.truth, goes.style or called.style)
    styles = {recorded.name: recorded.style for recorded in truth.clips}
    style = counterparts.style_of(goes.style, goes.truth, styles) if not notes or goes.style else None
    return Made(name, path, clip, None if goes.truth is None else by_name[goes.truth], style, notes)


def _same_size(first: Recorded, clip: Clip, path: Path) -> None:
    ours, theirs = (np.linalg.norm(c.skeleton.offsets[1:], axis=-1).sum() for c in (clip, first.clip))
    if not (1.0 - ALIKE) * theirs < ours < (1.0 + ALIKE) * theirs:
        raise ValueError(
            f"the bones of '{path}' are {ours / theirs:.3g} times as long as those of '{first.path}'; "
            "write both in one unit, for one body."
        )
