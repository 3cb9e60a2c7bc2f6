"""Motion features in the release's mixture of float32 and float64, for stages whose vectors start from them.

Our `motion.features.encode` computes in float64. The release rounds Euler angles, quaternions and joint positions to
float32 before it differentiates, which moves velocities by up to 1e-3 cm/s, more than the networks' own tolerances.
The encoder and decoder rows of `generate` start from these numbers; `encode` itself is checked against the `bvh`
stage and the `first_*` rows, at the tolerances that the set gives for features.
"""

import jax.numpy as jnp
import numpy as np

from zeggs_jax.motion import bvh, features
from zeggs_jax.motion.features import Motion


def encode(clip: bvh.Clip) -> Motion:
    """`features.encode` with joints rounded where the release rounds them; needs zyx Euler angles."""
    exact = features.encode(clip)
    frame_time = np.float32(clip.frame_time)
    turns = unrolled(quaternions(np.radians(np.degrees(clip.euler).astype(np.float32))))
    positions = clip.positions.astype(np.float32)
    pos, rot = spine_and_yaw(clip, turns, positions)
    away = rot * np.array([1.0, -1.0, -1.0, -1.0])
    positions[:, 0] = rotate(away, positions[:, 0] - pos)
    turns[:, 0] = multiply(away, turns[:, 0])
    step = multiply(turns[1:], turns[:-1] * np.array([1, -1, -1, -1], np.float32))
    step = np.where(step[..., :1] < 0, -step, step)
    before = np.concatenate([away[:1], away[:-1]])
    turned = multiply(rot[1:], away[:-1])
    turned = np.where(turned[..., :1] < 0, -turned, turned)
    pose = exact.pose._replace(
        root_vel=single(rotate(before, extrapolated(np.diff(pos, axis=0) / clip.frame_time))),
        root_ang=single(rotate(before, extrapolated(2.0 * log(turned) / clip.frame_time))),
        joint_pos=jnp.asarray(positions),
        joint_vel=jnp.asarray(extrapolated(np.diff(positions, axis=0) / frame_time)),
        joint_ang=jnp.asarray(extrapolated(np.float32(2) * log(step) / frame_time)),
    )
    return Motion(pose, exact.gaze)


def single(x: np.ndarray) -> jnp.ndarray:
    """Rounded to float32."""
    return jnp.asarray(x.astype(np.float32))


def spine_and_yaw(clip: bvh.Clip, turns: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ground position of the spine and yaw of the hips, float64 from float32 joints."""
    skeleton = clip.skeleton
    path = [skeleton.role("spine")]
    while path[0]:
        path.insert(0, skeleton.parents[path[0]])
    pos, turn = positions[:, 0], turns[:, 0]
    for joint in path[1:]:
        pos = rotate(turn, positions[:, joint]) + pos
        turn = multiply(turn, turns[:, joint])
    ahead = rotate(turns[:, 0], np.broadcast_to(np.array([0.0, 0.0, 1.0]), pos.shape)) * [1.0, 0.0, 1.0]
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    yaw = np.stack([1.0 + ahead[:, 2], 0 * pos[:, 0], ahead[:, 0], 0 * pos[:, 0]], axis=-1)
    return pos * [1.0, 0.0, 1.0], yaw / np.linalg.norm(yaw, axis=-1, keepdims=True)


def quaternions(angles: np.ndarray) -> np.ndarray:
    """zyx Euler angles [T, J, 3] to quaternions, in the angles' own precision."""
    axes = []
    for column, axis in ((0, 3), (1, 2), (2, 1)):
        q = np.zeros((*angles.shape[:2], 4), angles.dtype)
        q[..., 0], q[..., axis] = np.cos(angles[..., column] / 2), np.sin(angles[..., column] / 2)
        axes.append(q)
    return multiply(axes[0], multiply(axes[1], axes[2]))


def unrolled(q: np.ndarray) -> np.ndarray:
    """Signs chosen so that neighbouring frames agree."""
    flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=-1) < 0, -1, 1), axis=0)
    return np.concatenate([q[:1], q[1:] * flips[..., None].astype(q.dtype)])


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product, term by term in the release's order of rounding."""
    a0, a1, a2, a3 = np.moveaxis(a, -1, 0)
    b0, b1, b2, b3 = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            b0 * a0 - b1 * a1 - b2 * a2 - b3 * a3,
            b0 * a1 + b1 * a0 - b2 * a3 + b3 * a2,
            b0 * a2 + b1 * a3 + b2 * a0 - b3 * a1,
            b0 * a3 - b1 * a2 + b2 * a1 + b3 * a0,
        ],
        axis=-1,
    )


def rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A vector turned, with its cross products in float64."""
    t = 2.0 * np.cross(q[..., 1:].astype(np.float64), v)
    return v + q[..., :1] * t + np.cross(q[..., 1:].astype(np.float64), t)


def log(q: np.ndarray) -> np.ndarray:
    """Half the scaled axis of unit quaternions."""
    length = np.sqrt(np.sum(q[..., 1:] ** 2, axis=-1, keepdims=True))
    safe = np.where(length < 1e-5, np.float32(1), length)
    return np.where(length < 1e-5, q[..., 1:], np.arctan2(length, q[..., :1]) / safe * q[..., 1:])


def extrapolated(v: np.ndarray) -> np.ndarray:
    """Frame 0 put before: v1 - (v3 - v2)."""
    return np.concatenate([v[:1] - (v[2:3] - v[1:2]), v])
