"""What is read straight off a moving body, on any skeleton: speed of the root, height and reach of the hands, lean."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from zeggs_jax.metrics import kinematic, movement
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.motion.bvh import Clip

Curve = Float[np.ndarray, " T"]


class Gauge(NamedTuple):
    """One measure as it runs over time; its mean is what stands for the clip."""

    text: str
    unit: str
    curve: Curve


def read(clip: Clip, settle: float = 0.0) -> dict[str, Gauge]:
    """All gauges of a clip, the first `settle` seconds left out, in the body's mean heading."""
    motion = movement.of(clip)
    motion = motion._replace(positions=motion.positions[round(settle * motion.rate_hz) :])
    body, skeleton = movement.in_heading(motion).positions, motion.skeleton
    hips, head = body[:, skeleton.role("hips")], body[:, skeleton.role("head")]
    hands = body[:, [skeleton.role("left_hand"), skeleton.role("right_hand")]]
    shoulders = body[:, [_up(skeleton, skeleton.role(hand)) for hand in ("left_hand", "right_hand")]]
    trunk = shoulders.mean(axis=1) - hips
    return {
        "root speed": Gauge("speed of the root", "cm/s", root_speed(motion)),
        "hand height": Gauge("height of the hands above the shoulders", "cm", (hands - shoulders)[..., 1].mean(axis=1)),
        "hand reach": Gauge("hands before the shoulders", "cm", (hands - shoulders)[..., 2].mean(axis=1)),
        "hands apart": Gauge("distance between the hands", "cm", np.linalg.norm(hands[:, 0] - hands[:, 1], axis=-1)),
        "hand speed": Gauge("speed of the hands", "cm/s", _speed(hands - hips[:, None], motion.rate_hz).mean(axis=1)),
        "lean": Gauge("lean of the trunk", "degrees", np.degrees(np.arctan2(trunk[:, 2], trunk[:, 1]))),
        "head reach": Gauge("head before the hips", "cm", (head - hips)[:, 2]),
        "hips height": Gauge("height of the hips", "cm", hips[:, 1]),
    }


def means(clip: Clip, settle: float = 0.0) -> dict[str, float]:
    """The mean of every gauge."""
    return {name: float(gauge.curve.mean()) for name, gauge in read(clip, settle).items()}


def root_speed(motion: Movement) -> Curve:
    """Horizontal speed of the hips, cm/s: what Fig. 8b's root velocity is long."""
    hips = motion.positions[:, motion.skeleton.role("hips")]
    return kinematic.speeds(hips[:, None] * np.array([1.0, 0.0, 1.0]), motion.rate_hz)[:, 0]


def _speed(positions: Float[np.ndarray, "T J 3"], rate_hz: float) -> Float[np.ndarray, "T J"]:
    return kinematic.speeds(positions, rate_hz)


def _up(skeleton, hand: int) -> int:
    """The shoulder of an arm: two joints up from the hand."""
    return skeleton.parents[skeleton.parents[hand]]
