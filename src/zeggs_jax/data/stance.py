"""How a body stands in its file: which axes of the world and of each joint's own frame point up and ahead."""

import itertools
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from zeggs_jax.motion import features
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.skeleton import Skeleton

Axis = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]
AXES: tuple[Axis, ...] = get_args(Axis)[1:]
UPRIGHT = "y z"  # a joint whose own y points up and own z ahead while the body stands


@dataclass(frozen=True)
class Stance:
    """A clip looked at, at most 256 frames of it, for what its axes mean."""

    skeleton: Skeleton
    places: Float[np.ndarray, "t J 3"]  # world
    turns: Float[np.ndarray, "t J 3 3"]  # columns are the joints' axes in world

    @classmethod
    def of(cls, clip: Clip) -> "Stance":
        every = max(1, -(-len(clip.euler) // 256))
        some = clip._replace(euler=clip.euler[::every], positions=clip.positions[::every])
        return cls(clip.skeleton, *features.world_frames(some))

    def up(self, name: str) -> Axis:
        """The world's axis from the feet, or else the hips, to the head."""
        head, hips = self.skeleton.role("head"), self.skeleton.role("hips")
        assert self.skeleton.roles is not None
        feet = [self.skeleton.role(role) for role in ("left_foot", "right_foot") if getattr(self.skeleton.roles, role)]
        rise = self.places[:, head] - self.places[:, feet or [hips]].mean(axis=1)
        return _axis(_unit(rise).mean(axis=0), f"'{name}' does not stand along an axis; say which one points up.")

    def axes(self, up: Axis, facing: Axis, name: str) -> tuple[str, ...]:
        """Of every joint its own axes that point up and ahead; () where it is y and z for all."""
        skeleton, hips, head = self.skeleton, self.skeleton.role("hips"), self.skeleton.role("head")
        trunk = skeleton.path(head)
        own = self._hips(facing, name)
        world = to_world(own, up)
        joints = range(len(skeleton))
        frames = [world] * len(skeleton)
        posture = own @ np.swapaxes(self.turns[:, hips], 1, 2)  # world to the standing body's x left, y up, z ahead
        for joint in trunk[trunk.index(hips) :]:
            above = own if joint == hips else frames[skeleton.parents[joint]]
            frames[joint] = _nearest((posture @ self.turns[:, joint]).mean(axis=0), above)
        limbs = [j for j in joints if j not in trunk and hips in skeleton.path(j)]
        frames = min(
            (
                [frames[head] if head in skeleton.path(j) else choice if j in limbs else frames[j] for j in joints]
                for choice in (own, np.eye(3))  # limbs turned with the hips, or as they are
            ),
            key=lambda choice: round(_asymmetry(skeleton, choice), 3),
        )
        labels = tuple(f"{_dominant(frame[1])} {_dominant(frame[2])}" for frame in frames)
        return () if set(labels) == {UPRIGHT} else labels

    def _hips(self, facing: Axis, name: str) -> Float[np.ndarray, "3 3"]:
        """The rotation from the hips' own frame to x left, y up, z ahead."""
        skeleton, hips, head = self.skeleton, self.skeleton.role("hips"), self.skeleton.role("head")
        into = np.swapaxes(self.turns[:, hips], 1, 2)
        rise = _unit(np.einsum("tab,tb->ta", into, self.places[:, head] - self.places[:, hips])).mean(axis=0)
        if facing != "auto":
            known = _vector(facing)
            if _dominant(rise)[-1] == facing[-1]:
                raise ValueError(f"'{name}' has its head along the hips' own {facing[-1]}: they cannot face {facing}.")
            tall = _vector(_dominant(rise * (known == 0)))
            return np.stack([np.cross(tall, known), tall, known])
        left, right = _sides(skeleton, self.places, name)
        across = np.einsum("tab,tb->ta", into, self.places[:, left] - self.places[:, right])
        known = _vector(
            _axis(
                _unit(across.mean(axis=0)),
                f"'{name}' has hips that are turned against their left and right; say which axis they face.",
            )
        )
        tall = _vector(_dominant(rise * (known == 0)))
        return np.stack([known, tall, np.cross(known, tall)])


def _sides(skeleton: Skeleton, places: Float[np.ndarray, "t J 3"], name: str) -> tuple[int, int]:
    """The first joints of the legs, or else of the arms or any others, that lie apart left and right."""
    assert skeleton.roles is not None
    pairs: list[tuple[int, int]] = []
    for part in ("foot", "hand"):
        if getattr(skeleton.roles, f"left_{part}") and getattr(skeleton.roles, f"right_{part}"):
            paths = (skeleton.path(skeleton.role(f"{side}_{part}")) for side in ("left", "right"))
            pairs += list(zip(*paths, strict=False))
    pairs += skeleton.pairs()
    trunk = places[:, skeleton.role("head")] - places[:, skeleton.role("hips")]
    apart = 0.05 * float(np.linalg.norm(trunk, axis=-1).mean())
    for left, right in pairs:
        if np.linalg.norm((places[:, left] - places[:, right]).mean(axis=0)) > apart:
            return left, right
    raise ValueError(f"'{name}' has no left and right joints to tell where it faces; say which axis its hips face.")


def _asymmetry(skeleton: Skeleton, frames: list[np.ndarray]) -> float:
    """`Skeleton.asymmetry` of the body in other joint frames."""
    above = np.stack([np.eye(3) if parent < 0 else frames[parent] for parent in skeleton.parents])
    turned = np.einsum("jab,jb->ja", above, skeleton.offsets)
    return Skeleton(skeleton.names, skeleton.parents, turned, skeleton.roles).asymmetry()


def to_frames(axes: tuple[str, ...], joints: int) -> Float[np.ndarray, "J 3 3"]:
    """The rotation from each joint's own frame to x left, y up, z ahead."""
    pairs = [tuple(_vector(axis) for axis in pair.split()) for pair in axes or (UPRIGHT,) * joints]
    return np.stack([np.stack([np.cross(up, ahead), up, ahead]) for up, ahead in pairs])


def to_world(hips: Float[np.ndarray, "3 3"], up: Axis) -> Float[np.ndarray, "3 3"]:
    """The turn of the world that goes with a turn of the hips' frame and brings `up` to y."""
    rise, target = hips @ _vector(up), np.array([0.0, 1.0, 0.0])
    cosine, axis = float(rise @ target), np.cross(rise, target)
    if cosine < 0:
        return np.diag([-1.0, -1.0, 1.0]) @ hips
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return (np.eye(3) + cross + cross @ cross) @ hips  # a quarter turn, or none


def _nearest(turn: Float[np.ndarray, "3 3"], usual: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The quarter turns nearest to a mean rotation: `usual` unless that is more than 60 degrees away."""
    if float((turn * usual).sum()) > 2.0:
        return usual
    found = [
        np.stack([np.cross(_vector(a), _vector(b)), _vector(a), _vector(b)])
        for a, b in itertools.product(AXES, AXES)
        if a[-1] != b[-1]
    ]
    return max(found, key=lambda frame: float((turn * frame).sum()))


def _vector(axis: str) -> Float[np.ndarray, "3"]:
    return (-1.0 if axis[0] == "-" else 1.0) * np.eye(3)["xyz".index(axis[-1])]


def _dominant(vector: Float[np.ndarray, "3"]) -> Axis:
    return max(AXES, key=lambda axis: float(_vector(axis) @ vector))


def _axis(direction: Float[np.ndarray, "3"], otherwise: str) -> Axis:
    """The axis that a direction follows; ValueError with `otherwise` when it is more than 41 degrees off."""
    axis = _dominant(direction)
    if float(_vector(axis) @ direction) < 0.75:
        raise ValueError(otherwise)
    return axis


def _unit(vectors: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
