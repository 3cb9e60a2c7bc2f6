"""Edits of a clip: trim, mirror, retime, resample, centre, and fit to the skeleton that a model knows."""

import jax
import numpy as np
from jax import Array
from jaxtyping import Float

from zeggs_jax.geometry import quaternion
from zeggs_jax.motion.bvh import Clip, rate_hz
from zeggs_jax.motion.features import in_float64, local_quaternions, with_quaternions, world_frames
from zeggs_jax.motion.skeleton import Skeleton

_slerp = jax.jit(quaternion.slerp)


def trim(clip: Clip, start: int = 0, stop: int | None = None) -> Clip:
    """Frames `start` to `stop`, which is not included; ValueError where that is outside the clip or empty."""
    frames = len(clip.euler)
    stop = frames if stop is None else stop
    if not 0 <= start < stop <= frames:
        raise ValueError(f"Frames {start}:{stop} are not in the clip, which has frames 0:{frames}.")
    return clip._replace(euler=clip.euler[start:stop], positions=clip.positions[start:stop])


def mirror(clip: Clip, keep_offsets: bool = False) -> Clip:
    """Left and right exchanged by reflection in x = 0 (ZeroEGGS Sec. 4.1): q = (w, x, -y, -z), x to -x.

    Every joint moves to the mirror image of its counterpart. A body whose sides differ is mirrored too;
    `keep_offsets` keeps the body of `clip` instead, and then the image of the motion is approximate.
    """
    across = np.asarray(clip.skeleton.mirror_map())
    reflect = np.array([-1.0, 1.0, 1.0])
    orders = tuple(clip.orders[joint] for joint in across)
    signs = np.array([[1.0 if letter == "x" else -1.0 for letter in order] for order in orders])
    skeleton = clip.skeleton
    reflect = np.where(np.isin(np.arange(len(skeleton)), skeleton.alone())[:, None], 1.0, reflect)
    offsets = skeleton.offsets[across] * reflect
    positions = clip.positions[:, across] * reflect
    if keep_offsets:
        positions[:, 1:] += (skeleton.offsets - offsets)[1:]
    else:
        skeleton = Skeleton(skeleton.names, skeleton.parents, offsets, skeleton.roles)
    return clip._replace(skeleton=skeleton, orders=orders, euler=clip.euler[:, across] * signs, positions=positions)


def retime(clip: Clip, factor: float) -> Clip:
    """The motion stretched to `int(factor * T)` frames at the same frame time: 0.9 is 11 % faster.

    As the release's pace augmentation: a cubic spline per component of positions and quaternions.
    """
    frames = len(clip.euler)
    count = int(factor * frames)
    if count < 1 or frames < 2:
        raise ValueError(f"A clip of {frames} frames cannot be retimed by {factor}; at least 1 frame must remain.")
    at = np.linspace(0.0, frames - 1.0, count)
    from scipy.interpolate import CubicSpline  # 0.3 s to import: only who resamples pays

    rotations = CubicSpline(np.arange(frames), local_quaternions(clip))(at)
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    return with_quaternions(clip, rotations, CubicSpline(np.arange(frames), clip.positions)(at))


def resample(clip: Clip, rate: float) -> Clip:
    """The same motion over the same time at `rate` frames per second (Hz).

    Rotations by slerp, positions by cubic spline; frames lie at multiples of 1 / rate within the clip.
    """
    if not 0 < rate < np.inf:
        raise ValueError(f"A clip cannot be resampled to {rate} frames per second; give a rate above 0.")
    given = rate_hz(clip.frame_time)
    if rate == given:
        return clip
    from scipy.interpolate import CubicSpline

    frames = len(clip.euler)
    at = np.arange(int((frames - 1) * rate / given + 1e-6) + 1) * given / rate
    before = np.clip(at.astype(int), 0, max(frames - 2, 0))
    after = np.minimum(before + 1, frames - 1)
    rotations = local_quaternions(clip)
    part = np.clip(at - before, 0.0, 1.0)[:, None]
    rotations = in_float64(_slerp, rotations[before], rotations[after], part)
    spline = CubicSpline(np.arange(frames), clip.positions) if frames > 1 else lambda at: clip.positions
    return with_quaternions(clip, rotations, spline(at))._replace(frame_time=1.0 / rate)


def centre(clip: Clip, as_released: bool = False) -> Clip:
    """The clip moved so that the hips start above the origin, facing +Z.

    `as_released` goes by joint 0 and keeps the release's yaw: frame 0's quaternion with x and z set to zero and
    not made unit, so that the move is not quite rigid (up to 0.7 degrees; the released data went through it).
    """
    rotations = local_quaternions(clip)
    start, turn = (clip.positions[0, 0], rotations[0, 0]) if as_released else _hips(clip, rotations)
    yaw = turn[None] * np.array([[1.0, 0.0, 1.0, 0.0]])
    if not as_released:
        length = np.linalg.norm(yaw)
        yaw = yaw / length if length > 0 else np.array([[1.0, 0.0, 0.0, 0.0]])
    positions = clip.positions.copy()
    back = np.repeat(yaw * np.array([1.0, -1.0, -1.0, -1.0]), len(positions), axis=0)
    moved = positions[:, 0] - start * np.array([1.0, 0.0, 1.0])
    rotations[:, 0] = in_float64(jax.jit(quaternion.multiply), back, rotations[:, 0])
    positions[:, 0] = in_float64(jax.jit(quaternion.rotate), back, moved)
    return with_quaternions(clip, rotations, positions)


