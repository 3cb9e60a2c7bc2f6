"""How far human joints turn: ranges of active motion as data, and the share of frames outside them."""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from zeggs_jax.geometry import quaternion
from zeggs_jax.motion import bvh
from zeggs_jax.synthetic import body

Span = tuple[int, int]  # degrees


class Range(NamedTuple):
    """Limits of one joint in degrees: Euler angles in `order`, counted from `centre` (same order)."""

    order: str
    spans: tuple[Span, Span, Span]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)


def _spine(pitch: Span, roll: int, yaw: int) -> Range:
    return Range("xzy", (pitch, (-roll, roll), (-yaw, yaw)))


# Written for the left side, counted from the T-pose (bones of the arm along +X, of the leg along -Y).
# Rounded outward from the usual clinical tables of active motion; the spine's are shared by four joints.
RANGES: dict[str, Range] = {
    "Spine": _spine((-20, 30), 16, 16),
    "Spine1": _spine((-20, 30), 16, 16),
    "Spine2": _spine((-20, 30), 16, 16),
    "Spine3": _spine((-20, 30), 16, 16),
    "Neck": _spine((-35, 30), 22, 35),
    "Neck1": _spine((-35, 30), 22, 35),
    "Head": _spine((-35, 35), 22, 40),
    "Shoulder": Range("yzx", ((-35, 20), (-15, 45), (-25, 25))),
    # y: 0 sideways .. -90 forward; z: -90 hanging .. 90 up; x: turn about the bone
    "Arm": Range("zyx", ((-75, 125), (-80, 75), (-110, 110)), (-45.0, -30.0, 0.0)),
    "ForeArm": Range("yzx", ((-158, 6), (-15, 15), (-100, 100))),
    "Hand": Range("zyx", ((-85, 80), (-40, 40), (-50, 50))),
    "UpLeg": Range("xzy", ((-125, 30), (-35, 50), (-50, 50))),
    "Leg": Range("xzy", ((-5, 150), (-12, 12), (-35, 35))),
    "Foot": Range("xzy", ((-55, 55), (-40, 40), (-45, 45))),
    "ToeBase": Range("xzy", ((-65, 50), (-20, 20), (-20, 20))),
    "HandThumb1": Range("yzx", ((-45, 60), (-60, 40), (-50, 50))),
    "HandThumb2": Range("yzx", ((-45, 75), (-60, 30), (-35, 35))),
    "HandThumb3": Range("yzx", ((-30, 95), (-60, 30), (-35, 35))),
    **{f"Hand{f}1": Range("zyx", ((-100, 40), (-30, 30), (-25, 25))) for f in ("Index", "Middle", "Ring", "Pinky")},
    **{f"Hand{f}2": Range("zyx", ((-120, 12), (-15, 15), (-15, 15))) for f in ("Index", "Middle", "Ring", "Pinky")},
    **{f"Hand{f}3": Range("zyx", ((-95, 20), (-15, 15), (-15, 15))) for f in ("Index", "Middle", "Ring", "Pinky")},
}


class _Table(NamedTuple):
    joints: tuple[int, ...]
    centre: Float[np.ndarray, "K 4"]
    low: Float[np.ndarray, "K 3"]  # rad
    high: Float[np.ndarray, "K 3"]


def _rows(order: str) -> list[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
    """(joint, centre, low, high) in degrees of all joints with this order; right ones mirrored in x."""
    rows = []
    for j, name in enumerate(body.rest_skeleton().names):
        side = -1.0 if name.startswith("Right") else 1.0
        found = RANGES.get(name.removeprefix("Left").removeprefix("Right"))
        if found is None or found.order != order:
            continue
        sign = np.array([1.0 if axis == "x" else side for axis in order])
        ends = np.array(found.spans).T * sign[None, :]
        rows.append((j, np.array(found.centre) * sign, ends.min(axis=0), ends.max(axis=0)))
    return rows


@cache
def _tables() -> dict[str, _Table]:
    tables = {}
    for order in sorted({r.order for r in RANGES.values()}):
        joints, centre, low, high = zip(*_rows(order), strict=True)
        with jax.ensure_compile_time_eval():
            turns = np.asarray(quaternion.from_euler(np.radians(np.array(centre)), order))
        tables[order] = _Table(joints, turns, np.radians(np.array(low)), np.radians(np.array(high)))
    return tables


def excess(local: Float[Array, "T J 4"]) -> Float[Array, "T J"]:
    """Radians by which each of the 75 joints leaves its range (0 inside; ends and hips have none)."""
    worst = jnp.zeros(local.shape[:2], local.dtype)
    for order, table in _tables().items():
        turned = quaternion.multiply(quaternion.inverse(table.centre)[None], local[:, np.array(table.joints)])
        angles = quaternion.to_euler(turned, order)
        over = jnp.maximum(angles - table.high[None], table.low[None] - angles).max(axis=-1)
        worst = worst.at[:, np.array(table.joints)].set(jnp.maximum(over, 0.0))
    return worst


def joints_outside_range(clip: bvh.Clip) -> dict[str, float]:
    """Share of frames (0..1) in which each joint is outside its human range, of those that ever are."""
    outside = np.asarray(_outside(clip))
    return {clip.skeleton.names[j]: float(share) for j, share in enumerate(outside.mean(axis=0)) if share > 0}


def share_outside_range(clip: bvh.Clip) -> float:
    """Share of frames (0..1) in which any joint is outside its human range.

    For clips on the release's hierarchy with a T-pose at rest, such as the synthetic ones and those
    generated from them. ValueError names the first joint that differs.
    """
    return float(np.asarray(_outside(clip)).any(axis=1).mean())


def _outside(clip: bvh.Clip) -> Array:
    expected = body.rest_skeleton().names
    for j, name in enumerate(expected):
        if j >= len(clip.skeleton.names) or clip.skeleton.names[j] != name:
            raise ValueError(
                f"human ranges are known for the {len(expected)}-joint reference hierarchy, whose joint {j} "
                f"is '{name}', and this clip's is not; retarget it first."
            )
    euler = jnp.asarray(clip.euler)
    local = jnp.stack([quaternion.from_euler(euler[:, j], order) for j, order in enumerate(clip.orders)], axis=1)
    return jax.jit(excess)(local) > 0
