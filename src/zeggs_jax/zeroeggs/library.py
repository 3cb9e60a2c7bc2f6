"""A style library: the embeddings of many clips under one model, with their names, labels and starting poses.

What the style space is to a researcher: points to mix, a mean to exaggerate from, directions to move along, a cloud to
stay in (ZeroEGGS Sec. 5.2). A style saved alone is a library of one entry.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..motion.features import Motion
from .cloud import nearest
from .embedding import embed, embed_corpus
from .library_file import BUNDLED, Library, bundled, is_bundled, load, save
from .model import StyleDistribution
from .style_clip import Entry, near

__all__ = ["Entry", "Library", "bundled", "centroid", "embed", "embed_corpus", "find", "is_bundled", "labels", "load"]
__all__ += ["BUNDLED", "names", "only", "points", "save", "start_near"]


def points(library: Library) -> Float[Array, "N Z"]:
    """The means of all entries: what principal components and the cloud are fitted on."""
    return jax.device_put(np.stack([np.asarray(entry.distribution.mean) for entry in library.entries]))


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
    log_var = jnp.log(jnp.exp(jnp.stack(spread)).sum(0) / len(of) + means.var(0)) if spread else None
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
