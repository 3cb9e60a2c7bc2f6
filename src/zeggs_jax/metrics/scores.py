"""The measures of a report: of one clip, of a clip beside the recorded one, of a group beside the recorded ones."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from . import accuracy, beats, coverage, diversity, feet, kinematic, movement, rhythm
from .beats import Times
from .feet import Ground
from .movement import Movement

Better = Literal["low", "high", "as the truth", "beside"]  # "beside": no good or bad, it is read beside another


class Sample(NamedTuple):
    """One clip of a report; what is unknown of its speech is None, and what needs it is left out."""

    name: str
    motion: Movement
    speech: str  # the name of the recorded clip whose speech it goes with; samples of one speech share it
    style: str | None = None
    onsets: Times | None = None  # s, of the speech
    stresses: Times | None = None  # s, of stressed words
    energy: Float[np.ndarray, " T"] | None = None  # of the speech, in every frame


class Measure(NamedTuple):
    """What a figure is in."""

    unit: str
    better: Better
    text: str
    ideal: float | None = None  # what the truth would have of itself, where that is the same for all


MEASURES: dict[str, Measure] = {
    "fgd": Measure("", "low", "Frechet gesture distance on the frozen net's features"),
    "frechet_postures": Measure("cm^2", "low", "Frechet distance of postures"),
    "frechet_velocities": Measure("(cm/s)^2", "low", "Frechet distance of velocities"),
    "hellinger_speed": Measure("", "low", "Hellinger distance of the distributions of speed"),
    "hellinger_acceleration": Measure("", "low", "the same of acceleration"),
    "hellinger_jerk": Measure("", "low", "the same of jerk"),
    "recognised": Measure("share", "high", "clips recognised as their style; the truth's own accuracy is the most"),
    "diversity": Measure("", "as the truth", "mean distance of the style statistics of two clips"),
    "multimodality": Measure("", "beside", "the same of two samples for one speech in one style"),
    "canonical": Measure("r", "high", "canonical correlation of made and recorded hands, fitted on the other clips"),
    "ape": Measure("cm", "low", "average position error, from the hips, both in their mean heading"),
    "ave": Measure("cm^2", "low", "average variance error, likewise"),
    "pck": Measure("share", "high", "joints within 10 cm of the recorded ones, likewise"),
    "coverage_dice": Measure("", "high", "overlap of the areas that gestures cover"),
    "coverage_area": Measure("", "as the truth", "covered area over the recorded one's", 1.0),
    "speed": Measure("cm/s", "as the truth", "mean speed of the major joints"),
    "acceleration": Measure("cm/s^2", "as the truth", "mean acceleration of the major joints"),
    "jerk": Measure("cm/s^3", "as the truth", "mean jerk of the major joints"),
    "l1": Measure("cm", "as the truth", "mean distance of coordinates from the clip's mean, from the hips"),
    "skate": Measure("cm/s", "low", "horizontal speed of feet that stand"),
    "floating": Measure("share", "low", "frames with both feet above the ground"),
    "sunk": Measure("cm", "low", "mean depth of feet below the ground"),
    "energy": Measure("r", "high", "correlation of hand speed and speech energy"),
    "energy_chance": Measure("r", "beside", "the same with the speech moved in time"),
    "beat_consistency": Measure("", "as the truth", "nearness of the speech's onsets to beats of the hands"),
    "beat_consistency_chance": Measure("", "beside", "the same with the speech moved in time"),
    "beat_alignment": Measure("", "high", "nearness of beats of the hands to the speech's onsets"),
    "beat_alignment_chance": Measure("", "beside", "the same with the speech moved in time"),
    "stress": Measure("", "high", "nearness of stressed words to strokes of the hands"),
    "stress_chance": Measure("", "beside", "the same with the speech moved in time"),
}


def of_clip(sample: Sample, ground: Ground | None) -> dict[str, Callable[[], dict[str, float]]]:
    """What is measured of a clip alone: by the first measure's name, a call that gives one or more."""
    motion, body = sample.motion, movement.from_hips
    scores: dict[str, Callable[[], dict[str, float]]] = {
        "speed": lambda: _dynamics(motion),
        "l1": lambda: {"l1": diversity.l1(body(motion))},
    }
    if ground is not None:
        scores["skate"] = lambda: _skate(feet.measure(motion, ground))
        scores["floating"] = lambda: _off_ground(feet.measure(motion, ground))
    if sample.energy is not None:
        energy = sample.energy
        scores["energy"] = lambda: _beside_chance(
            "energy", rhythm.agreement(_hand_speed(motion), energy, motion.rate_hz)
        )
    if sample.onsets is not None:
        onsets = sample.onsets
        scores["beat_consistency"] = lambda: _with_speech(motion, onsets)
    if sample.stresses is not None:
        stresses = sample.stresses
        scores["stress"] = lambda: _beside_chance("stress", beats.with_stresses(motion, stresses).agreement)
    return scores


