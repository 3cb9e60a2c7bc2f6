"""Speech in bit by bit, poses out as soon as they are certain: `generate` for a recording that is still going on.

    samples -> resampled -> feature rows -> encoded with their look-ahead -> decoded, in the style of the moment

A frame waits for the speech that the encoder sees ahead of it (15 frames with the paper's kernel of 31: 250 ms at 60
Hz), for half a window of its spectrum (25 ms) and for the next spectrum (less than 12.5 ms): `StreamSession.latency`.
Two ways to wait less: a model trained to look less far ahead (`SpeechEncoderConfig.lookahead`), or `lookahead` here,
with which any model takes the last row that it knows for all that follow. It costs accuracy, as the model has not
learnt it: movements set in later and softer, as speech that comes is seen only when it is there.
Whole-file loudness is not known while a recording goes on: give it (`loudness`), or the loudness so far is levelled.
"""

from typing import Any, NamedTuple

import jax
import numpy as np
import soxr
from jaxtyping import Array, Float

from ..motion import bvh
from ..motion import pose as poses
from ..motion.pose import Pose, Root
from ..nn.reduced import Precision
from ..speech import live
from . import steering, synthesis
from . import timeline as timelines
from .decoder import Frame
from .folded import CHUNK
from .model import Model
from .steering import Request
from .style_clip import Entry
from .timeline import Cue, Curve

Style = str | Request | np.ndarray | Array
NAMELESS = (("style", 1.0),)
LONGEST_S = 1e6  # of a transition
ENDED = "the stream was flushed and takes no more; begin a new StreamSession."


class Latency(NamedTuple):
    """Seconds of speech after a frame's own time that have to be there before it comes out."""

    least: float
    most: float


