"""What is asked for, turned into the style of every frame: mixed, exaggerated, moved, laid out over time (Sec. 5.2)."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..motion.features import Motion
from . import examples, style_space
from . import library as libraries
from . import timeline as timelines
from .library import Library
from .model import Model, StyleDistribution, sample_style
from .style_clip import Entry, Frames
from .timeline import Timeline

NO_LIBRARY = (
    "intensity and components are measured in a style library, and this model comes with none; "
    "make one of its corpus with 'zeggs embed' and give it with --library."
)
INSIDE = 1.005  # times as far out as the farthest clip: up to here it is inside, whatever the rounding


class Request(NamedTuple):
    """What to make: everything that decides the output, besides the speech and the model."""

    styles: tuple[str, ...] = ()  # see `examples.read`; none: 'neutral', or with `pca` the library's mean
    weights: tuple[float, ...] = ()  # blend the styles with these weights (they sum to 1)
    spans: tuple[float, ...] = ()  # or play them one after the other, with these shares of the time
    frames: tuple[Frames, ...] = ()  # cut the style clips: one (start, stop) for each style, or one for all
    first_pose: str | None = None  # a .bvh whose first frame starts the body; default: the last style clip
    temperature: float = 1.0  # 0 = the mean of the style; higher = more varied
    seed: int = 1234
    intensity: float = 1.0  # 0 = the library's mean, 1 = the style, above = exaggerated
    pca: tuple[tuple[int, float], ...] = ()  # move along component 1, 2... by so many standard deviations
    timeline: Timeline | None = None  # styles over time, in the place of `styles`
    library: str | None = None  # the .npz of mean and components; default: the bundled model's own


class Space(NamedTuple):
    """What is known of a model's style space besides the styles asked for."""

    library: Library | None  # None: the model has none, or is steered by labels
    points: Float[Array, "N Z"] | None  # its embeddings, or the one-hot labels


NOWHERE = Space(None, None)


def read_space(request: Request, model: Model) -> Space:
    """The request's library; else, of the bundled model, its own.

    Raises:
        ValueError, OSError: a library that does not read or is of another checkpoint, or a request that cannot do
            without one where there is none.
    """
    if model.config.labels:
        if request.library is not None or request.pca:
            raise ValueError("this model is steered by labels and has no components; leave library and pca out.")
        return Space(None, jnp.eye(len(model.config.labels)))
    if request.library is None and not libraries.is_bundled(model):
        if needs_space(request):
            raise ValueError(NO_LIBRARY)
        return NOWHERE
    library = libraries.bundled(model) if request.library is None else libraries.load(request.library, model)
    points = libraries.points(library)
    if needs_space(request):
        style_space.check_points(points, "mean and no directions", least=3 if request.pca else 2)
    return Space(library, points)


def needs_space(request: Request) -> bool:
    """Whether it asks for what only a library can tell: where the middle is, and the directions from there."""
    cues = request.timeline.cues if request.timeline else ()
    return bool(request.pca) or any(amount != 1.0 for amount in (request.intensity, *(c.intensity for c in cues)))


def named(request: Request) -> tuple[str, ...]:
    """The styles that a request names, those of its timeline included; none where it starts from the mean."""
    if request.timeline is not None:
        return timelines.names(request.timeline)
    return request.styles if request.styles or request.pca else ("neutral",)


def read_styles(request: Request, model: Model, space: Space | None = None) -> list[Entry]:
    """The request's styles, encoded (Fig. 3b): those it names, those of its timeline, or the library's mean."""
    space = read_space(request, model) if space is None else space
    if request.timeline is not None and (request.styles or request.weights or request.spans or request.frames):
        raise ValueError("a timeline names its styles itself; leave styles, weights, spans and frames out.")
    styles = named(request)
    count = len(styles) or 1
    if len(request.frames) not in (0, 1, count):
        raise ValueError(f"got {len(request.frames)} frame ranges for {count} styles; give one or {count}.")
    if not styles:
        return [_mean(request, space)]
    ranges = request.frames * count if len(request.frames) == 1 else request.frames or (None,) * count
    own = space.library if request.library is not None else None  # whose names count before the bundled ones
    try:
        return [examples.read(style, model, cut, own) for style, cut in zip(styles, ranges, strict=True)]
    except ValueError as error:
        raise ValueError(f"the timeline: {error}" if request.timeline else str(error)) from error


def _mean(request: Request, space: Space) -> Entry:
    """The style in the middle of the library, which starts like the one nearest to it."""
    if request.frames or request.spans:
        raise ValueError("components move the library's mean where no style is given; leave frames and spans out.")
    mean = _points(space).mean(0)
    start = libraries.start_near(space.library, mean) if space.library else None
    return Entry("the mean", "", "the mean of the library", None, StyleDistribution(mean, None), start)


def starting_pose(request: Request, chosen: Sequence[Entry], model: Model) -> Motion:
    """Frame 0 and gaze of `first_pose`; else of the last style that has them (as released).

    A timeline begins in the pose of its first style, the heaviest of a mix.
    """
    if request.first_pose is not None:
        return examples.read_motion(request.first_pose, model, what="first pose")
    entries = list(chosen)
    if request.timeline is not None:
        weights = dict(request.timeline.cues[0].mix)
        order = zip(named(request), chosen, strict=True)
        entries = [entry for _, entry in sorted(order, key=lambda style: weights.get(style[0], -1.0))]
    starts = [entry.start for entry in entries if entry.start is not None]
    if not starts:
        raise ValueError("the style has no pose to start from; give a .bvh with --first-pose.")
    return starts[-1]


