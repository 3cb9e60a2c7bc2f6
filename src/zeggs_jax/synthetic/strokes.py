"""Gesture phases (McNeill 1992): preparation, stroke on the stressed syllable, hold, retraction."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from zeggs_jax.synthetic.prosody import Prosody
from zeggs_jax.synthetic.styles import StyleFactors

LONGEST_LEAD = 0.25  # s, a stroke begins at most this long before the middle of its vowel
REBOUND = 0.2  # s
SPEECH_GAP = 0.45  # s; hands go to rest in longer pauses


class Stance(NamedTuple):
    """Where the hands are between gestures: outward, up, forward (cm from the shoulder), palm, curl (rad)."""

    rest: Float[np.ndarray, "2 5"]
    centre: Float[np.ndarray, "2 5"]


class Phase(NamedTuple):
    """One movement of both hands from wherever they were bound to `goal`; between two phases they hold."""

    kind: str  # preparation, stroke, rebound or retraction
    start: float  # s
    seconds: float
    goal: Float[np.ndarray, "2 5"]


def minimum_jerk(u: Float[np.ndarray, "*b"]) -> Float[np.ndarray, "*b"]:
    """Progress 0..1 of the smoothest rest-to-rest movement (Flash and Hogan 1985) at relative time u."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def _ramp(value: float, low: float, high: float) -> float:
    u = min(max((value - low) / (high - low), 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)


def stance(style: StyleFactors) -> Stance:
    """Resting place and gesture space: low hands rest at the thighs, high ones up, narrow ones in front."""
    palm = -0.9 + 1.2 * style.openness
    curl = float(np.interp(style.openness, (0.0, 0.5, 1.0), (1.15, 0.42, 0.12)))
    up, front = _ramp(style.hand_height, -48.0, -16.0), 0.9 * _ramp(0.35 - style.radius, 0.0, 0.35)
    near = max(up, 0.6)  # hands never drop all the way: they would have to travel in the pauses
    forward = (20.0 + 17.0 * style.radius) * (0.5 + 0.5 * _ramp(style.hand_height, -50.0, -26.0))
    forward = max(forward, 18.0 * front)  # crossed arms go round the belly
    centre = np.array([-5.5 + 13.5 * style.radius, style.hand_height, forward, palm, curl])
    hanging = np.array([4.0, -53.0, 4.0, 0.15, 0.6 * curl + 0.15])
    share = np.array([max(up, front), near, max(near, front), max(up, 0.7 * front), up])
    rest = hanging + 0.9 * share * (centre - hanging)
    leaving = min(style.amplitude / 12.0, 1.0)  # who hardly gestures hardly leaves the rest
    centre = rest + leaving * (centre - rest)
    return Stance(np.repeat(rest[None], 2, axis=0), np.repeat(centre[None], 2, axis=0))


def select(prosody: Prosody, style: StyleFactors) -> tuple[Float[np.ndarray, " K"], Float[np.ndarray, " K"]]:
    """(times in s, strengths) of stresses that get a stroke: loudest within a gap, longer if slow."""
    gap = float(np.clip(0.42 / style.tempo, 0.3, 0.6))
    kept: list[int] = []
    for i in np.argsort(-prosody.strength, kind="stable").tolist():
        if prosody.strength[i] > 0.45 and all(abs(prosody.time[i] - prosody.time[k]) >= gap for k in kept):
            kept.append(i)
    kept.sort()
    return prosody.time[kept], prosody.strength[kept]


def _goals(
    style: StyleFactors, home: Stance, strength: float, inward: bool, leader: int
) -> tuple[np.ndarray, np.ndarray]:
    """Goals of the preparation (raised) and of the stroke (down and, every other time, outward)."""
    size = style.amplitude * strength
    hands = np.array([1.0 - style.asymmetry, 1.0]) * (1.0 + np.array([0.12, -0.12]) * (1 if leader == 0 else -1))
    raised = np.array([-0.15, 0.45, -0.15, 0.0, 0.0]) * size
    struck = np.array([-0.15 if inward else 0.55, -0.42, 0.25, 0.0, 0.0]) * size
    struck[3:] = 0.55 * style.openness * strength, -0.25 * home.centre[0, 4] * strength
    lazy = home.rest + np.clip(1.6 * hands, 0.0, 1.0)[:, None] * (home.centre - home.rest)
    return lazy + hands[:, None] * raised[None, :], lazy + hands[:, None] * struck[None, :]


def _pauses(prosody: Prosody) -> list[tuple[float, float]]:
    ends = [*prosody.phrases[:, 0].tolist()[1:], prosody.seconds + 10.0]
    gaps = zip(prosody.phrases[:, 1].tolist(), ends, strict=True) if len(prosody.phrases) else ()
    return [(end, following) for end, following in gaps if following - end >= SPEECH_GAP]


def _time_to_prepare(
    prosody: Prosody, style: StyleFactors, when: float, begin: float, free: float, rested: bool
) -> float:
    """Seconds left to raise the hands before a stroke; from rest they wait for the voice."""
    quick = float(np.sqrt(style.tempo))
    if not rested:
        return min(max(begin - free, 0.12), 0.3 / quick)
    onset = float(prosody.phrases[prosody.phrases[:, 0] <= when, 0].max(initial=-9.0)) - 0.12
    return min(max(begin - max(free, onset), 0.0), 0.42 / quick)


def schedule(prosody: Prosody, style: StyleFactors) -> list[Phase]:
    """Every movement of the hands, in order of time.

    A stroke surrounds its stress: it begins at most 0.25 s before the middle of the vowel and is fastest
    there. The leading hand alternates from pause to pause, as the weight does, the direction from stroke to
    stroke, so both can be read off the pose.
    """
    home = stance(style)
    times, strengths = select(prosody, style)
    pauses = _pauses(prosody)
    seconds = float(np.clip((0.36 - 0.14 * style.jerkiness) / np.sqrt(style.tempo), 0.2, 0.45))
    lead = min(LONGEST_LEAD, 0.55 * seconds)
    phases: list[Phase] = []
    inward, leader, free = False, 0, -10.0  # `free`: when the hands have finished what they do
    for when, strength in zip(times.tolist(), strengths.tolist(), strict=True):
        rested = not phases or phases[-1].kind == "retraction"
        raised, struck = _goals(style, home, strength, inward, leader)
        begin = when - lead
        ready = _time_to_prepare(prosody, style, when, begin, free, rested)
        if ready > 0.1:  # else the stroke itself leaves the rest: hands wait for the voice
            phases.append(Phase("preparation", begin - ready, ready, raised))
        phases.append(Phase("stroke", begin, seconds, struck))
        free = begin + seconds
        following = times[np.searchsorted(times, when, "right") :]
        if style.jerkiness > 0.05 and not np.any(following < free + REBOUND + LONGEST_LEAD + 0.12):
            back = struck + 0.3 * style.jerkiness * (raised - struck)
            phases.append(Phase("rebound", free, REBOUND, back))
            free += REBOUND
        inward = not inward
        pause = next((p for p in pauses if p[0] >= when - 0.15), None)
        if pause is not None and not np.any(following < pause[1] - 0.05):
            start = max(free, pause[0] - 0.2)
            phases.append(Phase("retraction", start, 0.5 / style.tempo**0.35, home.rest))
            inward, leader, free = False, 1 - leader, start + 0.3
    return phases


def follow(phases: Sequence[Phase], home: Stance, time: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T 2 5"]:
    """Both hands through time: minimum-jerk moves from goal to goal, summed, smooth where they overlap."""
    path = np.repeat(home.rest[None], len(time), axis=0)
    goal = home.rest
    for phase in phases:
        progress = minimum_jerk((time - phase.start) / phase.seconds)
        path = path + progress[:, None, None] * (phase.goal - goal)[None]
        goal = phase.goal
    return path
