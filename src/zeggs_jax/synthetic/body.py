"""The synthetic body: the release's 75-joint hierarchy, bone lengths of our own, 175 cm tall, in a T-pose."""

from functools import cache

import numpy as np
from jaxtyping import Float

from zeggs_jax.motion import skeleton

HIPS_HEIGHT = 94.0  # cm of the Hips joint above the ground when the legs are straight
UPPER_ARM, FOREARM = 29.0, 26.0  # cm
THIGH, SHIN, ANKLE = 41.5, 41.0, 8.5  # cm; ANKLE is the height of the Foot joint on the ground

_MIDDLE = {
    "Hips": (0.0, HIPS_HEIGHT, 0.0),
    "Spine": (0.0, 8.0, -1.0),
    "Spine1": (0.0, 9.0, -0.5),
    "Spine2": (0.0, 11.0, 0.0),
    "Spine3": (0.0, 11.0, 0.0),
    "Neck": (0.0, 15.5, -0.5),
    "Neck1": (0.0, 5.0, 1.2),
    "Head": (0.0, 5.0, 1.0),
    "HeadEnd": (0.0, 17.0, 1.0),
}
_LEFT = {  # offsets from the parent in cm; +X is outward on the left side, +Z forward
    "Shoulder": (3.2, 11.5, 1.0),
    "Arm": (13.8, 0.3, -1.5),
    "ForeArm": (UPPER_ARM, 0.0, 0.0),
    "Hand": (FOREARM, 0.0, 0.0),
    "HandThumb1": (2.6, -1.0, 2.4),
    "HandThumb2": (3.0, -0.6, 2.6),
    "HandThumb3": (2.6, -0.2, 1.5),
    "HandThumb4": (2.2, 0.0, 1.0),
    "HandIndex1": (9.2, 0.0, 2.6),
    "HandMiddle1": (9.4, 0.2, 0.5),
    "HandRing1": (8.9, 0.1, -1.6),
    "HandPinky1": (8.2, -0.3, -3.3),
    "ForeArmEnd": (2.0, 0.0, 0.0),
    "ArmEnd": (2.0, 0.0, 0.0),
    "UpLeg": (9.0, -3.0, 0.0),
    "Leg": (0.0, -THIGH, 0.0),
    "Foot": (0.0, -SHIN, 0.0),
    "ToeBase": (0.0, -6.0, 13.0),
    "ToeBaseEnd": (0.0, -1.0, 7.0),
    "LegEnd": (0.0, -2.0, 0.0),
    "UpLegEnd": (0.0, -2.0, 0.0),
}
_PHALANGES = {
    "Index": (4.3, 2.5, 2.2),
    "Middle": (4.7, 2.8, 2.3),
    "Ring": (4.4, 2.6, 2.2),
    "Pinky": (3.5, 2.0, 1.9),
}


def _offset(name: str) -> tuple[float, float, float]:
    if name in _MIDDLE:
        return _MIDDLE[name]
    side, part = ("Left", name[4:]) if name.startswith("Left") else ("Right", name[5:])
    if part in _LEFT:
        x, y, z = _LEFT[part]
    else:
        finger, number = part[4:-1], int(part[-1])
        x, y, z = _PHALANGES[finger][number - 2], 0.0, 0.0
    return (x if side == "Left" else -x, y, z)


@cache
def rest_skeleton() -> skeleton.Skeleton:
    """The body at rest: arms along +-X, palms down, facing +Z, feet on y = 0; offsets in cm, parent frame."""
    names = tuple(skeleton.REFERENCE_NAMES)
    offsets: Float[np.ndarray, "J 3"] = np.array([_offset(name) for name in names])
    return skeleton.Skeleton(names, tuple(skeleton.REFERENCE_PARENTS), offsets, skeleton.infer_roles(names))