def of_pair(made: Movement, truth: Movement) -> dict[str, Callable[[], dict[str, float]]]:
    """What is measured of a clip beside the recorded one of the same speech; the longer one is cut to the shorter.

    Both are turned to their mean heading: where a body looks is given to it (its first pose), not made.
    """
    frames = min(len(made.positions), len(truth.positions))
    ours, theirs = (m._replace(positions=m.positions[:frames]) for m in (made, truth))

    @cache
    def turned() -> tuple[Movement, Movement]:
        return movement.in_heading(ours), movement.in_heading(theirs)

    return {
        "ape": lambda: {"ape": accuracy.ape(*turned())},
        "ave": lambda: {"ave": accuracy.ave(*turned())},
        "pck": lambda: {"pck": accuracy.pck(*turned())},
        "coverage_dice": lambda: _coverage(ours, theirs),
    }


def hands(motion: Movement) -> Float[np.ndarray, "_ 6"]:
    """Both hands' positions from the hips, cm, in the clip's heading."""
    body = movement.from_hips(movement.in_heading(motion))
    joints = [body.skeleton.role(hand) for hand in ("left_hand", "right_hand")]
    return body.positions[:, joints].reshape(len(body.positions), -1)


def shared(samples: Sequence[Sample]) -> list[list[int]]:
    """Numbers of the samples of each speech in one style that has two or more, cut to the smallest number of them."""
    asked = [(sample.speech, sample.style or "") for sample in samples]
    groups = [[k for k, other in enumerate(asked) if other == one] for one in sorted(set(asked))]
    groups = [group for group in groups if len(group) > 1]
    least = min(map(len, groups), default=0)
    return [group[:least] for group in groups]


def _skate(found: feet.Feet) -> dict[str, float]:
    if not found.standing > 0.0:
        raise ValueError("no foot of it ever stands on the recorded clips' ground, so none can skate; see 'floating'.")
    return {"skate": found.skate}


def _off_ground(found: feet.Feet) -> dict[str, float]:
    return {"floating": found.floating, "sunk": found.sunk}


def _dynamics(motion: Movement) -> dict[str, float]:
    found = kinematic.dynamics(motion, movement.major(motion.skeleton))
    return {"speed": found.speed.mean, "acceleration": found.acceleration.mean, "jerk": found.jerk.mean}


def _coverage(made: Movement, truth: Movement) -> dict[str, float]:
    found = coverage.compare(made, truth)
    return {"coverage_dice": found.dice, "coverage_area": found.area}


def _hand_speed(motion: Movement) -> Float[np.ndarray, " T"]:
    body = movement.from_hips(motion).positions
    joints = [motion.skeleton.role(hand) for hand in ("left_hand", "right_hand")]
    return kinematic.speeds(body[:, joints], motion.rate_hz).mean(axis=1)


def _with_speech(motion: Movement, onsets: Times) -> dict[str, float]:
    consistent, aligned = beats.with_speech(motion, onsets)
    return {**_beside_chance("beat_consistency", consistent), **_beside_chance("beat_alignment", aligned)}


def _beside_chance(name: str, found: rhythm.Agreement) -> dict[str, float]:
    return {name: found.matched, f"{name}_chance": found.shifted}