def _hips(clip: Clip, rotations: Float[np.ndarray, "T J 4"]) -> tuple[np.ndarray, np.ndarray]:
    """Position and rotation of the hips in world in frame 0."""
    skeleton = clip.skeleton
    known = skeleton.roles is not None and skeleton.roles.hips is not None
    place, turn = clip.positions[0, 0], rotations[0, 0]
    for joint in skeleton.path(skeleton.role("hips"))[1:] if known else ():
        with jax.enable_x64(True):
            place = place + np.asarray(quaternion.rotate(turn, clip.positions[0, joint]))
            turn = np.asarray(quaternion.multiply(turn, rotations[0, joint]))
    return place, turn


def reframe(
    clip: Clip, world: Float[np.ndarray, "3 3"], frames: Float[np.ndarray, "J 3 3"], scale: float = 1.0
) -> Clip:
    """The same motion seen in a world turned by `world`, in joint frames turned by `frames`, `scale` times as large.

    World rotations G become `world G frame^-1`, positions are turned by `world` and scaled; all are rotations.
    """
    above = np.stack([world if parent < 0 else frames[parent] for parent in clip.skeleton.parents])
    run = jax.jit(_reframed)
    rotations, positions = in_float64(
        lambda turns, places: run(turns, places, above, frames), local_quaternions(clip), clip.positions
    )
    offsets = scale * np.einsum("jab,jb->ja", above, clip.skeleton.offsets)
    skeleton = Skeleton(clip.skeleton.names, clip.skeleton.parents, offsets, clip.skeleton.roles)
    return with_quaternions(clip._replace(skeleton=skeleton), rotations, scale * positions)


def lead(clip: Clip, joint: int) -> Clip:
    """The same motion with the joints above `joint` moved to it in every frame, so that joint 0 goes with it.

    For files that leave joint 0 at the origin and move the hips below it: only the translation of joint 0 is kept
    in a BVH. All joints but those above `joint` stay where they are in world.
    """
    skeleton = clip.skeleton
    path = skeleton.path(joint)
    places, axes = world_frames(clip)
    positions, offsets = clip.positions.copy(), skeleton.offsets.copy()
    rest = np.cumsum(offsets[path], axis=0)
    for child, parent in enumerate(skeleton.parents):
        if parent in path[:-1] and child not in path:
            arm = places[:, child] - places[:, joint]
            positions[:, child] = np.einsum("tba,tb->ta", axes[:, parent], arm)
            offsets[child] += rest[path.index(parent)] - rest[-1]
    positions[:, path], offsets[path] = 0.0, 0.0
    positions[:, 0], offsets[0] = places[:, joint], rest[-1]
    skeleton = Skeleton(skeleton.names, skeleton.parents, offsets, skeleton.roles)
    return clip._replace(skeleton=skeleton, positions=positions)


def _reframed(
    turns: Float[Array, "T J 4"],
    places: Float[Array, "T J 3"],
    above: Float[Array, "J 3 3"],
    frames: Float[Array, "J 3 3"],
) -> tuple[Float[Array, "T J 4"], Float[Array, "T J 3"]]:
    parent, own = (quaternion.from_matrix(matrix)[None] for matrix in (above, frames))
    turned = quaternion.multiply(quaternion.multiply(parent, turns), quaternion.inverse(own))
    return turned, quaternion.rotate(parent, places)


def fit(clip: Clip, skeleton: Skeleton, name: str) -> Clip:
    """The clip with its joints in the order of `skeleton`, whose names and parents it must have.

    ValueError where it has not; `name` says in the error what the clip is ("style example 'old.bvh'").
    """
    own = clip.skeleton
    if own.names == skeleton.names and own.parents == skeleton.parents:
        return clip
    missing = [joint for joint in skeleton.names if joint not in own.names]
    unknown = [joint for joint in own.names if joint not in skeleton.names]
    if missing or unknown:
        first = f"first missing: '{missing[0]}'" if missing else f"first unknown: '{unknown[0]}'"
        raise ValueError(f"{name} has {len(own)} joints, the model was trained on {len(skeleton)}; {first}.")
    for joint, parent in zip(skeleton.names, skeleton.parents, strict=True):
        found, wanted = own.parents[own.index(joint)], skeleton.names[parent] if parent >= 0 else None
        if (own.names[found] if found >= 0 else None) != wanted:
            raise ValueError(f"{name} has joint '{joint}' under another parent than '{wanted}', the model's.")
    order = np.asarray([own.index(joint) for joint in skeleton.names])
    return clip._replace(
        skeleton=Skeleton(skeleton.names, skeleton.parents, own.offsets[order], skeleton.roles),
        orders=tuple(clip.orders[joint] for joint in order),
        euler=clip.euler[:, order],
        positions=clip.positions[:, order],
    )
