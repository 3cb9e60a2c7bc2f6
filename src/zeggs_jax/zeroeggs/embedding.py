"""Clips, whole corpora and other libraries, embedded as one style library (ZeroEGGS Fig. 3b)."""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

from tqdm import tqdm

from ..data import corpus
from ..data.entry import Entry as Take
from ..motion import bvh
from .checkpoints import digest
from .library_file import Library, bundled, check, is_bundled, load
from .model import Model
from .style_clip import Entry, Frames, bundled_clips, encode, first, fit, near, read_clip

PIECE = 1800  # frames; longer clips of a corpus are embedded in pieces, for the encoder's attention is quadratic
T = TypeVar("T")


def embed(
    sources: Sequence[str | Path], model: Model, frames: Sequence[Frames] = (), labels: Sequence[str] = ()
) -> Library:
    """A library of bundled styles, .bvh clips, whole corpus folders and other libraries.

    `frames` cut the clips, `labels` name their styles: one for each source, or one for all. A clip is otherwise called
    and labelled as its file; of clips of one name, those that are cut have their frames behind it.

    Raises:
        ValueError, OSError: nothing to embed, a source that does not read, frames of a folder or a library, a model
            that is steered by labels, or clips whose names are the same.
    """
    _refuse_labels(model)
    entries: list[Entry] = []
    cuts, given = _each(frames, len(sources), "frame ranges"), _each(labels, len(sources), "labels")
    for source, cut, label in zip(sources, cuts, given, strict=True):
        found = _embed(source, model, cut)
        entries += found if label is None else [entry._replace(style=label) for entry in found]
    times = Counter(entry.name for entry in entries)
    for k, entry in enumerate(entries):
        if times[entry.name] > 1 and entry.frames is not None:
            entries[k] = entry._replace(name=_piece(entry.name, entry.frames))
    return check(Library(digest(model), tuple(entries)), "the library")


def _embed(source: str | Path, model: Model, cut: Frames | None) -> Sequence[Entry]:
    path = Path(source)
    if cut is not None and (path.is_dir() or path.suffix == ".npz"):
        raise ValueError(f"'{source}' is no clip and has no frames to cut; leave the frames out.")
    if path.is_dir():
        return embed_corpus(path, model).entries
    if path.suffix == ".npz":
        return load(path, model).entries
    if str(source) in bundled_clips():
        return [bundled_style(str(source), model, cut)]
    if path.suffix.lower() == ".bvh" or path.exists():
        return [read_clip(path, model, cut)]
    expected = "a bundled style, a .bvh clip, a corpus folder or a library"
    raise ValueError(
        f"unknown style '{source}': expected {expected}; nearest: {near(str(source), list(bundled_clips()))}."
    )


def bundled_style(name: str, model: Model, cut: Frames | None = None) -> Entry:
    """A bundled style by its name: of the bundled model, as it was encoded when that was made; else read now."""
    if cut is None and is_bundled(model):
        return next(entry for entry in bundled(model).entries if entry.name == name)
    return read_clip(bundled_clips()[name], model, cut)._replace(source=name)


def embed_corpus(folder: str | Path, model: Model) -> Library:
    """A library of all clips of a corpus folder (see `data.corpus`), named and labelled as there, with a progress bar.

    Of takes with time codes, the acted part. Clips of more than 1,800 frames are embedded in pieces, each an entry.

    Raises:
        ValueError, OSError: no corpus, a clip that does not read or is of another skeleton, a model of labels.
    """
    _refuse_labels(model)
    takes = tqdm(corpus.find(folder), desc="embedding", unit="clip")
    entries = [entry for take in takes for entry in _embed_take(take, Path(folder), model)]
    return check(Library(digest(model), tuple(entries)), f"the library of '{folder}'")


def _embed_take(take: Take, folder: Path, model: Model) -> Iterator[Entry]:
    clip = bvh.read(take.bvh)
    begin, end = 0, len(clip.euler)
    if take.sync is not None:
        rate_hz = bvh.rate_hz(clip.frame_time)
        begin, end = (min(round(time * rate_hz), end) for time in take.sync.motion_s)
    pieces = max(1, -(-(end - begin) // PIECE))
    edges = [begin + (end - begin) * k // pieces for k in range(pieces + 1)]
    for start, stop in pairwise(edges):
        whole = (start, stop) == (0, len(clip.euler))
        motion = fit(clip, take.bvh.name, model, (start, stop), "clip")
        yield Entry(
            name=take.name if pieces == 1 else _piece(take.name, (start, stop)),
            style=take.style,
            source=take.bvh.relative_to(folder).as_posix(),
            frames=None if whole else (start, stop),
            distribution=encode(model, motion),
            start=first(motion),
        )


def _each(given: Sequence[T], count: int, what: str) -> list[T | None]:
    """One of the given things for each of `count` sources: as they are, one for all, or None."""
    if len(given) not in (0, 1, count):
        raise ValueError(f"got {len(given)} {what} for {count} sources; give one or {count}.")
    if not given:
        return [None] * count
    return [given[k % len(given)] for k in range(count)]


def _piece(name: str, frames: Frames) -> str:
    return f"{name}_{frames[0]}-{frames[1]}"


def _refuse_labels(model: Model) -> None:
    if model.config.labels:
        raise ValueError("this model is steered by labels, which have no embeddings; give a label as the style.")
