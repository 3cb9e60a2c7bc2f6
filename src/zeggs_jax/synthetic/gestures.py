"""Style factors and prosody to a 75-joint clip: hands, head, trunk, breath, weight, on planted feet."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from zeggs_jax.motion import bvh
from zeggs_jax.synthetic import meanings, rig, strokes
from zeggs_jax.synthetic.lexicon import Meant
from zeggs_jax.synthetic.prosody import Prosody
from zeggs_jax.synthetic.styles import StyleFactors

STANDING = -1.0  # cm, hips of a standing body below straight legs


def _pulses(time: Float[np.ndarray, " T"], prosody: Prosody, rise: float, fall: float) -> Float[np.ndarray, " T"]:
    """A bump on every stress, as high as the stress is strong, topping at the middle of the vowel."""
    wave = np.zeros_like(time)
    for when, strength in zip(prosody.time.tolist(), prosody.strength.tolist(), strict=True):
        up = strokes.minimum_jerk((time - when + rise) / rise)
        down = strokes.minimum_jerk((time - when) / fall)
        wave = np.maximum(wave, strength * (up - down))
    return wave


def _shifts(time: Float[np.ndarray, " T"], prosody: Prosody, seconds: float) -> Float[np.ndarray, " T"]:
    """-1 or 1: the side that bears the weight, changing slowly when speech sets in after a pause."""
    side, wave = 1.0, np.ones_like(time)
    starts, ends = prosody.phrases[1:, 0].tolist(), prosody.phrases[:-1, 1].tolist()
    for end, start in zip(ends, starts, strict=True):
        if start - end >= strokes.SPEECH_GAP:
            wave = wave - 2.0 * side * strokes.minimum_jerk((time - start + 0.1) / seconds)
            side = -side
    return wave


def _speaking(time: Float[np.ndarray, " T"], prosody: Prosody) -> Float[np.ndarray, " T"]:
    """1 while a phrase lasts, 0 in pauses, with soft edges."""
    wave = np.zeros_like(time)
    for start, end in prosody.phrases.tolist():
        rise = strokes.minimum_jerk((time - start + 0.2) / 0.4)
        wave = np.maximum(wave, rise - strokes.minimum_jerk((time - end + 0.1) / 0.5))
    return wave


def _stack(*columns: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T N"]:
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _clavicles(
    style: StyleFactors, hands: Float[np.ndarray, "T 2 5"], breath: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T 2 2"]:
    """Shoulders: the style's, a little with the breath, and higher with a raised arm."""
    raised = strokes.minimum_jerk((hands[..., 1] + 12.0) / 50.0)
    lift = style.shoulders / 14.0 + 0.35 * raised + 0.018 * breath[:, None]
    forward = 0.08 * max(-style.shoulders, 0.0) / 2.5 + 0.03 * max(style.shoulders, 0.0) / 2.5
    forward = forward + 0.10 * strokes.minimum_jerk((hands[..., 2] - 20.0) / 30.0)
    return np.stack([lift, forward], axis=-1)


def _wrists(hands: Float[np.ndarray, "T 2 5"], rate_hz: float | int) -> Float[np.ndarray, "T 2"]:
    """Wrist flexion: the hand trails behind the forearm when it rises or falls."""
    speed = np.gradient(hands[..., 1], axis=0) * rate_hz
    kernel = np.hanning(max(3, int(0.2 * rate_hz)) + 2)
    kernel /= kernel.sum()
    trail = np.stack([np.convolve(speed[:, k], kernel, mode="same") for k in range(2)], axis=-1)
    return 0.35 * np.tanh(0.008 * trail) - 0.08


