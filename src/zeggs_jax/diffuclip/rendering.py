"""Eq. 18's render(M; r): a skeleton as a small picture of coloured limbs, seen by a random camera."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy import ndarray

from ..motion.skeleton import Skeleton

LIMBS = ("head", "left_hand", "right_hand", "left_foot", "right_foot")  # the first one's way is the trunk
COLOURS = ((0.35, 0.35, 0.40), (0.85, 0.30, 0.25), (0.20, 0.45, 0.85), (0.90, 0.65, 0.15), (0.20, 0.65, 0.40))
TRUNK, LIMB, TIP, SKULL = 7.0, 4.5, 2.5, 9.0  # cm, half the width of the trunk, of a limb, of what ends it, of the head
BODY = 200.0  # cm, what a picture shows at `fill` 1
NEAREST = 10.0  # cm, what is nearer to the camera is not drawn larger


class Figure(NamedTuple):
    """What is drawn of a skeleton: its bones, without the fingers' ends."""

    start: Int[ndarray, " b"]  # joints
    end: Int[ndarray, " b"]
    radius: Float[ndarray, " b"]  # cm
    colour: Float[ndarray, "b 3"]  # red, green, blue, 0 to 1


class Camera(NamedTuple):
    """A pinhole camera that looks at a point; angles in rad, lengths in cm."""

    target: Float[Array, "3"]  # world
    azimuth: Float[Array, ""]  # 0 sees +Z come towards it, positive from the body's left
    elevation: Float[Array, ""]  # positive from above
    distance: Float[Array, ""]
    fill: Float[Array, ""]  # share of the picture's height that 2 m at the target take
    ground: Float[Array, "3"]  # the background's colour


def figure(skeleton: Skeleton) -> Figure:
    """The bones to draw: the ways from the hips to head, hands and feet, and one joint further.

    ValueError where the skeleton has no joint that looks like one of these.
    """
    ends: dict[int, tuple[int, float]] = {}
    for limb, role in enumerate(LIMBS):
        last = skeleton.role(role)
        for joint in skeleton.path(last)[1:]:
            ends.setdefault(joint, (limb, LIMB if limb else TRUNK))
        for joint, parent in enumerate(skeleton.parents):
            if parent == last:
                ends.setdefault(joint, (limb, TIP if limb else SKULL))
    joints = list(ends)
    limbs, radii = zip(*ends.values(), strict=True)
    return Figure(
        np.array([skeleton.parents[joint] for joint in joints]),
        np.array(joints),
        np.array(radii, np.float32),
        np.array(COLOURS, np.float32)[np.array(limbs)],
    )


def camera(key: Array, target: Float[Array, "3"]) -> Camera:
    """A random camera: up to 75 degrees to either side, from a little below to well above, near or far."""
    keys = jax.random.split(key, 5)
    degree = np.pi / 180.0
    return Camera(
        target,
        jax.random.uniform(keys[0], minval=-75.0, maxval=75.0) * degree,
        jax.random.uniform(keys[1], minval=-10.0, maxval=35.0) * degree,
        jax.random.uniform(keys[2], minval=220.0, maxval=600.0),
        jax.random.uniform(keys[3], minval=0.7, maxval=1.0),
        jnp.broadcast_to(jax.random.uniform(keys[4], minval=0.5, maxval=1.0), 3),
    )


def front(target: Float[Array, "3"]) -> Camera:
    """The camera that people expect: in front of the body, a little above."""
    azimuth, elevation, distance, fill = map(jnp.asarray, (0.0, 0.15, 400.0, 0.9))
    return Camera(jnp.asarray(target), azimuth, elevation, distance, fill, jnp.full(3, 0.96))


def render(points: Float[Array, "J 3"], shape: Figure, view: Camera, pixels: int) -> Float[Array, "H W 3"]:
    """One frame's joints (cm, world) as a square picture, 0 to 1; edges are smooth, the nearer limb hides the other."""
    across, depth = project(points, view)
    near = (depth[shape.start] + depth[shape.end]) / 2.0
    radius = view.fill * view.distance / BODY * jnp.asarray(shape.radius) / near
    apart = distances(across[shape.start], across[shape.end], pixels)
    order = jnp.argsort(near)  # the nearest first
    covered = jnp.clip((radius[None, None] - apart) * pixels + 0.5, 0.0, 1.0)[:, :, order]
    open_ = jnp.cumprod(1.0 - covered, axis=-1)  # what is left for those behind
    seen = covered * jnp.concatenate([jnp.ones_like(open_[..., :1]), open_[..., :-1]], axis=-1)
    light = jnp.clip(1.0 - 0.002 * (near[order] - view.distance), 0.6, 1.3)  # what is nearer is brighter
    shade = jnp.asarray(shape.colour)[order] * light[:, None]
    return jnp.clip(seen @ shade + open_[..., -1:] * view.ground[None, None], 0.0, 1.0)


def distances(start: Float[Array, "b 2"], end: Float[Array, "b 2"], pixels: int) -> Float[Array, "H W b"]:
    """How far the middle of each pixel is from each bone, in heights of the picture."""
    ticks = (jnp.arange(pixels) + 0.5) / pixels - 0.5
    place = jnp.stack(jnp.broadcast_arrays(ticks[None, :], -ticks[:, None]), axis=-1)[:, :, None, :]
    bone, way = (end - start)[None, None], place - start[None, None]
    along = jnp.clip(jnp.sum(way * bone, axis=-1) / (jnp.sum(bone**2, axis=-1) + 1e-9), 0.0, 1.0)
    return jnp.sqrt(jnp.sum((way - along[..., None] * bone) ** 2, axis=-1) + 1e-12)


def project(points: Float[Array, "J 3"], view: Camera) -> tuple[Float[Array, "J 2"], Float[Array, " J"]]:
    """(places in the picture in heights of it, right and up from its middle; depths in cm) of points in the world."""
    x, y, z = jnp.moveaxis(points - view.target[None], -1, 0)
    cos, sin = jnp.cos(view.azimuth), jnp.sin(view.azimuth)
    x, z = cos * x - sin * z, sin * x + cos * z
    cos, sin = jnp.cos(view.elevation), jnp.sin(view.elevation)
    y, z = cos * y - sin * z, sin * y + cos * z
    depth = jnp.maximum(view.distance - z, NEAREST)
    scale = view.fill * view.distance / BODY
    return scale * jnp.stack([x, y], axis=-1) / depth[:, None], depth
