"""A style by its name, for one model: a label, a bundled style, a BVH clip, a library or one of its entries."""

from pathlib import Path

import jax

from . import library as libraries
from .embedding import bundled_style
from .library import Library
from .model import Model, StyleDistribution
from .style_clip import Entry, Frames, bundled_clips, near, read_clip, read_motion

__all__ = ["bundled", "read", "read_clip", "read_motion", "split"]

bundled = bundled_clips


def read(source: str | Path, model: Model, frames: Frames | None = None, library: Library | None = None) -> Entry:
    """Reads one style: a name or label of `library`, a bundled name, a .bvh clip, an .npz library that holds one
    style, or `library.npz:NAME`, an entry or label of it. Of a model that is steered by labels: one of those.

    `frames` (start, stop) cuts a clip, counted in the clip's own frames.

    Raises:
        ValueError, OSError: unknown name (the nearest ones are offered), clip of another skeleton,
            frames outside the clip, library of another checkpoint.
    """
    name = str(source)
    if model.config.labels:
        return _read_label(name, model, frames)
    path, entry = split(name)
    known = library is not None and name in libraries.names(library)
    if frames is not None and (known or path.suffix == ".npz"):
        raise ValueError(f"'{name}' is a saved embedding and has no frames to cut; leave --frames out.")
    if library is not None and known:
        return libraries.find(library, name)
    if name in bundled():
        return bundled_style(name, model, frames)
    if path.suffix == ".npz":
        found = libraries.load(path, model)
        return libraries.find(found, entry) if entry else libraries.only(found, name)
    if path.suffix.lower() == ".bvh" or path.exists():
        return read_clip(path, model, frames)
    names = [*(libraries.names(library) if library else ()), *bundled()]
    raise _unknown(name, names, "a bundled style, a .bvh clip, an .npz library or LIBRARY.npz:NAME")


def split(style: str) -> tuple[Path, str]:
    """The file of a style argument and, of `library.npz:NAME`, the name; else the whole as a path and ''."""
    file, inside, name = style.partition(".npz:")
    return (Path(file + ".npz"), name) if inside else (Path(style), "")


def _read_label(name: str, model: Model, frames: Frames | None) -> Entry:
    labels = model.config.labels
    if frames is not None:
        raise ValueError("this model is steered by labels, which have no frames; leave --frames out.")
    if name not in labels:
        raise _unknown(name, labels, "one of the model's labels")
    one_hot = jax.nn.one_hot(labels.index(name), len(labels))
    return Entry(name, name, "a label", None, StyleDistribution(one_hot, None), None)


def _unknown(name: str, known: list[str] | tuple[str, ...], expected: str) -> ValueError:
    return ValueError(f"unknown style '{name}': expected {expected}; nearest: {near(name, known)}.")
