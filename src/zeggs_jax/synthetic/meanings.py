"""Gestures that mean something: what hands and head do at a word, laid over the beats of `gestures`.

Phases as McNeill 1992 and Kendon 1980: preparation before the word, the stroke on its nucleus, a hold, the release.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from zeggs_jax.synthetic.lexicon import Meant
from zeggs_jax.synthetic.strokes import minimum_jerk
from zeggs_jax.synthetic.styles import StyleFactors

PREPARATION = 0.6  # s at tempo 1, before the stroke begins
STROKE = 0.3  # s, around the nucleus
LEAD = 0.16  # s of the stroke before the nucleus
RELEASE = 0.65  # s
ROUNDABOUT = 7.0  # cm, hands pass that much further forward on their way, round the body
Goal = tuple[float, float, float, float, float]  # outward, up, forward (cm from the shoulder), palm, curl (rad)
Way = tuple[float, float, float]  # outward, up, forward, cm
NOWHERE: Way = (0.0, 0.0, 0.0)
RIGHT = (0.0, 1.0)  # the right hand only


class Sign(NamedTuple):
    """One meaning's gesture. Hands are (left, right); a hand whose `shares` is 0 goes on with what it does."""

    ready: tuple[Goal, Goal]  # where the preparation leads
    stroke: tuple[Goal, Goal]  # where the stroke ends and is held
    shares: tuple[float, float] = (1.0, 1.0)
    hold: float = 0.35  # s after the stroke
    wrist: tuple[float, float] = (-0.08, -0.08)  # rad, flexion (negative: bent back)
    point: tuple[float, float] = (0.0, 0.0)  # 1 stretches the index finger
    swing: tuple[Way, Way] = (NOWHERE, NOWHERE)  # cm to and fro
    turns: float = 0.0  # periods of the swing (of hands and head) from the stroke on
    circle: float = 0.0  # cm, radius of a ring drawn in the frontal plane: the two hands draw a half each
    nod: float = 0.0  # rad, dip of the head to and fro
    shake: float = 0.0  # rad, turn of the head to and fro
    look: float = 0.0  # rad, head down (negative: up) while it lasts


def _both(outward: float, up: float, forward: float, palm: float, curl: float) -> tuple[Goal, Goal]:
    goal = (outward, up, forward, palm, curl)
    return goal, goal


SIGNS: Mapping[str, Sign] = MappingProxyType(
    {
        "big": Sign(_both(2.0, -14.0, 34.0, 0.0, 0.25), _both(36.0, -8.0, 27.0, 0.1, 0.1), hold=0.45),
        "small": Sign(_both(8.0, -4.0, 36.0, 0.0, 0.4), _both(-1.5, -6.0, 38.0, 0.0, 0.75), hold=0.45, look=0.1),
        "round": Sign(_both(0.0, 6.0, 36.0, -0.2, 0.35), _both(0.0, -28.0, 36.0, 0.5, 0.35), circle=19.0, hold=0.25),
        "up": Sign(_both(8.0, -8.0, 34.0, -0.2, 0.5), _both(9.0, 44.0, 18.0, -0.2, 0.5), RIGHT, point=RIGHT, look=-0.3),
        "down": Sign(
            _both(9.0, -4.0, 32.0, -1.0, 0.15), _both(11.0, -42.0, 26.0, -1.0, 0.12), wrist=(-0.6, -0.6), look=0.2,
        ),
        "far": Sign(
            _both(-2.0, -6.0, 32.0, -0.6, 0.6), _both(40.0, 10.0, 30.0, -0.6, 0.6), RIGHT, point=RIGHT, hold=0.5
        ),
        "you": Sign(_both(3.0, -16.0, 26.0, -0.3, 0.7), _both(0.0, -5.0, 52.0, -0.3, 0.9), RIGHT, point=RIGHT),
        "me": Sign(_both(2.0, -16.0, 24.0, 0.0, 0.3), _both(-11.0, -17.0, 15.0, 0.0, 0.2), RIGHT, hold=0.45, look=0.08),
        "many": Sign(
            _both(2.0, -16.0, 36.0, 0.9, 0.25), _both(15.0, -20.0, 36.0, 1.1, 0.15),
            swing=((3.0, -9.0, 0.0), (3.0, 9.0, 0.0)), turns=2.0, hold=0.9,
        ),
        "no": Sign(
            _both(6.0, -2.0, 38.0, -0.4, 0.5), _both(9.0, 0.0, 40.0, -0.6, 0.15), RIGHT, wrist=(-0.08, -0.6),
            swing=(NOWHERE, (11.0, 0.0, 0.0)), turns=2.5, shake=0.30, hold=0.9,
        ),
        "yes": Sign(
            _both(6.0, -20.0, 34.0, 0.0, 1.2), _both(5.0, -27.0, 38.0, 0.0, 1.3), RIGHT,
            swing=(NOWHERE, (0.0, 8.0, 0.0)), turns=2.5, nod=0.34, hold=0.9,
        ),
        "stop": Sign(
            _both(5.0, -6.0, 28.0, -0.8, 0.1), _both(3.0, 3.0, 47.0, -1.0, 0.05), wrist=(-1.1, -1.1), hold=0.55,
        ),
    }
)  # fmt: skip