class StreamSession:
    """One body that gestures to one voice; memory does not grow, however long it goes on.

    `frame` is the number of the next pose (its time is frame / rate), `dropped` how many were left out, `clipped` how
    many samples were at full scale or beyond. After a ValueError a session goes on as if the call had not been made;
    only motion that is not finite, which a broken checkpoint makes, ends it.
    """

    def __init__(
        self,
        model: Model,
        style: Style = "neutral",
        *,
        first_pose: str | None = None,
        lookahead: int | None = None,
        loudness: float | int | None = None,
        rate_hz: float | int | None = None,
        precision: Precision = "float32",
    ):
        """Makes all ready, so that the first push is as fast as the next ones.

        Args:
            model: from `load_model`.
            style: a name, a clip or a `Request` of mixed styles; an embedding [Z] needs `first_pose`.
            first_pose: a .bvh whose first frame the body starts from.
            lookahead: frames of speech that the encoder sees ahead, at most those of its config, which are the default.
            loudness: of the whole speech in LUFS, where it is known; None levels the loudness so far.
            rate_hz: of the samples; None: the model's own, 16 kHz.
            precision: of the decoder's weights, as for `generate`.

        Raises:
            ValueError, OSError: as `generate` for styles and first poses; a look-ahead, loudness or rate out of range.
        """
        ahead = model.config.speech.ahead
        self.model, self.lookahead = model, ahead if lookahead is None else lookahead
        if not 0 <= self.lookahead <= ahead:
            raise ValueError(f"the look-ahead is {self.lookahead} frames; this model sees 0 to {ahead} frames ahead.")
        if loudness is not None and not -70.0 <= loudness <= 20.0:
            raise ValueError(f"the loudness is {loudness:g} LUFS; give that of the speech, from -70 to 20.")
        self.rate = bvh.rate_hz(model.config.frame_time)
        self.frame = self.dropped = self.clipped = 0
        own_hz = model.config.features.rate_hz
        self._voice_hz = _rate(own_hz if rate_hz is None else rate_hz)
        self._resampler = self._new_resampler(self._voice_hz)
        self._features = live.LiveFeatures(self.rate, model.config.features, loudness)
        self._rows = np.zeros((0, model.config.features.size), np.float32)  # from `frame - behind` on
        self._ended = False
        request, chosen, point = self._read(style)
        self._style = self._from = point
        self._cue = Cue(0.0, NAMELESS, 0.0)
        if first_pose is not None:
            request = request._replace(first_pose=first_pose)
        start = steering.starting_pose(request, chosen, model)
        self.first = jax.tree.map(lambda a: np.asarray(a, np.float32)[0], start.pose)
        self._target = np.asarray(start.gaze, np.float32)
        self._run, self._state = synthesis.ready(model, precision), None
        self._warm()

    @property
    def latency(self) -> Latency:
        """From the config; resampling adds up to 0.05 s of its own to samples of another rate than the model's."""
        least, most = live.delay_s(self.rate, self.model.config.features)
        return Latency(self.lookahead / self.rate + least, self.lookahead / self.rate + most)

    def push(
        self, samples: Float[np.ndarray, " n"] | Any, rate_hz: float | int | None = None, most: int | None = None
    ) -> Pose:
        """Samples of one channel, float within [-1, 1] or int16 -> the k poses that they complete, as numpy arrays.

        Args:
            samples: [n], any n.
            rate_hz: where it is another than before, from this sample on.
            most: no more poses than these; what is due beyond is dropped from the front, whole, so that a session
                that came late is in time again. The body goes on from where it was.

        Raises:
            ValueError: samples of another shape or type, not finite, a rate out of range, or a stream that has ended.
        """
        if self._ended:
            raise ValueError(ENDED)
        wave, rate = checked(samples), _rate(self._voice_hz if rate_hz is None else rate_hz)
        if most is not None and most < 0:
            raise ValueError(f"at most {most} frames were asked for; give 0 or more.")
        self.clipped += int(np.count_nonzero(np.abs(wave) >= CLIPPED))
        if rate != self._voice_hz:
            rest = self._resampled(np.zeros(0, np.float32), last=True)
            self._voice_hz, self._resampler = rate, self._new_resampler(rate)
            wave = np.concatenate([rest, self._resampled(wave)])
        else:
            wave = self._resampled(wave)
        return self._perform(self._features.hear(wave), self.lookahead, most)

    def gap(self, seconds: float | int, most: int | None = None) -> Pose:
        """Speech that was lost: as much silence, so that what follows keeps its time."""
        if not 0 <= seconds < np.inf:
            raise ValueError(f"a gap of {seconds:g} s was told; give 0 or more.")
        return self.push(np.zeros(round(seconds * self._voice_hz), np.float32), most=most)

    def flush(self) -> Pose:
        """The speech has ended: the poses that waited for more of it. Nothing can be pushed after that."""
        if self._ended:
            raise ValueError(ENDED)
        rows = self._features.hear(self._resampled(np.zeros(0, np.float32), last=True))
        rows = np.concatenate([rows, self._features.finish()])
        self._ended = True
        return self._perform(rows, 0, None)

    def set_style(self, style: Style, transition_s: float | int = 1.0, curve: Curve = "smooth") -> None:
        """From the next pose on the style turns into another, as a `Cue` does, from wherever it is now.

        A clip takes its time to be read: `embedding` does that ahead of time, in another thread if need be.
        """
        if not 0 <= transition_s <= LONGEST_S:
            raise ValueError(f"the transition is {str(transition_s)[:20]} s; give 0 to {LONGEST_S:g}.")
        cue = timelines.check(timelines.Timeline((Cue(0.0, NAMELESS, transition_s, curve),))).cues[0]
        to = self.embedding(style)
        self._from = self._styles(np.array([self.frame]))[0]
        self._style, self._cue = to, cue._replace(time=self.frame / self.rate)

    def embedding(self, style: Style) -> Float[np.ndarray, " Z"]:
        """A style as a point of the model's style space; changes nothing.

        Raises:
            ValueError, OSError: as `generate`; a request with styles over time; a point that is not of this model.
        """
        return self._read(style)[2]

    def _read(self, style: Style) -> tuple[Request, list[Entry], np.ndarray]:
        """What is asked for, its styles as they were read, and the point that they make."""
        if not isinstance(style, str | Request):
            point, size = np.asarray(style), self.model.config.style_size
            with np.errstate(over="ignore"):
                finite = np.issubdtype(point.dtype, np.floating) and np.isfinite(point.astype(np.float32)).all()
            if point.shape != (size,) or not finite:
                raise ValueError(
                    f"the style is {point.dtype} of shape {point.shape}; this model's are {size} finite numbers."
                )
            return Request(), [], np.asarray(point, np.float32)
        request = style if isinstance(style, Request) else Request(styles=(style,))
        if request.timeline is not None or request.spans:
            raise ValueError("a stream has one style at a time; leave timeline and spans out and use set_style.")
        space = steering.read_space(request, self.model)
        chosen = steering.read_styles(request, self.model, space)
        sequence = steering.style_sequence(request, chosen, 1, self.rate, space)
        return request, chosen, np.asarray(sequence, np.float32)[0]

    def _new_resampler(self, rate_hz: float) -> soxr.ResampleStream | None:
        own = self.model.config.features.rate_hz
        return None if rate_hz == own else soxr.ResampleStream(rate_hz, own, 1, dtype="float32", quality="HQ")

    def _resampled(self, wave: np.ndarray, last: bool = False) -> np.ndarray:
        return wave if self._resampler is None else self._resampler.resample_chunk(wave, last=last)

    def _styles(self, frames: np.ndarray) -> Float[np.ndarray, "K Z"]:
        """The style of some frames."""
        share = timelines.progress(self._cue, frames / self.rate).astype(np.float32)[:, None]
        return (1.0 - share) * self._from + share * self._style

    def _perform(self, rows: Float[np.ndarray, "k F"], ahead: int, most: int | None) -> Pose:
        """Takes rows in; gives the poses that have `ahead` rows after them."""
        sees = self.model.config.speech
        if rows.size and not self._rows.size:
            rows = np.concatenate([np.repeat(rows[:1], sees.behind, axis=0), rows])
        self._rows = np.concatenate([self._rows, rows])
        due = max(len(self._rows) - sees.behind - ahead, 0)
        late = 0 if most is None else max(due - most, 0)
        self._pass(late)
        self.dropped += late
        pieces = [_empty(self.model)]
        if self._state is None and due > late:
            pieces.append(self._begin())
        end = self.frame + len(self._rows) - sees.behind - ahead
        while self.frame < end:
            whole = end - self.frame >= CHUNK and self.lookahead == sees.ahead
            pieces.append(self._advance(CHUNK if whole else 1))
        made = jax.tree.map(lambda *parts: np.concatenate(parts), *pieces)
        if not all(np.isfinite(part).all() for part in jax.tree.leaves(made)):
            self._ended = True
            raise ValueError("the model made motion that is not finite; check its checkpoint and the style.")
        return made

    def _pass(self, frames: int) -> None:
        self.frame += frames
        self._rows = self._rows[frames:]

    def _begin(self) -> Pose:
        style = self._styles(np.array([self.frame]))[0]
        given = Frame(np.zeros(self.model.config.speech.size, np.float32), style, self._target)
        self._state = synthesis.begin(self._run, self.model.config, self.first, given)
        self._pass(1)
        return jax.tree.map(lambda a: a[None], self.first)

    def _advance(self, frames: int) -> Pose:
        """Some frames on; what the encoder would see behind the look-ahead is the last row within it."""
        sees = self.model.config.speech
        known = min(frames - 1 + sees.behind + self.lookahead, len(self._rows) - 1)
        seen = np.minimum(np.arange(frames + sees.kernel - 1), known)
        style = self._styles(self.frame + np.arange(frames))
        target = np.tile(self._target, (frames, 1))
        state, made = synthesis.advance(self._run, self.model.config, self._state, self._rows[seen], style, target)
        self._state = state
        self._pass(frames)
        return jax.tree.map(np.asarray, made)

    def _warm(self) -> None:
        """Compiles, or reads from the cache, what every push runs."""
        self._rows = np.zeros((self.model.config.speech.kernel + 1, self.model.config.features.size), np.float32)
        self._begin()
        self._advance(1)
        self._rows, self._state, self.frame = self._rows[:0], None, 0


