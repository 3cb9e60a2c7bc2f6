"""A style library: the embeddings of many clips under one model, with their names, labels and starting poses.

What the style space is to a researcher: points to mix, a mean to exaggerate from, directions to move along, a cloud to
stay in (ZeroEGGS Sec. 5.2). A style saved alone is a library of one entry.
"""

import difflib
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float
from tqdm import tqdm

from ..data import corpus
from ..data.entry import Entry as Take
from ..motion import bvh
from ..motion.features import Motion
from .checkpoints import digest
from .cloud import nearest
from .library_file import Library, check, load, owner, save
from .model import Model, StyleDistribution
from .style_clip import Entry, Frames, bundled_clips, encode, first, fit, read_clip

__all__ = ["Entry", "Library", "bundled", "centroid", "embed", "embed_corpus", "find", "is_bundled", "labels", "load"]
__all__ += ["names", "near", "only", "points", "save", "start_near"]

BUNDLED = Path(str(files("zeggs_jax.zeroeggs") / "pretrained" / "library.npz"))
PIECE = 1800  # frames; longer clips of a corpus are embedded in pieces, for the encoder's attention is quadratic
T = TypeVar("T")


def bundled(model: Model) -> Library:
    """The library of the bundled model: all clips it was trained on, and the bundled styles with their first poses.

    ValueError for any other model, which has no library until one is made.
    """
    return load(BUNDLED, model)


def is_bundled(model: Model) -> bool:
    """Whether it is the bundled model, which has a library of its own."""
    return owner(BUNDLED) == digest(model)


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
        return [read_clip(bundled_clips()[str(source)], model, cut)._replace(source=str(source))]
    if path.suffix.lower() == ".bvh" or path.exists():
        return [read_clip(path, model, cut)]
    expected = "a bundled style, a .bvh clip, a corpus folder or a library"
    raise ValueError(
        f"unknown style '{source}': expected {expected}; nearest: {near(str(source), list(bundled_clips()))}."
    )


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


def points(library: Library) -> Float[Array, "N Z"]:
    """The means of all entries: what principal components and the cloud are fitted on."""
    return jnp.asarray(np.stack([entry.distribution.mean for entry in library.entries]))


def names(library: Library) -> tuple[str, ...]:
    """What `find` finds: the entries' names, and the labels that are no entry's name."""
    return tuple(dict.fromkeys([*(entry.name for entry in library.entries), *labels(library)]))


def labels(library: Library) -> tuple[str, ...]:
    """The labels of its entries, each once, in the order of their first appearance."""
    return tuple(dict.fromkeys(entry.style for entry in library.entries))


def find(library: Library, name: str) -> Entry:
    """The entry of this name, else the centroid of this label; ValueError offers the nearest names.

    An entry without a first pose gets that of the nearest entry that has one.
    """
    found = next((entry for entry in library.entries if entry.name == name), None)
    if found is None:
        return centroid(library, name)
    return found._replace(start=found.start or start_near(library, found.distribution.mean))


def centroid(library: Library, label: str) -> Entry:
    """The middle of a label's clips: a Gaussian with the mean and variance of their mixture, and the nearest start."""
    of = [entry for entry in library.entries if entry.style == label]
    if not of:
        nearest_names = near(label, names(library))
        raise ValueError(f"unknown style '{label}': the library has no such name or label; nearest: {nearest_names}.")
    means = points(Library(library.model, tuple(of)))
    mean, spread = means.mean(0), [e.distribution.log_var for e in of if e.distribution.log_var is not None]
    log_var = jnp.log(jnp.exp(jnp.stack(spread)).mean(0) + means.var(0)) if spread else None
    source = of[0].source if len(of) == 1 else f"the centroid of {len(of)} clips"
    return Entry(label, label, source, None, StyleDistribution(mean, log_var), start_near(library, mean))


def only(library: Library, what: str) -> Entry:
    """The one style of a library: its entry, or the centroid of its one label; ValueError where it has several."""
    if len(library.entries) == 1:
        return find(library, library.entries[0].name)
    if len(labels(library)) == 1:
        return centroid(library, labels(library)[0])
    some = ", ".join(names(library)[:5])
    raise ValueError(f"'{what}' holds {len(labels(library))} styles; name one as '{what}:NAME', such as {some}.")


def start_near(library: Library, z: Float[ArrayLike, " Z"]) -> Motion | None:
    """The first pose of the entry nearest to an embedding among those that have one; None where none has."""
    started = [entry for entry in library.entries if entry.start is not None]
    if not started:
        return None
    indices, _ = nearest(points(Library(library.model, tuple(started))), z, 1)
    return started[int(indices[0])].start


def near(name: str, known: Sequence[str]) -> str:
    """The known names that are spelled most like `name`, or the first of all, as a list for a sentence."""
    spelled = {k.lower(): k for k in known}
    close = difflib.get_close_matches(name.lower(), spelled, n=3, cutoff=0.4)
    return ", ".join([spelled[k] for k in close] or list(known)[:12])


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
