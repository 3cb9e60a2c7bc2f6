"""A style encoder for each part of the body: trunk, head, arms and legs have each their own slice of the embedding.

Not in the paper, which leaves it to future work. A slice is made from the columns of its part's joints and from
nothing else, so that what it says is of that part by construction; the decoder, which sees the whole embedding, is
free to use it for any part. Which joint is in which part is read off the skeleton's roles, for any humanoid.
"""

import dataclasses
import math
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from ..motion import pose
from ..motion.skeleton import Skeleton
from ..nn.compute import Matmul
from ..nn.layers import Dense
from .decoder import GAZE
from .style_encoder import StyleDistribution, StyleEncoder, StyleEncoderConfig, from_linen

PARTS = ("trunk", "head", "left_arm", "right_arm", "legs")  # in the order of their slices; the trunk has the root
ENDS = {"head": "head", "left_hand": "left_arm", "right_hand": "right_arm", "left_foot": "legs", "right_foot": "legs"}


class PartsEncoder(nn.Module):
    """Fig. 3b once for each part, half as wide, and a dense layer from what it says to the part's slice."""

    config: StyleEncoderConfig
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(
        self, example: Float[Array, "M P"], length: ArrayLike, deterministic: bool = True
    ) -> StyleDistribution:
        """Scaled pose vectors (with gaze columns, which no part sees) -> the parts' distributions in a row."""
        _check(self.config, example.shape[1])
        made = []
        for part, (start, stop) in slices(self.config).items():
            own = part_config(self.config)
            seen = example[:, columns(self.config.parts, part)]
            whole = StyleEncoder(own, self.matmul, name=part)(seen, length, deterministic).mean
            numbers = (stop - start) * (2 if self.config.variational else 1)
            made.append(Dense(numbers, gain=1.0, matmul=self.matmul, name=f"{part}_slice")(whole))
        if not self.config.variational:
            return StyleDistribution(jnp.concatenate(made), None)
        halves = [jnp.split(numbers, 2) for numbers in made]
        return StyleDistribution(*(jnp.concatenate(half) for half in zip(*halves, strict=True)))


def of_joints(skeleton: Skeleton) -> tuple[str, ...]:
    """The part of every joint: a limb begins where the path to its end leaves all other paths; below, all is its own.

    A part whose end (head, hand, foot) plays no role in the skeleton is left to the trunk.
    """
    assert skeleton.roles is not None
    roles = vars(skeleton.roles)
    paths = {end: skeleton.path(skeleton.role(end)) for end in ENDS if roles[end]}
    trunk = {0} | {j for role in ("hips", "spine") if roles[role] for j in skeleton.path(skeleton.role(role))}
    for joint in range(len(skeleton)):
        if sum(joint in path for path in paths.values()) > 1:
            trunk.add(joint)
    begins = {
        next(j for j in path if j not in trunk): ENDS[end] for end, path in paths.items() if path[-1] not in trunk
    }
    parts: list[str] = []
    for joint, parent in enumerate(skeleton.parents):
        parts.append(begins.get(joint, parts[parent] if parent >= 0 else PARTS[0]))
    return tuple(parts)


def columns(parts: tuple[str, ...], part: str) -> Int[np.ndarray, " c"]:
    """Columns of a pose vector that tell of the joints of a part; of the trunk also the root's velocities."""
    numbers = np.arange(pose.size(len(parts)), dtype=float)
    here = pose.from_vector(numbers, pose.Root(jnp.zeros(3), jnp.zeros(4)))
    joints = [j for j, name in enumerate(parts) if name == part]
    own = [of_all[joints].ravel() for of_all in (here.joint_pos, here.joint_axes, here.joint_vel, here.joint_ang)]
    root = [here.root_vel, here.root_ang] if part == PARTS[0] else []
    return np.concatenate([*root, *own]).astype(int)


def slices(config: StyleEncoderConfig) -> dict[str, tuple[int, int]]:
    """Where in the embedding each part is: [start, stop), the same width or one more for the first ones."""
    present = [part for part in PARTS if part in config.parts]
    share, rest = divmod(config.size, len(present))
    edges = np.cumsum([0, *(share + (k < rest) for k in range(len(present)))]).tolist()
    return dict(zip(present, pairwise(edges), strict=True))


def part_config(config: StyleEncoderConfig) -> StyleEncoderConfig:
    """The encoder of one part, before its dense layer.

    Its transformer is a quarter of `hidden` wide, not as wide as a slice: layer norm over few channels leaves nothing.
    """
    width = max(8, config.hidden // 4)
    heads = math.gcd(config.heads, width)
    sizes = {"hidden": max(2, config.hidden // 2), "size": width, "heads": heads}
    return dataclasses.replace(config, kind="attn", variational=False, parts=(), **sizes)


def _fit(config: StyleEncoderConfig, skeleton: Skeleton) -> StyleEncoderConfig:
    parts = of_joints(skeleton)
    present = [part for part in PARTS if part in parts]
    if len(present) < 2:
        raise ValueError(
            f"style kind 'parts' tells parts of the body apart, and all {len(parts)} joints of this skeleton are in "
            "one; name its head, hands and feet under [roles] of a body file, or choose another kind."
        )
    if config.size < len(present):
        raise ValueError(
            f"the style has {config.size} numbers for {len(present)} parts of the body ({', '.join(present)}); "
            "give style.size at least one for each."
        )
    return dataclasses.replace(config, parts=parts)


def _check(config: StyleEncoderConfig, inputs: int) -> None:
    """Raises a ValueError where the config does not name a part for every joint of a body of `inputs` numbers."""
    joints = len(config.parts)
    if inputs != pose.size(joints) + GAZE or not joints:
        raise ValueError(
            f"style kind 'parts' has the parts of {joints} joints in its config, for {inputs} numbers a frame; "
            "training fills them in, elsewhere give StyleEncoderConfig.parts = parts_encoder.of_joints(skeleton)."
        )
    for part in config.parts:
        if part not in PARTS:
            raise ValueError(f"style.parts has a part '{part}'; parts are {', '.join(PARTS)}.")


PARTS_ENCODER = from_linen(PartsEncoder, fit=_fit)