class Overlay(NamedTuple):
    """What the meanings of a speech ask for, frame by frame; `blend` lays it over hands that do something else."""

    layers: tuple["_Layer", ...]


class _Layer(NamedTuple):
    share: Float[np.ndarray, "T 2"]  # 0 the hand is free .. 1 it is the sign's
    hand: Float[np.ndarray, "T 2 5"]
    wrist: Float[np.ndarray, " 2"]
    point: Float[np.ndarray, " 2"]
    neck: Float[np.ndarray, "T 3"]  # rad, added to pitch, yaw and roll


def overlay(meant: Sequence[Meant], style: StyleFactors, time: Float[np.ndarray, " T"], seed: int = 0) -> Overlay:
    """The signs of the words `meant` at the frames' times (s), in the manner of `style`; the seed varies them a little.

    Raises:
        ValueError: a meaning without a sign.
    """
    if unknown := sorted({one.meaning for one in meant} - set(SIGNS)):
        raise ValueError(f"there is no gesture that means {unknown[0]!r}; choose one of {', '.join(SIGNS)}.")
    draw = np.random.default_rng([seed, 59])
    jitter = draw.normal(0.0, 1.0, (len(meant), 2))
    following = [*(one.time for one in meant[1:]), np.inf][: len(meant)]
    layers = [
        _layer(SIGNS[one.meaning], one, style, time, later, some)
        for one, later, some in zip(meant, following, jitter, strict=True)
    ]
    return Overlay(tuple(layers))


def _layer(
    sign: Sign, one: Meant, style: StyleFactors, time: np.ndarray, following: float, jitter: Float[np.ndarray, " 2"]
) -> _Layer:
    """One sign: minimum-jerk moves there, through the stroke, and back; faster and larger as the style is."""
    pace = float(np.clip(style.tempo**0.5, 0.8, 1.2))
    begin = one.time - LEAD
    prepare, seconds = PREPARATION / pace, STROKE / pace
    hold = sign.hold / pace
    until = begin + seconds + hold
    if until > following - LEAD - 0.35:  # the next sign is due: leave early, never before the stroke is done
        until = max(following - LEAD - 0.35, begin + seconds)
    share = minimum_jerk((time - begin + prepare) / prepare) - minimum_jerk((time - until) / (RELEASE / pace))
    stroke = minimum_jerk((time - begin) / seconds)
    ready, struck = _in_manner(np.array(sign.ready), style, jitter), _in_manner(np.array(sign.stroke), style, jitter)
    hand = ready[None] + stroke[:, None, None] * (struck - ready)[None]
    if sign.circle:
        hand = hand + _ring(sign, ready, struck, time - begin + 0.1, pace, stroke)
    wave = _to_and_fro(time - begin, until - begin, sign.turns)
    hand[..., :3] += wave[:, None, None] * np.array(sign.swing)[None]
    hand[..., 2] += ROUNDABOUT * (4.0 * share * (1.0 - share))[:, None]
    nod = sign.look * share + sign.nod * wave
    neck = np.stack([nod, sign.shake * wave, np.zeros_like(nod)], axis=-1)
    shares = np.array(sign.shares)
    return _Layer(share[:, None] * shares[None], hand, np.array(sign.wrist), shares * np.array(sign.point), neck)


