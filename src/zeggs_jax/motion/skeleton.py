"""The body's hierarchy as data: joint names, parents, offsets, which joint plays which role, left and right.

No joint is known by number anywhere else: features, mirrors and pictures ask the skeleton for `role("head")`.
"""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from zeggs_jax.motion.names import EXAMPLES, Roles, infer_roles, side_and_part

__all__ = ["REFERENCE_NAMES", "REFERENCE_PARENTS", "Roles", "Skeleton", "infer_roles", "levels"]

_DIGITS = ("Thumb", "Index", "Middle", "Ring", "Pinky")
_FINGERS = tuple(f"Hand{digit}{n}" for digit in _DIGITS for n in (1, 2, 3, 4))
_ARM = ("Shoulder", "Arm", "ForeArm", "Hand", *_FINGERS, "ForeArmEnd", "ArmEnd")
_LEG = ("UpLeg", "Leg", "Foot", "ToeBase", "ToeBaseEnd", "LegEnd", "UpLegEnd")

REFERENCE_NAMES: tuple[str, ...] = (
    *("Hips", "Spine", "Spine1", "Spine2", "Spine3", "Neck", "Neck1", "Head", "HeadEnd"),
    *(f"Right{part}" for part in _ARM),
    *(f"Left{part}" for part in _ARM),
    *(f"Right{part}" for part in _LEG),
    *(f"Left{part}" for part in _LEG),
)
"""The 75 joints of the ZEGGS skeleton, in order."""

REFERENCE_PARENTS: tuple[int, ...] = (
    *(-1, 0, 1, 2, 3, 4, 5, 6, 7),
    *(4, 9, 10, 11, 12, 13, 14, 15, 12, 17, 18, 19, 12, 21, 22, 23, 12, 25, 26, 27, 12, 29, 30, 31, 12, 11),
    *(4, 35, 36, 37, 38, 39, 40, 41, 38, 43, 44, 45, 38, 47, 48, 49, 38, 51, 52, 53, 38, 55, 56, 57, 38, 37),
    *(0, 61, 62, 63, 64, 63, 62),
    *(0, 68, 69, 70, 71, 70, 69),
)
"""The parent of each of them, -1 for the hips; parents come before children."""


def _few(names: tuple[str, ...]) -> str:
    """The first eight names, and how many there are where there are more."""
    return ", ".join(names[:8]) + (f", ... ({len(names)} in all)" if len(names) > 8 else "")


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A hierarchy of J joints: parents come before children, joint 0 is the only root."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Float[np.ndarray, "J 3"]  # cm, from the parent, in the parent's frame
    roles: Roles | None = None  # None: inferred from the names

    def __post_init__(self) -> None:
        if len(self.parents) != len(self.names) or len(self.offsets) != len(self.names):
            raise ValueError(
                f"A skeleton needs one parent and one offset per joint, got {len(self.names)} names, "
                f"{len(self.parents)} parents and {len(self.offsets)} offsets."
            )
        for joint, (name, parent) in enumerate(zip(self.names, self.parents, strict=True)):
            if not (-1 <= parent < joint and (parent >= 0) == (joint > 0)):
                raise ValueError(f"Joint '{name}' must come after its parent; only the first joint has none.")
            if name in self.names[:joint]:
                raise ValueError(f"Two joints are called '{name}'; give every joint its own name.")
        if self.roles is None:
            object.__setattr__(self, "roles", infer_roles(self.names))

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Number of the joint called `name`; ValueError where there is none."""
        if name not in self.names:
            raise ValueError(f"The skeleton has no joint '{name}'; it has {', '.join(self.names)}.")
        return self.names.index(name)

    def role(self, role: str) -> int:
        """Number of the joint that plays a role ("hips", "head", ...); ValueError where nobody does.

        Joints with names of their own get their roles by `Skeleton(..., roles=Roles(head="Kopf", ...))`.
        """
        if role not in {field.name for field in fields(Roles)}:
            raise ValueError(f"'{role}' is no role; roles are {', '.join(f.name for f in fields(Roles))}.")
        name = getattr(self.roles, role)
        if name is None:
            raise ValueError(
                f"No joint of this skeleton looks like the {role.replace('_', ' ')}; "
                f"a name such as {EXAMPLES[role]} is understood, its joints are {_few(self.names)}."
            )
        return self.index(name)

    def path(self, joint: int) -> list[int]:
        """Joint numbers from joint 0 down to `joint`."""
        path = [joint]
        while path[0]:
            path.insert(0, self.parents[path[0]])
        return path

    def levels(self) -> tuple[tuple[int, ...], ...]:
        """Joint numbers by depth: the root, its children, their children, ..."""
        return levels(self.parents)

    def pairs(self) -> list[tuple[int, int]]:
        """Numbers of the joints that are named alike on both sides, (left, right)."""
        named = {side_and_part(name): joint for joint, name in enumerate(self.names)}
        return [
            (joint, named["right", words])
            for (side, words), joint in named.items()
            if side == "left" and ("right", words) in named
        ]

    def alone(self) -> list[int]:
        """Numbers of the helpers on one side: no counterpart, no children, no role, at a joint with a counterpart."""
        paired = {joint for pair in self.pairs() for joint in pair}
        playing = set(vars(self.roles).values())
        return [
            joint
            for joint, (name, parent) in enumerate(zip(self.names, self.parents, strict=True))
            if side_and_part(name)[0] and joint not in paired and parent in paired
            if joint not in self.parents and name not in playing
        ]

    def mirror_map(self) -> tuple[int, ...]:
        """For every joint the number of its counterpart across; itself for joints in the middle and helpers `alone`.

        ValueError where any other joint, or every joint, has no counterpart.
        """
        counterparts = list(range(len(self)))
        for left, right in self.pairs():
            counterparts[left], counterparts[right] = right, left
        alone = self.alone()
        for joint, name in enumerate(self.names):
            side = side_and_part(name)[0]
            if side and counterparts[joint] == joint and joint not in alone:
                other = {"left": "right", "right": "left"}[side]
                raise ValueError(f"Joint '{name}' has no {other} counterpart, so this body has no mirror.")
        if counterparts == list(range(len(self))):
            raise ValueError("No two joints are named as the left and right of a pair, so this body has no mirror.")
        return tuple(counterparts)

    def asymmetry(self) -> float:
        """How far the left joints' offsets are from the mirror images (x = 0) of the right ones', 0 to about 1.

        Against the length of their bones. Near 1 the two sides' frames are not mirror images, and neither is a
        motion whose rotations are mirrored.
        """
        pairs = np.array(self.pairs(), int).reshape(-1, 2)
        left, right = self.offsets[pairs[:, 0]], self.offsets[pairs[:, 1]]
        apart = np.linalg.norm(left - right * np.array([-1.0, 1.0, 1.0]), axis=-1).sum()
        length = np.linalg.norm(left, axis=-1).sum() + np.linalg.norm(right, axis=-1).sum()
        return float(apart / length) if length > 0 else 0.0


def levels(parents: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    """Joint numbers grouped by depth below the root."""
    depth: list[int] = []
    for parent in parents:
        depth.append(0 if parent < 0 else depth[parent] + 1)
    return tuple(tuple(j for j, d in enumerate(depth) if d == level) for level in range(max(depth) + 1))
