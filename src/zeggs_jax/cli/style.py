"""Commands on the style space: embed clips, list styles, find the nearest, draw the map."""

from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from .arguments import Out, Ranges
from .guards import frame_range, keep_inputs, prepare_folder


def embed(
    clips: Positional[tuple[str, ...]],
    /,
    *,
    out: Out,
    frames: Ranges = (),
    label: Annotated[tuple[str, ...], arg(metavar="LABEL")] = (),
    checkpoint: Path | None = None,
) -> None:
    """Encode style clips, or all clips of a corpus, and save their embeddings as a library, to generate from later.

    Args:
        clips: Bundled styles, .bvh clips, corpus folders (as for 'zeggs train') or libraries to join.
        out: The .npz file to write.
        frames: Cut the clips to frames A to B (B not included); one for each clip, or one for all.
        label: The style that a clip shows, instead of its name; one for each clip, or one for all.
        checkpoint: A model of your own, from 'zeggs train' or 'zeggs convert'.
    """
    from ..zeroeggs import generate as g
    from ..zeroeggs import library as libraries

    if out.suffix != ".npz":
        raise ValueError(f"'{out}' is no name for a style library; give one that ends in .npz.")
    ranges = tuple(frame_range(text) for text in frames)
    keep_inputs((out,), clips)
    prepare_folder(out.parent)
    made = libraries.embed(clips, g.load_model(checkpoint) if checkpoint else g.bundled_model(), ranges, label)
    libraries.save(out, made)
    clips_told = f"{len(made.entries)} clip{'s'[: len(made.entries) != 1]}"
    shown = libraries.labels(made)
    print(f"wrote {out}: {clips_told} of {len(shown)} style{'s'[: len(shown) != 1]}")


def styles(
    *,
    library: Path | None = None,
    nearest: str | None = None,
    count: int | None = None,
    picture: Path | None = None,
    checkpoint: Path | None = None,
) -> None:
    """List the bundled styles or those of a library, find the nearest to a clip, draw the map of the style space.

    Args:
        library: A library from 'zeggs embed'; for --nearest and --picture the bundled model's own when left out.
        nearest: A clip (or any style): list the library's clips that are nearest to it.
        count: How many; 5 when left out.
        picture: The map to draw, .png, .svg or .pdf: the first two principal components, --nearest marked.
        checkpoint: The model that the library was made with, from 'zeggs train' or 'zeggs convert'.
    """
    from ..zeroeggs import examples
    from ..zeroeggs import generate as g

    if count is not None and (nearest is None or count < 1):
        raise ValueError(f"--count {count} says how many of the nearest are listed; give --nearest too, and 1 or more.")
    if picture is not None:
        keep_inputs((picture,), tuple(filter(None, (nearest, str(library or "")))))
    alone = library is None and nearest is None and picture is None
    if alone and checkpoint is None:
        print("\n".join(examples.bundled()))
        return
    model = g.load_model(checkpoint) if checkpoint else g.bundled_model()
    if alone:
        print("\n".join(model.config.labels or examples.bundled()))
        return
    known = _library(library, model)
    example = None if nearest is None else examples.read(nearest, model, library=known)
    if picture is not None:
        prepare_folder(picture.parent)
        _draw(picture, known, example)
        print(f"wrote {picture}")
    if example is not None:
        print(_near(known, example, count or 5))
    elif picture is None:
        rows = [(entry.name, entry.style, _source(entry)) for entry in known.entries]
        print(_columns([("name", "style", "source"), *rows]))


def _library(path: Path | None, model: Any) -> Any:
    """The library named, or the bundled model's own."""
    from ..zeroeggs import library as libraries

    if model.config.labels:
        raise ValueError("this model is steered by labels and has no style space; leave out all but --checkpoint.")
    if path is not None:
        return libraries.load(path, model)
    if not libraries.is_bundled(model):
        raise ValueError("this model has no style library yet; make one with 'zeggs embed' and give it with --library.")
    return libraries.bundled(model)


def _near(library: Any, example: Any, count: int) -> str:
    """The library's clips that are nearest to a style, and whether the style lies among them."""
    from ..zeroeggs import library as libraries
    from ..zeroeggs import style_space

    points, z = libraries.points(library), example.distribution.mean
    indices, distances = style_space.nearest(points, z, count)
    near = [(library.entries[int(k)], float(far)) for k, far in zip(indices, distances, strict=True)]
    told = _columns([("name", "style", "distance"), *((e.name, e.style, f"{far:.2f}") for e, far in near)])
    if style_space.lacking(points):
        return told
    out = float(style_space.outlying(style_space.cloud(points), z))
    return f"{told}\n'{example.name}' lies {out:.2f} times as far out as the farthest clip of the library."


def _draw(path: Path, library: Any, example: Any) -> None:
    """The library's clips by their first two principal components, and a style among them."""
    import jax

    from ..stage import plots
    from ..zeroeggs import library as libraries
    from ..zeroeggs import style_space

    points = libraries.points(library)
    components = style_space.principal(points)
    if len(components.std) < 2:
        raise ValueError("the library's clips lie on one line, which makes no map; embed clips of another style too.")
    places = jax.vmap(lambda z: style_space.coordinates(components, z)[:2])(points)
    marked = {}
    if example is not None:
        marked = {example.name: style_space.coordinates(components, example.distribution.mean)[:2]}
    shares = [float(share) for share in components.share[:2]]
    plots.space(path, places, [entry.style for entry in library.entries], shares, marked)


def _source(entry: Any) -> str:
    return entry.source if entry.frames is None else f"{entry.source}, frames {entry.frames[0]}:{entry.frames[1]}"


def _columns(rows: list[tuple[str, ...]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)
