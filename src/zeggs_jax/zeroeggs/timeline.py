"""Styles over time: timelines read, edited, made from sentences, and the embedding of every frame (Sec. 5.2.1)."""

import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..speech import transcript
from ..speech.transcript import Sentence
from . import style_space, timeline_text
from .cue import SAME, Cue, Curve, Number, Timeline, check, lasting

__all__ = ["Cue", "Curve", "Timeline", "by_sentence", "check", "names", "progress", "put", "read", "remove", "sequence"]
__all__ += ["shares", "shift", "spoken", "stretch", "write"]


def read(path: str | Path) -> Timeline:
    """A timeline from JSON, {"cues": [{"time": 0, "style": "old"}, ...]}, or CSV with the same columns.

    `style` is a name or a mix: {"old": 0.3, "happy": 0.7}, in CSV `0.3 old + 0.7 happy`.

    Raises:
        ValueError, OSError: whatever `check` refuses, unknown keys, values of another type; line or cue is named.
    """
    found = timeline_text.load(Path(path))
    cues = tuple(_cue(entry, where) for where, entry in found)
    return check(Timeline(cues), [where for where, _ in found])


def _cue(entry: Mapping[str, Any], where: str) -> Cue:
    for key in ("time", "transition", "intensity"):
        if type(entry.get(key, 0.0)) not in (int, float):
            raise ValueError(f"{where} has the {key} {entry[key]!r}; give a number.")
    style = entry["style"]
    mix = {style: 1.0} if isinstance(style, str) else style
    if not isinstance(mix, dict) or not all(type(weight) in (int, float) for weight in mix.values()):
        raise ValueError(f'{where} has the style {style!r}; give a name or a mix like {{"old": 0.3, "happy": 0.7}}.')
    if not isinstance(entry.get("curve", ""), str):
        raise ValueError(f"{where} has the curve {entry['curve']!r}; give one of {', '.join(get_args(Curve))}.")
    curve = entry.get("curve", Cue._field_defaults["curve"])
    if curve not in get_args(Curve):
        raise ValueError(f"{where} has the curve '{curve}'; give one of {', '.join(get_args(Curve))}.")
    numbers = {key: float(entry[key]) for key in ("transition", "intensity") if key in entry}
    return Cue(float(entry["time"]), tuple((n, float(w)) for n, w in mix.items()), curve=curve, **numbers)


def write(path: str | Path, timeline: Timeline) -> None:
    """Writes what `read` reads, as JSON or CSV, whole or not at all; defaults are left out.

    Raises:
        ValueError, OSError: whatever `check` refuses, another ending, a name that a CSV cannot hold.
    """
    defaults = Cue._field_defaults
    entries = []
    for cue in check(timeline).cues:
        style = cue.mix[0][0] if cue.mix[0][1] == 1.0 and len(cue.mix) == 1 else dict(cue.mix)
        rest = {key: value for key, value in cue._asdict().items() if key in defaults and value != defaults[key]}
        entries.append({"time": cue.time, "style": style, **rest})
    timeline_text.save(Path(path), entries)


def put(timeline: Timeline, cue: Cue) -> Timeline:
    """The timeline with a cue more, which takes the place of one at the same time; ValueError: what `check` refuses."""
    others = [other for other in timeline.cues if abs(other.time - cue.time) >= SAME]
    return check(Timeline(tuple(sorted([*others, cue], key=lambda one: one.time))))


def remove(timeline: Timeline, time: Number) -> Timeline:
    """The timeline without the cue at `time`; a ValueError where there is none, or for the one it begins with."""
    kept = tuple(cue for cue in timeline.cues if abs(cue.time - time) >= SAME)
    if len(kept) == len(timeline.cues):
        times = ", ".join(f"{cue.time:g}" for cue in timeline.cues)
        raise ValueError(f"there is no cue at {time:g} s; the cues are at {times} s.")
    if abs(time) < SAME:
        raise ValueError("the cue at 0 s is what the motion begins with; put another in its place instead.")
    return check(Timeline(kept))


def shift(timeline: Timeline, seconds: Number) -> Timeline:
    """All cues later (or earlier) by `seconds`, the first style held from 0.

    Earlier: what would begin before 0 is cut off, and the style of that time is there from the start.
    """
    moved = [cue._replace(time=cue.time + seconds) for cue in timeline.cues]
    first = max((k for k, cue in enumerate(moved) if cue.time <= SAME), default=0)
    return check(Timeline((moved[first]._replace(time=0.0), *moved[first + 1 :])))


def stretch(timeline: Timeline, factor: Number) -> Timeline:
    """Times and transitions multiplied by `factor`; a ValueError where that is not above 0."""
    if not 0 < factor < math.inf:
        raise ValueError(f"a timeline cannot be stretched by {factor:g}; give a number above 0.")
    cues = [cue._replace(time=cue.time * factor, transition=cue.transition * factor) for cue in timeline.cues]
    return check(Timeline(tuple(cues)))


