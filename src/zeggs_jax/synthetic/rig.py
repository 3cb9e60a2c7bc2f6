"""The rig: tracks of trunk, hands and fingers to the rotations of all joints, feet staying in place."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from zeggs_jax.geometry import quaternion
from zeggs_jax.motion import bvh
from zeggs_jax.synthetic import body, limbs

SIDES = ("Left", "Right")
STANCE = 10.5  # cm, each foot beside the middle
TOES_OUT = 0.16  # rad
POINTED = 0.06  # rad, curl of a stretched index finger
_ELBOW = (0.55, -0.70, -0.45)  # where elbows point: outward, up, forward
_ELBOW_HANGING = (0.25, -0.30, -0.90)  # and below low hands
_BLOCK = 256  # frames solved at a time, so that one length is compiled
Values = np.ndarray | Array


class Tracks(NamedTuple):
    """What the performer decides, frame by frame; hands are (left, right). Angles in rad, lengths in cm."""

    hips: Float[Values, "T 3"]  # world, from the middle between the feet at standing height
    pelvis: Float[Values, "T 3"]  # pitch (forward), yaw (left), roll (to the right)
    spine: Float[Values, "T 3"]  # the same three, summed over the spine joints
    neck: Float[Values, "T 3"]  # and over neck and head
    clavicle: Float[Values, "T 2 2"]  # lifted, brought forward
    hand: Float[Values, "T 2 3"]  # wrist from the shoulder joint: outward, up, forward, turned with the chest
    palm: Float[Values, "T 2"]  # 0 palms inward, positive turns them up
    wrist: Float[Values, "T 2"]  # flexion
    curl: Float[Values, "T 2"]  # bend of each finger joint
    spread: Float[Values, "T 2"]  # fingers apart
    point: Float[Values, "T 2"]  # 0 the index finger bends as the others .. 1 it is stretched


_OUTWARD = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])  # written for the left; the right is mirrored in x
_MIRRORED = np.array([[1.0, 1.0, 1.0, 1.0], [1.0, 1.0, -1.0, -1.0]])  # the same for quaternions
_SPINE, _NECK = ("Spine", "Spine1", "Spine2", "Spine3"), ("Neck", "Neck1", "Head")
_ARM, _LEG = ("Shoulder", "Arm", "ForeArm", "Hand"), ("UpLeg", "Leg", "Foot")
_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")
# Shares of the curl and of the spread in each finger's three joints; thumbs curl inward instead of spreading.
_BEND = np.array([[0.1, 0.12, 0.17], *(np.outer((0.85, 0.95, 1.05, 1.1), (0.8, 1.2, 0.8)))])
_INWARD = np.array([[0.24, 0.28, 0.4], *np.zeros((4, 3))])
_INDEX = np.repeat([0.0, 1.0, 0.0, 0.0, 0.0], 3)
_SPREAD = np.array([[0.0, 0.0, 0.0], *(np.outer((-1.0, -0.2, 0.6, 1.3), (1.0, 0.0, 0.0)))])


def _turn(angles: Float[Array, "*b 3"]) -> Float[Array, "*b 4"]:
    """Pitch, yaw, roll to a rotation."""
    return quaternion.from_euler(angles[..., jnp.array([1, 0, 2])], "yxz")


def _about(axis: int, angle: Float[Values, "*b"]) -> Float[Array, "*b 4"]:
    angle = jnp.asarray(angle)
    zero = jnp.zeros_like(angle)
    parts = [jnp.cos(0.5 * angle), zero, zero, zero]
    parts[1 + axis] = jnp.sin(0.5 * angle)
    return jnp.stack(parts, axis=-1)


def _offset(name: str) -> Float[Array, "3"]:
    skeleton = body.rest_skeleton()
    return jnp.asarray(skeleton.offsets[skeleton.index(name)])


def _offsets(part: str) -> Float[Array, "1 2 3"]:
    return jnp.stack([_offset(side + part) for side in SIDES])[None]


def _trunk(tracks: Tracks) -> Float[Array, "T 8 4"]:
    """Hips, spine, neck and head, in the order of the hierarchy."""
    shares = jnp.array([0.2, 0.25, 0.3, 0.25])[None, :, None], jnp.array([0.35, 0.25, 0.4])[None, :, None]
    angles = [tracks.pelvis[:, None], shares[0] * tracks.spine[:, None], shares[1] * tracks.neck[:, None]]
    return _turn(jnp.concatenate(angles, axis=1))


def _chest(trunk: Float[Array, "T 8 4"], hips: Float[Array, "T 3"]) -> tuple[Array, Array]:
    """World rotation [T, 4] and position [T, 3] of Spine3."""
    rotation, position = trunk[:, 0], hips
    for k, name in enumerate(_SPINE):
        position = position + quaternion.rotate(rotation, _offset(name)[None])
        rotation = quaternion.multiply(rotation, trunk[:, 1 + k])
    return rotation, position


def _pole(height: Float[Array, "T 2"]) -> Float[Array, "T 2 3"]:
    """Direction of the elbow for a hand at `height` cm above the shoulder, before turning with the chest."""
    u = jnp.clip((height + 52.0) / 24.0, 0.0, 1.0)[..., None]
    raised, hanging = (jnp.array(p)[None, None] for p in (_ELBOW, _ELBOW_HANGING))
    return (hanging + u * u * (3.0 - 2.0 * u) * (raised - hanging)) * _OUTWARD[None]


def _arms(tracks: Tracks, chest: Float[Array, "T 4"], origin: Float[Array, "T 3"]) -> Float[Array, "T 2 4 4"]:
    """Clavicles, upper arms, forearms and hands: the wrists go where their tracks say."""
    lift, forward = tracks.clavicle[..., 0], tracks.clavicle[..., 1]
    clavicle = quaternion.multiply(_about(1, -forward), _about(2, lift)) * _MIRRORED[None]
    chest, origin = chest[:, None], origin[:, None]
    shoulder = quaternion.multiply(chest, clavicle)
    start = origin + quaternion.rotate(chest, _offsets("Shoulder"))
    start = start + quaternion.rotate(shoulder, _offsets("Arm"))
    heading = _about(1, tracks.pelvis[:, 1] + tracks.spine[:, 1])[:, None]
    target = start + quaternion.rotate(heading, tracks.hand * _OUTWARD[None])
    pole = quaternion.rotate(heading, _pole(jnp.asarray(tracks.hand[..., 1])))
    limb = limbs.arm(start, target, pole, (body.UPPER_ARM, body.FOREARM), jnp.array([[[1.0], [-1.0]]]))
    bend = quaternion.multiply(quaternion.inverse(limb.upper), limb.lower)
    wrist = quaternion.multiply(_about(0, -0.2 * tracks.palm), _about(2, -tracks.wrist) * _MIRRORED[None])
    upper = quaternion.multiply(quaternion.inverse(shoulder), limb.upper)
    forearm = quaternion.multiply(bend, _about(0, -0.8 * tracks.palm))
    return jnp.stack([clavicle, upper, forearm, wrist], axis=2)


def _fingers(tracks: Tracks) -> Float[Array, "T 2 15 4"]:
    """Three joints of each finger from the thumb on."""
    curl, spread = tracks.curl[..., None], tracks.spread[..., None]
    sideways = _SPREAD.reshape(1, 1, -1) * spread + _INWARD.reshape(1, 1, -1) * curl
    bent = curl - jnp.asarray(tracks.point)[..., None] * _INDEX[None, None] * (curl - POINTED)
    bend = -_BEND.reshape(1, 1, -1) * bent
    return quaternion.multiply(_about(1, sideways), _about(2, bend)) * _MIRRORED[None, :, None]


def _legs(pelvis: Float[Array, "T 4"], hips: Float[Array, "T 3"]) -> Float[Array, "T 2 3 4"]:
    """Thighs, shins and feet: the ankles stay at their places on the ground, the feet flat."""
    pelvis = pelvis[:, None]
    start = hips[:, None] + quaternion.rotate(pelvis, _offsets("UpLeg"))
    ankles = jnp.array([[[STANCE, body.ANKLE, 0.0]]]) * _OUTWARD[None]
    pole = jnp.array([[[0.22, 0.0, 1.0]]]) * _OUTWARD[None]
    limb = limbs.leg(start, ankles + 0.0 * start, pole + 0.0 * start, (body.THIGH, body.SHIN))
    flat = _about(1, jnp.array([[TOES_OUT, -TOES_OUT]]))
    thigh = quaternion.multiply(quaternion.inverse(pelvis), limb.upper)
    shin = quaternion.multiply(quaternion.inverse(limb.upper), limb.lower)
    foot = quaternion.multiply(quaternion.inverse(limb.lower), flat)
    return jnp.stack([thigh, shin, foot], axis=2)


def _turning() -> list[str]:
    """Names of the joints that turn, in the order in which `_solve` lists them."""
    sides = _ARM, [f"Hand{finger}{n}" for finger in _FINGERS for n in (1, 2, 3)], _LEG
    return ["Hips", *_SPINE, *_NECK, *(side + part for parts in sides for side in SIDES for part in parts)]


@jax.jit
def _solve(tracks: Tracks) -> tuple[Float[Array, "T K 3"], Float[Array, "T 3"]]:
    """(Euler angles zyx of the joints that turn, rad; world position of the hips, cm)."""
    hips = jnp.asarray(tracks.hips) + jnp.array([0.0, body.HIPS_HEIGHT, 0.0])[None]
    trunk = _trunk(tracks)
    chest, origin = _chest(trunk, hips)
    sides = _arms(tracks, chest, origin), _fingers(tracks), _legs(trunk[:, 0], hips)
    rotations = jnp.concatenate([trunk, *(part.reshape(len(hips), -1, 4) for part in sides)], axis=1)
    return quaternion.to_euler(rotations, "zyx"), hips


def pose(tracks: Tracks, frame_time: float) -> bvh.Clip:
    """The clip in which the body follows `tracks`: rotations zyx, only the hips travel."""
    frames = len(tracks.hips)
    padding = -frames % _BLOCK
    with jax.enable_x64(True):
        padded = [np.concatenate([t, np.repeat(t[-1:], padding, axis=0)]).astype(np.float64) for t in tracks]
        starts = range(0, frames, _BLOCK)
        blocks = [_solve(Tracks(*(jnp.asarray(t[k : k + _BLOCK]) for t in padded))) for k in starts]
        solved, hips = (np.concatenate([np.asarray(b[i]) for b in blocks])[:frames] for i in range(2))
    skeleton = body.rest_skeleton()
    euler = np.zeros((frames, len(skeleton), 3), np.float32)
    euler[:, [skeleton.index(name) for name in _turning()]] = solved
    positions = np.repeat(skeleton.offsets[None].astype(np.float32), frames, axis=0)
    positions[:, 0] = hips
    return bvh.Clip(skeleton, ("zyx",) * len(skeleton), euler, positions, frame_time)