def _in_manner(goal: Float[np.ndarray, "2 5"], style: StyleFactors, jitter: Float[np.ndarray, " 2"]) -> np.ndarray:
    """The goal a little higher, wider and livelier in styles that are so, and never twice the same."""
    high = float(np.clip((style.hand_height + 25.0) / 40.0, -0.6, 1.0))
    wide = float(np.clip(style.radius - 0.45, -0.45, 0.55))
    moved = goal + np.array([2.0 * wide, 3.0 * high, 0.0, 0.0, 0.0])[None]
    moved[:, :3] += np.array([0.8, 1.2, 0.8])[None] * np.array([jitter[0], jitter[1], 0.5 * jitter[0]])[None]
    return moved


def _ring(
    sign: Sign, ready: np.ndarray, struck: np.ndarray, since: np.ndarray, pace: float, stroke: np.ndarray
) -> Float[np.ndarray, "T 2 5"]:
    """What to add to the straight way from `ready` to `struck` so that it becomes half a ring, outward and down."""
    progress = minimum_jerk(since * pace / 0.9)
    offset = np.zeros((len(since), 2, 5))
    straight = ready[None, :, 1] + stroke[:, None] * (struck - ready)[None, :, 1]
    middle = 0.5 * (ready + struck)[None, :, 1]
    offset[..., 0] = sign.circle * np.sin(np.pi * progress)[:, None]
    offset[..., 1] = middle + sign.circle * np.cos(np.pi * progress)[:, None] - straight
    return offset


def _to_and_fro(since: Float[np.ndarray, " T"], lasting: float, turns: float) -> Float[np.ndarray, " T"]:
    """A sine of `turns` periods while the stroke and its hold last, with soft ends; 0 where nothing swings."""
    if not turns:
        return np.zeros_like(since)
    ends = minimum_jerk(since / 0.25) - minimum_jerk((since - lasting + 0.25) / 0.25)
    return ends * np.sin(2.0 * np.pi * turns * np.clip(since / lasting, 0.0, 1.0))


def hands(over: Overlay, hand: Float[np.ndarray, "T 2 5"]) -> Float[np.ndarray, "T 2 5"]:
    """`hand` with the signs laid over it, later ones over earlier ones: as smooth as both."""
    for layer in over.layers:
        hand = hand + layer.share[..., None] * (layer.hand - hand)
    return hand


def wrists(over: Overlay, wrist: Float[np.ndarray, "T 2"]) -> Float[np.ndarray, "T 2"]:
    """`wrist` flexion with the signs' laid over it."""
    for layer in over.layers:
        wrist = wrist + layer.share * (layer.wrist[None] - wrist)
    return wrist


def points(over: Overlay, frames: int) -> Float[np.ndarray, "T 2"]:
    """How far each index finger is stretched, 0..1."""
    point = np.zeros((frames, 2))
    for layer in over.layers:
        point = point + layer.share * (layer.point[None] - point)
    return point


def necks(over: Overlay, neck: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T 3"]:
    """`neck` with the signs' nods, shakes and looks added."""
    for layer in over.layers:
        neck = neck + layer.neck
    return neck