def names(timeline: Timeline) -> tuple[str, ...]:
    """The styles of all cues, each once, in the order of their first appearance."""
    return tuple(dict.fromkeys(name for cue in timeline.cues for name, _ in cue.mix))


def spoken(path: str | Path) -> tuple[Sentence, ...]:
    """The sentences of a transcript with timed words; reads what `speech.transcript.read` does, with its errors."""
    return transcript.sentences(transcript.read(path))


def by_sentence(
    sentences: Sequence[Sentence],
    styles: Sequence[str] | Mapping[int, str],
    transition: Number = 1.0,
    curve: Curve = "smooth",
) -> Timeline:
    """A style for each sentence: `styles` in turn, or by the sentence's index (others keep the style before them).

    A style may be a mix, "0.3 old + 0.7 happy". Each transition lies in the middle of the pause between two sentences,
    and is shortened where sentences are shorter than it; with the curve 'hard' the styles switch there.

    Raises:
        ValueError: no sentences, no styles, an index that no sentence has, no style for the first sentence, or whatever
            `check` refuses.
    """
    if not sentences or not styles:
        raise ValueError(f"got {len(sentences)} sentences and {len(styles)} styles; give one or more of each.")
    chosen = dict(styles) if isinstance(styles, Mapping) else {}
    if not isinstance(styles, Mapping):
        chosen = {k: styles[k % len(styles)] for k in range(len(sentences))}
    if wrong := [k for k in chosen if not 0 <= k < len(sentences)]:
        raise ValueError(f"there is a style for sentence {wrong[0]}, but sentences go from 0 to {len(sentences) - 1}.")
    if 0 not in chosen:
        raise ValueError("there is no style for sentence 0; the motion must begin with one.")
    changes = [0]
    changes += [k for k in sorted(chosen) if k and chosen[k] != chosen[max(j for j in chosen if j < k)]]
    middles = [0.0] + [0.5 * (sentences[k - 1].end + sentences[k].start) for k in changes[1:]]
    cues = [Cue(0.0, _mix(chosen[0]), transition, curve)]
    for n in range(1, len(changes)):
        room = min(b - a for a, b in zip(middles[n - 1 : n + 1], middles[n : n + 2], strict=False))
        span = 0.0 if curve == "hard" else min(float(transition), room)
        cues.append(Cue(middles[n] - 0.5 * span, _mix(chosen[changes[n]]), span, curve))
    return check(Timeline(tuple(cues)))


def _mix(text: str) -> tuple[tuple[str, float], ...]:
    return tuple(timeline_text.mix_of(text).items())


def shares(timeline: Timeline, frames: int, rate_hz: Number) -> Float[np.ndarray, "T K"]:
    """How much of each cue is in each frame: from 0 to 1, and 1 in sum.

    A cue's progress u is 10 u^3 - 15 u^4 + 6 u^5 when smooth, the path of least jerk between two points at rest
    (Flash & Hogan 1985), so that speed and acceleration begin and end with 0.
    """
    time = np.arange(frames) / rate_hz
    reached = [np.ones(frames), *(progress(cue, time) for cue in timeline.cues[1:]), np.zeros(frames)]
    return -np.diff(np.stack(reached, axis=1), axis=1)


def progress(cue: Cue, time: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    """How far the style has turned into the cue's at each time (s), from 0 to 1."""
    length = lasting(cue)
    if length < SAME:
        return (time >= cue.time - SAME).astype(np.float64)
    u = np.clip((time - cue.time) / length, 0.0, 1.0)
    return u if cue.curve == "linear" else u**3 * (10.0 - 15.0 * u + 6.0 * u * u)


def sequence(
    timeline: Timeline,
    embeddings: Mapping[str, Float[ArrayLike, " Z"]],
    centre: Float[ArrayLike, " Z"] | None,
    frames: int,
    rate_hz: Number,
) -> Float[Array, "T Z"]:
    """The embedding of every frame; `centre` is what intensity is measured from (None: no cue has another than 1).

    Raises:
        ValueError: whatever `check` refuses for this length, a style without embedding, intensity without a centre.
    """
    check(timeline, seconds=frames / rate_hz)
    points = jnp.stack([_point(cue, k, embeddings, centre) for k, cue in enumerate(timeline.cues, 1)])
    return jnp.asarray(shares(timeline, frames, rate_hz), jnp.float32) @ points


def _point(cue: Cue, number: int, embeddings: Mapping[str, Any], centre: Any) -> Float[Array, " Z"]:
    for name, _ in cue.mix:
        if name not in embeddings:
            near = difflib.get_close_matches(name, list(embeddings), n=3, cutoff=0.0)
            raise ValueError(f"cue {number} has the unknown style '{name}'; nearest: {', '.join(near)}.")
    mixed = style_space.blend(jnp.stack([embeddings[name] for name, _ in cue.mix]), [weight for _, weight in cue.mix])
    if cue.intensity == 1.0:
        return mixed
    if centre is None:
        raise ValueError(
            f"cue {number} has the intensity {cue.intensity:g}, which needs the centre of a library; give one."
        )
    return style_space.intensify(mixed, centre, cue.intensity)
