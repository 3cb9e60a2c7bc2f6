"""A cue, at which the style begins to turn into another, and what makes a timeline of cues playable."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

Curve = Literal["smooth", "linear", "hard"]  # minimum jerk; constant rate; the release's switch
Number = float | int
SAME = 1e-6  # s: times closer than this are one


class Cue(NamedTuple):
    """From `time` on the style turns into `mix`; it is there after `transition`."""

    time: Number  # s
    mix: tuple[tuple[str, Number], ...]  # (style, weight); the weights sum to 1
    transition: Number = 1.0  # s; of no meaning in the first cue and with the curve 'hard'
    curve: Curve = "smooth"
    intensity: Number = 1.0  # 0: the centre of all styles; 1: the mix; above: exaggerated


class Timeline(NamedTuple):
    """Cues in the order of their times; the first is at 0."""

    cues: tuple[Cue, ...]


def check(timeline: Timeline, places: Sequence[str] = (), seconds: Number | None = None) -> Timeline:
    """The same timeline, if it can be played; `places` say where each cue stands, for the sentences.

    Raises:
        ValueError: no cue, the first not at 0, times that do not grow, a transition that reaches into the next,
            numbers that are negative or not finite, weights that do not sum to 1, an unknown curve, or a cue after
            the end of a speech of `seconds`.
    """
    if not timeline.cues:
        raise ValueError("the timeline has no cues; give at least one, at time 0.")
    places = places or [f"cue {k} of the timeline" for k in range(1, len(timeline.cues) + 1)]
    for cue, place in zip(timeline.cues, places, strict=True):
        _check_cue(cue, place)
        if seconds is not None and cue.time >= seconds:
            raise ValueError(f"{place} is at {cue.time:g} s, but the speech ends at {seconds:g} s; leave it out.")
    if timeline.cues[0].time > 0:
        raise ValueError(f"{places[0]} is at {timeline.cues[0].time:g} s; the first one must be at 0 s.")
    for k in range(1, len(timeline.cues)):
        before, cue = timeline.cues[k - 1], timeline.cues[k]
        if cue.time - before.time < SAME:
            raise ValueError(f"{places[k]} is at {cue.time:g} s, after one at {before.time:g} s; sort them by time.")
        end = before.time + lasting(before) * (k > 1)
        if end > cue.time + SAME:
            raise ValueError(
                f"{places[k]} is at {cue.time:g} s, within the transition before it, which ends at {end:g} s; "
                "shorten that transition or move the cue."
            )
    return timeline


def _check_cue(cue: Cue, place: str) -> None:
    for name, value in (("time", cue.time), ("transition", cue.transition), ("intensity", cue.intensity)):
        if not 0 <= value < math.inf:
            raise ValueError(f"{place} has the {name} {value:g}; give a number from 0 up.")
    if cue.curve not in get_args(Curve):
        raise ValueError(f"{place} has the curve '{cue.curve}'; give one of {', '.join(get_args(Curve))}.")
    names, weights = [name for name, _ in cue.mix], [weight for _, weight in cue.mix]
    if not names or not all(names) or len(set(names)) < len(names):
        raise ValueError(f"{place} has the styles {names}; name one style or more, each once.")
    if not abs(sum(weights) - 1.0) <= 1e-3:  # NaN too
        raise ValueError(f"{place} has weights that sum to {sum(weights):g}; give weights that sum to 1.")


def lasting(cue: Cue) -> float:
    """Seconds that the cue takes to be there; 0 for the curve 'hard'."""
    return 0.0 if cue.curve == "hard" else float(cue.transition)
