"""The rig: tracks of trunk, hands and fingers to the rotations of all 75 joints, feet staying where they stand."""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from zeggs_jax.geometry import quaternion
from zeggs_jax.motion import bvh
from zeggs_jax.synthetic import body, limbs

SIDES = (("Left", 1.0), ("Right", -1.0))
STANCE = 10.5  # cm, each foot beside the middle
TOES_OUT = 0.16  # rad
_ELBOW_POLE = (0.60, -0.65, -0.45)  # outward, up, forward
_BLOCK = 256  # frames solved at a time, so that one length is compiled


class Tracks(NamedTuple):
    """What the performer decides, frame by frame; two hands are (left, right). Angles in rad, lengths in cm."""

    hips: Float[np.ndarray, "T 3"]  # world, from the middle between the feet at standing height
    pelvis: Float[np.ndarray, "T 3"]  # pitch (forward), yaw (left), roll (to the right)
    spine: Float[np.ndarray, "T 3"]  # the same three, summed over the spine joints
    neck: Float[np.ndarray, "T 3"]  # and over neck and head
    clavicle: Float[np.ndarray, "T 2 2"]  # lifted, brought forward
    hand: Float[
        np.ndarray, "T 2 3"
    ]  # wrist from the shoulder joint: outward, up, forward, turned with the chest
    palm: Float[np.ndarray, "T 2"]  # 0 palms inward, positive turns them up
    wrist: Float[np.ndarray, "T 2"]  # flexion
    curl: Float[np.ndarray, "T 2"]  # bend of each finger joint
    spread: Float[np.ndarray, "T 2"]  # fingers apart


@cache
def _index() -> dict[str, int]:
    return {name: j for j, name in enumerate(body.rest_skeleton().names)}


def _turn(pitch: Array, yaw: Array, roll: Array) -> Float[Array, "T 4"]:
    return quaternion.from_euler(jnp.stack([yaw, pitch, roll], axis=-1), "yxz")


def _on_side(q: Float[Array, "T 4"], side: float) -> Float[Array, "T 4"]:
    """A rotation written for the left, mirrored when `side` is -1."""
    return q * jnp.array([1.0, 1.0, side, side], q.dtype)[None, :]


def _about(axis: int, angle: Float[Array, " T"]) -> Float[Array, "T 4"]:
    zero = jnp.zeros_like(angle)
    parts = [jnp.cos(0.5 * angle), zero, zero, zero]
    parts[1 + axis] = jnp.sin(0.5 * angle)
    return jnp.stack(parts, axis=-1)


def _trunk(tracks: Tracks) -> dict[str, Float[Array, "T 4"]]:
    local = {"Hips": _turn(*jnp.moveaxis(jnp.asarray(tracks.pelvis), -1, 0))}
    for names, track, shares in (
        (("Spine", "Spine1", "Spine2", "Spine3"), tracks.spine, (0.2, 0.25, 0.3, 0.25)),
        (("Neck", "Neck1", "Head"), tracks.neck, (0.35, 0.25, 0.4)),
    ):
        for name, share in zip(names, shares, strict=True):
            local[name] = _turn(*jnp.moveaxis(share * jnp.asarray(track), -1, 0))
    return local


def _chest(
    local: dict[str, Float[Array, "T 4"]], hips: Float[Array, "T 3"]
) -> tuple[Float[Array, "T 4"], Float[Array, "T 3"]]:
    """World rotation and position of Spine3."""
    rotation, position = local["Hips"], hips
    for name in ("Spine", "Spine1", "Spine2", "Spine3"):
        position = position + quaternion.rotate(rotation, _offset(name, rotation))
        rotation = quaternion.multiply(rotation, local[name])
    return rotation, position


def _offset(name: str, like: Array) -> Float[Array, "1 3"]:
    return jnp.asarray(body.rest_skeleton().offsets[_index()[name]], like.dtype)[None, :]


def _arm(
    tracks: Tracks, k: int, chest: Float[Array, "T 4"], origin: Float[Array, "T 3"]
) -> dict[str, Float[Array, "T 4"]]:
    """Clavicle, upper arm, forearm and hand of one side: the wrist goes where its track says."""
    name, side = SIDES[k]
    lift, forward = tracks.clavicle[:, k, 0], tracks.clavicle[:, k, 1]
    clavicle = _on_side(
        quaternion.multiply(_about(1, -jnp.asarray(forward)), _about(2, jnp.asarray(lift))), side
    )
    shoulder = quaternion.multiply(chest, clavicle)
    start = origin + quaternion.rotate(chest, _offset(f"{name}Shoulder", chest))
    start = start + quaternion.rotate(shoulder, _offset(f"{name}Arm", chest))
    heading = _about(1, jnp.asarray(tracks.pelvis[:, 1] + tracks.spine[:, 1]))
    outward = jnp.array([side, 1.0, 1.0], chest.dtype)[None, :]
    target = start + quaternion.rotate(heading, jnp.asarray(tracks.hand[:, k]) * outward)
    pole = quaternion.rotate(heading, jnp.array(_ELBOW_POLE, chest.dtype)[None, :] * outward)
    sides = jnp.full((1, 1), side, chest.dtype)
    limb = limbs.arm(start, target, pole, (body.UPPER_ARM, body.FOREARM), sides)
    palm = jnp.asarray(tracks.palm[:, k])
    bend = quaternion.multiply(quaternion.inverse(limb.upper), limb.lower)
    return {
        f"{name}Shoulder": clavicle,
        f"{name}Arm": quaternion.multiply(quaternion.inverse(shoulder), limb.upper),
        f"{name}ForeArm": quaternion.multiply(bend, _about(0, -0.8 * palm)),
        f"{name}Hand": quaternion.multiply(
            _about(0, -0.2 * palm), _on_side(_about(2, -jnp.asarray(tracks.wrist[:, k])), side)
        ),
    }