def style_sequence(
    request: Request, chosen: Sequence[Entry], frames: int, rate_hz: float = 30.0, space: Space = NOWHERE
) -> Float[Array, "T Z"]:
    """A sample of every style, steered and laid out over `frames` frames.

    Raises:
        ValueError: whatever of the request is out of range or does not go together.
    """
    if not 0.0 <= request.temperature < np.inf:
        raise ValueError(f"temperature is {request.temperature:g}; give 0 (the mean) or more.")
    if not 0 <= request.seed < 2**32:
        raise ValueError(f"seed is {request.seed}; give a whole number from 0 to {2**32 - 1}.")
    drawn = _drawn(np.uint32(request.seed), [entry.distribution for entry in chosen], request.temperature)
    return _lay_out(request, drawn, frames, rate_hz, space)


@jax.jit
def _drawn(seed: ArrayLike, styles: list[StyleDistribution], temperature: ArrayLike) -> Float[Array, "K Z"]:
    """A sample of each style, as one program."""
    keys = jax.random.split(jax.random.key(seed), len(styles))
    return jnp.stack([sample_style(key, style, temperature) for key, style in zip(keys, styles, strict=True)])


def _lay_out(
    request: Request, embeddings: Float[Array, "K Z"], frames: int, rate_hz: float, space: Space
) -> Float[Array, "T Z"]:
    """Exaggerated, then blended, stitched or cued, then moved along components, whatever a cue's intensity."""
    embeddings = _exaggerated(request, embeddings, space)
    if request.timeline is not None:
        at = dict(zip(timelines.names(request.timeline), embeddings, strict=True))
        centre = None if space.points is None else space.points.mean(0)
        return _moved(request, timelines.sequence(request.timeline, at, centre, frames, rate_hz), space)
    if request.weights and request.spans:
        raise ValueError("both weights and spans were given; weights blend, spans follow each other: give one.")
    if request.spans:
        shares = style_space.check_shares(request.spans, len(embeddings), "spans")
        if min(shares) < 0.0:
            raise ValueError(f"the spans {shares} are shares of the time; give numbers from 0 to 1.")
        return _moved(request, _stitched(embeddings, shares, frames), space)
    weights = request.weights or (1.0 / len(embeddings),) * len(embeddings)
    weights = style_space.check_shares(weights, len(embeddings), "weights")
    alone = weights == (1.0,)  # then numpy does, which compiles nothing
    point = np.asarray(embeddings)[:1] if alone else style_space.blend(embeddings, weights)[None]
    return _stitched(_moved(request, jax.device_put(point), space), (1.0,), frames)


def _stitched(embeddings: Float[Array, "K Z"], shares: Sequence[float], frames: int) -> Float[Array, "T Z"]:
    """`style_space.stitch`, in numpy and without `jnp.asarray`, which compile no length."""
    spans = np.diff([0, *np.minimum(style_space.boundaries(shares, frames), frames)])
    return jax.device_put(np.repeat(np.asarray(embeddings), spans, axis=0))


def _exaggerated(request: Request, embeddings: Float[Array, "K Z"], space: Space) -> Float[Array, "K Z"]:
    if not np.isfinite(request.intensity):
        raise ValueError(f"intensity {request.intensity:g} is not finite; give 0 (the mean), 1 (the style) or more.")
    if request.intensity == 1.0:
        return embeddings
    centre = _points(space).mean(0)
    return jax.vmap(lambda z: style_space.intensify(z, centre, request.intensity))(embeddings)


def _moved(request: Request, sequence: Float[Array, "T Z"], space: Space) -> Float[Array, "T Z"]:
    if not request.pca:
        return sequence
    amounts = dict(request.pca)
    if not np.isfinite([amount for _, amount in request.pca]).all():
        raise ValueError(f"the components {request.pca} are not finite; move along them by numbers.")
    if len(amounts) < len(request.pca):
        raise ValueError(f"the components {request.pca} name one twice; give each once.")
    components = style_space.principal(_points(space))
    return jax.vmap(lambda z: style_space.move(components, z, amounts))(sequence)


def _points(space: Space) -> Float[Array, "N Z"]:
    if space.points is None:
        raise ValueError(NO_LIBRARY)
    return space.points


def notes(request: Request, chosen: Sequence[Entry], frames: int, rate_hz: float, space: Space) -> tuple[str, ...]:
    """What is worth knowing of the styles asked for: how far outside the library's cloud they reach, at their means."""
    if space.points is None:
        return ()
    if little := style_space.lacking(space.points):
        told = f"a library of {little} is too small to tell how far out the style lies."
        return (told,) if space.library and needs_space(request) else ()
    means = jnp.stack([entry.distribution.mean for entry in chosen])
    sequence = _lay_out(request, means, frames, rate_hz, space)
    cloud = style_space.cloud(space.points)
    far = np.asarray(jax.vmap(style_space.outlying, (None, 0))(cloud, sequence))
    frame = int(far.argmax())
    if far[frame] <= INSIDE:
        return ()
    where = f"the timeline at {frame / rate_hz:.1f} s" if request.timeline else _described(request, chosen)
    farthest = "clip of the style library" if space.library else "label"
    return (f"{where} lies {far[frame]:.2f} times as far out as the farthest {farthest}.",)


def _described(request: Request, chosen: Sequence[Entry]) -> str:
    said = " + ".join(f"'{entry.name}'" for entry in chosen)
    if request.intensity != 1.0:
        said = f"intensity {request.intensity:g} of {said}"
    moved = ", ".join(f"component {number} {amount:+g}" for number, amount in request.pca)
    return f"{said} with {moved}" if moved else said