def _breath(time: Float[np.ndarray, " T"], style: StyleFactors, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(swing of the hips, breath), -1..1; the seed says where they begin."""
    sway_phase, breath_phase = np.random.default_rng([seed, 11]).uniform(0.0, 2.0 * np.pi, 2)
    swing = np.sin(2.0 * np.pi * time * 0.28 * np.sqrt(style.tempo) + sway_phase)
    return swing, np.sin(2.0 * np.pi * time * 0.25 * np.sqrt(style.tempo) + breath_phase)


class _Stand(NamedTuple):
    """How the body stands and weighs, by the style of one of its halves."""

    bow: Float[np.ndarray, " T"]  # rad, trunk forward
    aside: Float[np.ndarray, " T"]  # cm, hips to the left
    low: Float[np.ndarray, " T"]  # cm, hips above straight legs
    back: Float[np.ndarray, " T"]  # cm, hips forward: behind the feet, as the trunk bows and the knees bend
    turn: Float[np.ndarray, " T"]  # rad, trunk to the left
    breath: Float[np.ndarray, " T"]


def _stand(time: Float[np.ndarray, " T"], prosody: Prosody, style: StyleFactors, seed: int) -> _Stand:
    swing, breath = _breath(time, style, seed)
    beat, talk = _pulses(time, prosody, 0.16, 0.28), _speaking(time, prosody)
    weight = _shifts(time, prosody, 1.1 / np.sqrt(style.tempo))
    vigour = style.amplitude / 24.0
    bow = style.lean + 0.06 * vigour * beat + 0.02 * talk * vigour
    aside = style.sway * swing + (0.8 + 0.45 * style.sway) * weight
    turn = 0.07 * (0.3 + vigour) * weight * talk
    low = STANDING - style.crouch - 0.5 * vigour * beat - aside**2 / 160.0
    return _Stand(bow, aside, low, -0.1 * style.crouch - 14.0 * np.sin(bow), turn, breath)


def perform(
    prosody: Prosody,
    style: StyleFactors,
    frames: int,
    rate_hz: float | int = 30,
    seed: int = 0,
    lower: StyleFactors | None = None,
    meant: Sequence[Meant] = (),
) -> bvh.Clip:
    """Gesture to `prosody` in `style` for `frames` frames: the release's hierarchy, facing +Z at the origin.

    `seed` only sets where sway and breath begin, and how the signs vary; everything else follows from style and
    speech. Hips and legs are of the style `lower`, where given; the words `meant` get their gestures (`meanings`).
    ValueError for no frames or a rate that is not positive.
    """
    if frames < 1 or rate_hz <= 0:
        raise ValueError(f"a performance of {frames} frames at {rate_hz} Hz is impossible; ask for 1 or more.")
    time = np.arange(frames) / rate_hz
    upper = _stand(time, prosody, style, seed)
    stands = upper if lower is None else _stand(time, prosody, lower, seed)
    bow = upper.bow if lower is None else 0.30 * stands.bow + 0.70 * upper.bow
    home = strokes.stance(style)
    hands = strokes.follow(strokes.schedule(prosody, style), home, time)
    beat, talk = _pulses(time, prosody, 0.16, 0.28), _speaking(time, prosody)
    bounce = style.amplitude * beat[:, None] * np.array([1.0 - 0.8 * style.asymmetry, 1.0])[None]
    hands[..., 1] -= 0.16 * bounce  # every stress shows, also where no stroke fits
    hands[..., 2] += 0.08 * bounce
    over = meanings.overlay(meant, style, time, seed)
    hands = meanings.hands(over, hands)
    tilt = 0.02 * stands.aside
    nod = style.nodding * beat
    tracks = rig.Tracks(
        hips=_stack(stands.aside, stands.low, stands.back),
        pelvis=_stack(0.30 * stands.bow, 0.3 * stands.turn, -0.5 * tilt),
        spine=_stack(0.70 * upper.bow - 0.012 * upper.breath, upper.turn, 0.9 * tilt),
        neck=meanings.necks(over, _stack(style.head_pitch - bow + nod - 0.03 * talk, -0.6 * upper.turn, -0.8 * tilt)),
        clavicle=_clavicles(style, hands, upper.breath),
        hand=hands[..., :3],
        palm=hands[..., 3],
        wrist=meanings.wrists(over, _wrists(hands, rate_hz)),
        curl=hands[..., 4],
        spread=np.full((frames, 2), 0.02 + 0.12 * style.openness),
        point=meanings.points(over, frames),
    )
    return rig.pose(tracks, round(1.0 / rate_hz, 6))
