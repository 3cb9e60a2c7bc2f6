"""Speech features and style in, poses out, in pieces of a fixed number of frames: no length compiles anew.

The speech encoder sees some frames to both sides, so a piece is encoded with these around it, the ends repeated as the
encoder does; the decoder hands its state from piece to piece. What is added behind the last frame changes nothing
before it and is cut off. Several clips are decoded at once, in batches of a few sizes, padded to the longest.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..data.scale import Scales
from ..motion.features import Motion
from ..motion.pose import Pose
from ..nn.reduced import Precision, with_precision
from . import decoder, folded
from .config import ZeroEggsConfig
from .decoder import DecoderState, Frame
from .folded import CHUNK, Folded, FoldedState
from .model import Model, encode_speech

WIDTHS = (4, 8, 16, 32)  # clips of one executable; fewer are filled up
MODELS = 2  # models whose weights are kept ready

State = FoldedState | DecoderState


class Told(NamedTuple):
    """What one clip is made from."""

    spectrum: Float[Array | np.ndarray, "T F"]
    style: Float[Array | np.ndarray, "T Z"]
    start: Motion  # its first pose and its gaze are taken


class Ready(NamedTuple):
    """A model's weights on the device, in the form that runs."""

    speech: Any
    decoder: Any  # the plain form, of which the folded one takes the first projections
    folded: Folded | None  # None where there is no such form
    scales: Scales
    frame_time: Float[Array, ""]


def ready(model: Model, precision: Precision = "float32") -> Ready:
    """The weights of `model` made ready, once: they are kept for the last models that ran.

    A model is known again by its arrays being the same objects; arrays changed in place are not noticed.

    Raises:
        ValueError: reduced weights of a decoder that has no folded form.
    """
    arrays, config = jax.tree.leaves((model.params, model.scales)), model.config
    for number, kept in enumerate(_KEPT):
        same = (kept.config, kept.precision, len(kept.arrays)) == (config, precision, len(arrays))
        if same and all(a is b for a, b in zip(kept.arrays, arrays, strict=True)):
            _KEPT.append(_KEPT.pop(number))
            return kept.ready
    form = None
    if folded.fits(config.decoder) or precision != "float32":
        exact = folded.fold(model.params["decoder"], config.decoder, model.scales, config.frame_time)
        form = with_precision(exact, precision)
    parts = model.params["speech"], model.params["decoder"], form, model.scales, np.float32(config.frame_time)
    made = Ready(*jax.device_put(parts))  # `jnp.asarray` would compile every shape
    _KEPT.append(_Kept(arrays, config, precision, made))
    del _KEPT[:-MODELS]
    return made


class _Kept(NamedTuple):
    arrays: list[Any]
    config: ZeroEggsConfig
    precision: Precision
    ready: Ready


_KEPT: list[_Kept] = []


@partial(jax.jit, static_argnames=("config",))
def begin(run: Ready, config: ZeroEggsConfig, first: Pose, given: Frame) -> State:
    """The state before frame 1, from the first pose and frame 0's style and target; `vmap` it with `out_axes=-1`."""
    if run.folded is None:
        return decoder.begin(run.decoder, config.decoder, run.scales, first, given)
    return folded.begin(run.decoder, run.folded, config.decoder, run.scales, first, given)


@partial(jax.jit, static_argnames=("config",), donate_argnames=("state",))
def advance(
    run: Ready,
    config: ZeroEggsConfig,
    state: State,
    spectrum: Float[Array, "N F"],
    style: Float[Array, "K Z"],
    target: Float[Array, "K 3"],
) -> tuple[State, Pose]:
    """K frames on. `spectrum` has the frames that the encoder sees behind and ahead of them too: kernel - 1 more."""
    heard = _heard(run, config, spectrum, len(style))
    return _step(run, config, state, Frame(heard, style, target))


@partial(jax.jit, static_argnames=("config",), donate_argnames=("state",))
def advance_many(
    run: Ready,
    config: ZeroEggsConfig,
    state: State,
    spectrum: Float[Array, "N F B"],
    style: Float[Array, "K Z B"],
    target: Float[Array, "K 3 B"],
) -> tuple[State, Pose]:
    """The same for B clips, which are the last axis of all arrays and of the state, and the first of the poses."""
    each = partial(jax.vmap, in_axes=-1, out_axes=-1)
    given = Frame(each(partial(_heard, run, config, frames=len(style)))(spectrum), style, target)
    if run.folded is None:
        return jax.vmap(partial(_step, run, config), -1, (-1, 0))(state, given)
    assert isinstance(state, FoldedState)
    return folded.advance_many(run.folded, config.decoder, state, given)


def _heard(run: Ready, config: ZeroEggsConfig, spectrum: Float[Array, "N F"], frames: int) -> Float[Array, "K S"]:
    speech = encode_speech({"speech": run.speech}, config, run.scales, spectrum)
    return jax.lax.slice_in_dim(speech, config.speech.behind, config.speech.behind + frames)