def _fingers(tracks: Tracks, k: int) -> dict[str, Float[Array, "T 4"]]:
    name, side = SIDES[k]
    curl, spread = jnp.asarray(tracks.curl[:, k]), jnp.asarray(tracks.spread[:, k])
    local = {}
    for finger, away, more in (
        ("Index", -1.0, 0.85),
        ("Middle", -0.2, 0.95),
        ("Ring", 0.6, 1.05),
        ("Pinky", 1.3, 1.1),
    ):
        for number, share in ((1, 0.8), (2, 1.2), (3, 0.8)):
            bend = _about(2, -share * more * curl)
            sideways = _about(1, away * spread) if number == 1 else _about(1, jnp.zeros_like(spread))
            local[f"{name}Hand{finger}{number}"] = _on_side(quaternion.multiply(sideways, bend), side)
    for number, share in ((1, 0.30), (2, 0.35), (3, 0.5)):
        inward = quaternion.multiply(_about(1, 0.8 * share * curl), _about(2, -0.35 * share * curl))
        local[f"{name}HandThumb{number}"] = _on_side(inward, side)
    return local


def _leg(k: int, pelvis: Float[Array, "T 4"], hips: Float[Array, "T 3"]) -> dict[str, Float[Array, "T 4"]]:
    """Thigh, shin and foot of one side: the ankle stays at its place on the ground, the foot flat."""
    name, side = SIDES[k]
    start = hips + quaternion.rotate(pelvis, _offset(f"{name}UpLeg", pelvis))
    ankle = jnp.array([side * STANCE, body.ANKLE, 0.0], pelvis.dtype)[None, :]
    pole = jnp.array([side * 0.22, 0.0, 1.0], pelvis.dtype)[None, :]
    limb = limbs.leg(
        start,
        jnp.broadcast_to(ankle, start.shape),
        jnp.broadcast_to(pole, start.shape),
        (body.THIGH, body.SHIN),
    )
    flat = _about(1, jnp.full(start.shape[:1], side * TOES_OUT, pelvis.dtype))
    return {
        f"{name}UpLeg": quaternion.multiply(quaternion.inverse(pelvis), limb.upper),
        f"{name}Leg": quaternion.multiply(quaternion.inverse(limb.upper), limb.lower),
        f"{name}Foot": quaternion.multiply(quaternion.inverse(limb.lower), flat),
    }


@jax.jit
def _solve(tracks: Tracks) -> tuple[Float[Array, "T J 3"], Float[Array, "T 3"]]:
    """(Euler angles zyx of every joint, rad; world position of the hips, cm)."""
    hips = jnp.asarray(tracks.hips) + jnp.array([0.0, body.HIPS_HEIGHT, 0.0])[None, :]
    local = _trunk(tracks)
    pelvis = local["Hips"]
    chest, origin = _chest(local, hips)
    for k in range(2):
        local |= _arm(tracks, k, chest, origin) | _fingers(tracks, k) | _leg(k, pelvis, hips)
    still = jnp.zeros_like(pelvis).at[:, 0].set(1.0)
    rotations = jnp.stack([local.get(name, still) for name in _index()], axis=1)
    return quaternion.to_euler(rotations, "zyx"), hips


def pose(tracks: Tracks, frame_time: float) -> bvh.Clip:
    """The clip in which the body follows `tracks`: rotations zyx, hips moving, all other joints at their offsets."""
    frames = len(tracks.hips)
    padding = -frames % _BLOCK
    with jax.enable_x64(True):
        padded = Tracks(
            *(np.concatenate([t, np.repeat(t[-1:], padding, axis=0)]).astype(np.float64) for t in tracks)
        )
        blocks = [_solve(Tracks(*(t[k : k + _BLOCK] for t in padded))) for k in range(0, frames, _BLOCK)]
        euler, hips = (
            np.concatenate([np.asarray(part) for part in parts]) for parts in zip(*blocks, strict=True)
        )
    skeleton = body.rest_skeleton()
    positions = np.repeat(skeleton.offsets[None].astype(np.float64), frames, axis=0)
    positions[:, 0] = hips[:frames]
    return bvh.Clip(
        skeleton=skeleton,
        orders=("zyx",) * len(skeleton),
        euler=euler[:frames].astype(np.float32),
        positions=positions.astype(np.float32),
        frame_time=frame_time,
    )
