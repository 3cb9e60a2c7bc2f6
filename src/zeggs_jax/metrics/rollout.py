"""Measures of one rollout against the recording that it was given the speech and the first frame of."""

import numpy as np
from jaxtyping import Float

from ..motion import bvh
from ..motion.bvh import Clip
from . import kinematic, rhythm

HANDS = ("hips", "left_hand", "right_hand")  # roles that the measures of the hands need


def measure(made: Clip, recorded: Clip, energy: Float[np.ndarray, " T"]) -> dict[str, float]:
    """What a validation reports of T frames of the same skeleton; a measure that cannot be taken is left out.

    `position_cm`: mean distance of all joints from the recorded ones in the world; `jerk_ratio`: mean jerk, made over
    recorded (1 is natural, below is too smooth); `hand_speed_ratio`: the same of the hands' mean speed; `beat`: the
    correlation of the made hands' speed with the speech's energy, both smoothed; `beat_recorded`: the recorded hands'.
    """
    apart = kinematic.world_positions(made) - kinematic.world_positions(recorded)
    values = {"position_cm": float(np.linalg.norm(apart, axis=-1).mean())}
    if len(apart) > 3 and (jerk := kinematic.mean_jerk(recorded)) > 0.0:
        values["jerk_ratio"] = kinematic.mean_jerk(made) / jerk
    roles = made.skeleton.roles
    if roles is None or any(getattr(roles, name) is None for name in HANDS):
        return values
    rate_hz = bvh.rate_hz(made.frame_time)
    ours, theirs = kinematic.hand_speed(made), kinematic.hand_speed(recorded)
    if theirs.mean() > 0.0:
        values["hand_speed_ratio"] = float(ours.mean() / theirs.mean())
    spoken = rhythm.smooth(np.asarray(energy, np.float64), rate_hz)
    for name, speed in (("beat", ours), ("beat_recorded", theirs)):
        values[name] = rhythm.correlation(rhythm.smooth(speed, rate_hz), spoken)
    return values