def _step(run: Ready, config: ZeroEggsConfig, state: Any, given: Frame) -> tuple[State, Pose]:
    if run.folded is not None:
        return folded.advance(run.folded, config.decoder, state, given)

    def frame(state: DecoderState, given: Frame) -> tuple[DecoderState, Pose]:
        seen = decoder.observe(state.pose, given.target, run.scales.pose_in, config.decoder.facing)
        predicted, hidden = decoder.predict(run.decoder, config.decoder, seen, given, state.hidden)
        pose = decoder.integrate(state.pose, predicted, run.scales.pose_out, run.frame_time)
        return DecoderState(pose, hidden), pose

    return jax.lax.scan(frame, state, given)


def synthesize(
    model: Model,
    spectrum: Float[ArrayLike, "T F"],
    style: Float[ArrayLike, "T Z"],
    start: Motion,
    precision: Precision = "float32",
) -> Pose:
    """The networks of Fig. 2, without files: T poses as numpy arrays, the first of which is that of `start`."""
    run, told = ready(model, precision), _on_host(spectrum, style, start)
    first, given = _first(told, model.config)
    state, pieces = begin(run, model.config, first, given), [_framed(first)]
    for at in range(1, len(told.spectrum), CHUNK):
        state, poses = advance(run, model.config, state, *_piece(told, at, model.config))
        pieces.append(poses)
    return _joined(pieces, len(told.spectrum))


def synthesize_many(model: Model, told: Sequence[Told], precision: Precision = "float32") -> list[Pose]:
    """As `synthesize` of each, to rounding, many at once: clips of like length together, at most 32.

    With weights of fewer bytes, five clips and more have their activations rounded to bfloat16 too.
    """
    made: dict[int, Pose] = {}
    order = sorted(range(len(told)), key=lambda number: len(told[number].spectrum))
    for start in range(0, len(order), WIDTHS[-1]):
        group = order[start : start + WIDTHS[-1]]
        if len(group) == 1:
            made[group[0]] = synthesize(model, *told[group[0]], precision)
        else:
            poses = _together(ready(model, precision), model.config, [_on_host(*told[number]) for number in group])
            made |= dict(zip(group, poses, strict=True))
    return [made[number] for number in range(len(told))]


def _together(run: Ready, config: ZeroEggsConfig, clips: Sequence[Told]) -> list[Pose]:
    width = next(width for width in WIDTHS if width >= len(clips))
    full = [*clips, *[clips[-1]] * (width - len(clips))]
    begun = [_first(clip, config) for clip in full]
    firsts, givens = jax.tree.map(lambda *parts: np.stack(parts), *begun)
    state, pieces = _begin_many(run, config, firsts, givens), [[_framed(first)] for first, _ in begun[: len(clips)]]
    for at in range(1, max(len(clip.spectrum) for clip in clips), CHUNK):
        given = [_piece(clip, at, config) for clip in full]
        state, poses = advance_many(run, config, state, *(np.stack(parts, -1) for parts in zip(*given, strict=True)))
        poses = jax.device_get(poses)
        for number, clip in enumerate(clips):
            if at < len(clip.spectrum):
                pieces[number].append(jax.tree.map(lambda a, b=number: a[b], poses))
    return [_joined(parts, len(clip.spectrum)) for parts, clip in zip(pieces, clips, strict=True)]


@partial(jax.jit, static_argnames=("config",))
def _begin_many(run: Ready, config: ZeroEggsConfig, firsts: Pose, givens: Frame) -> State:
    return jax.vmap(partial(begin, run, config), out_axes=-1)(firsts, givens)


def _on_host(spectrum: Float[ArrayLike, "T F"], style: Float[ArrayLike, "T Z"], start: Motion) -> Told:
    """All as numpy: cutting there compiles nothing."""
    return Told(*jax.tree.map(lambda a: np.asarray(a, np.float32), (spectrum, style, start)))


def _first(told: Told, config: ZeroEggsConfig) -> tuple[Pose, Frame]:
    first = jax.tree.map(lambda a: a[0], told.start.pose)
    return first, Frame(np.zeros(config.speech.size, np.float32), told.style[0], told.start.gaze)


def _piece(told: Told, at: int, config: ZeroEggsConfig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spectrum, style and target of CHUNK frames from `at` on; what is beyond an end is the frame there."""
    last = len(told.spectrum) - 1
    around = np.arange(at - config.speech.behind, at + CHUNK + config.speech.ahead).clip(0, last)
    own = np.arange(at, at + CHUNK).clip(0, last)
    spectrum, style = np.asarray(told.spectrum), np.asarray(told.style)
    return spectrum[around], style[own], np.tile(told.start.gaze, (CHUNK, 1))


def _framed(pose: Pose) -> Pose:
    return jax.tree.map(lambda a: a[None], pose)


def _joined(pieces: list[Pose], frames: int) -> Pose:
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:frames], *pieces)