CLIPPED = 32767 / 32768  # what 16 bits can hold


def checked(samples: Any) -> Float[np.ndarray, " n"]:
    """Samples as float32, or a ValueError that says what came; int16 is full at 32768."""
    wave = np.asarray(samples)
    if wave.ndim != 1:
        raise ValueError(f"samples of shape {wave.shape} were pushed; give one channel, [n] (mix several down).")
    if wave.dtype == np.int16:
        return wave.astype(np.float32) / 32768.0
    if not np.issubdtype(wave.dtype, np.floating):
        raise ValueError(f"samples of type {wave.dtype} were pushed; give floats within [-1, 1], or int16.")
    with np.errstate(over="ignore"):
        wave = wave.astype(np.float32)
    if not np.isfinite(wave).all():
        raise ValueError("the samples pushed have values that are NaN or infinite; none of them was taken.")
    return wave


def _rate(rate_hz: float | int) -> float:
    if not 1000 <= rate_hz <= 400_000:
        raise ValueError(f"the samples' rate is {rate_hz:g} Hz; give one from 1000 to 400000 Hz.")
    return float(rate_hz)


def _empty(model: Model) -> Pose:
    numbers = np.zeros((0, model.config.vector_size), np.float32)
    root: Any = np.zeros((0, 3), np.float32), np.zeros((0, 4), np.float32)
    return poses.from_vector(numbers, Root(*root))
