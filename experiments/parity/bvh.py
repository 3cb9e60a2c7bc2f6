"""BVH and motion features: reading, all arrays of the release's preprocessing, and written files.

Written files are compared with the release's: hierarchy as text, positions as numbers, Euler angles as
rotations (which is the same away from gimbal lock).
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from parity.golden import Row, compare, max_error, meta, read_arrays, read_case
from parity.left_out import leave_out
from zeggs_jax.geometry import quaternion, rotation
from zeggs_jax.motion import bvh, edit, features, kinematics
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.pose import Pose, Root, gaze_direction
from zeggs_jax.motion.skeleton import Skeleton

STAGE = "bvh"
DEGREES = 2e-4  # what the set's README calls safe for text of six decimals
CENTIMETRES = 1e-4
NEEDS = {
    "load.npz": "clip.bvh",
    "mini.npz": "mini6.bvh",
    "preprocess.npz": "load.npz",
    "write_bvh.bvh": "poses.npz",
    "write_bvh_start.bvh": "poses.npz",
    "save.bvh": "clip.bvh",
    "save_translations.bvh": "mini6.bvh",
}
FILES = {*NEEDS, *NEEDS.values()}


def check(golden: Path, reference: Path | None = None) -> Iterator[Row]:
    """Rows for every recorded array and file of the `bvh` folder that is there."""
    folder = golden / STAGE
    case = read_case(folder)
    rows = [
        *_loaded(folder, case, "clip.bvh", "load.npz"),
        *_loaded(folder, case, "mini6.bvh", "mini.npz"),
        *_preprocessed(folder, case),
        *_written(folder, case),
        *_saved(folder, "clip.bvh", "save.bvh", frames=24, translations=False),
        *_saved(folder, "mini6.bvh", "save_translations.bvh", frames=None, translations=True),
    ]
    if not rows:
        raise FileNotFoundError(f"'{folder}' holds nothing to check.")
    for file in set(case.get("files", {})) - FILES:
        leave_out(STAGE, file, "no check for this file")
    for file, needed in NEEDS.items():
        if (folder / file).exists() and not (folder / needed).exists():
            leave_out(STAGE, file, f"needs {needed}")
    yield from rows


def _loaded(folder: Path, case: dict[str, Any], text: str, recorded: str) -> Iterator[Row]:
    """What our reader finds in a file, to float32 rounding (the release's precision)."""
    if not ((folder / text).exists() and (folder / recorded).exists()):
        return
    clip, arrays = bvh.read(folder / text), read_arrays(folder / recorded)
    degrees = np.degrees(clip.euler)
    ours = {
        "rotations": degrees,
        "positions": clip.positions,
        "offsets": clip.skeleton.offsets,
        "parents": np.asarray(clip.skeleton.parents),
        # The release's start and end: one frame fewer than asked for, and no effect where start is 0.
        "rotations_5_15": np.degrees(edit.trim(clip, 5, 14).euler),
        "rotations_0_10": degrees,
    }
    for key, expected in arrays.items():
        allowed = float(np.finfo(np.float32).eps * np.abs(expected).max())
        yield Row(STAGE, f"{recorded.removesuffix('.npz')}/{key}", max_error(ours[key], expected), allowed)
    if recorded == "load.npz":
        loaded = case["loaded"]
        same = (list(clip.skeleton.names), clip.frame_time) == (loaded["names"], loaded["frametime"])
        yield Row(STAGE, "load/names and frame time", float(not same), 0.0)
    order = case["loaded"]["order"] if recorded == "load.npz" else case["mini_order"]
    yield Row(STAGE, f"{recorded.removesuffix('.npz')}/order", float(set(clip.orders) != {order}), 0.0)


def _recorded_clip(folder: Path, case: dict[str, Any]) -> Clip:
    """The clip that the release's preprocessing was given: load.npz, in float32."""
    arrays, loaded = read_arrays(folder / "load.npz"), case["loaded"]
    parents = tuple(int(parent) for parent in arrays["parents"])
    skeleton = Skeleton(tuple(loaded["names"]), parents, np.asarray(arrays["offsets"], np.float64))
    euler, positions = (np.asarray(arrays[key], np.float64) for key in ("rotations", "positions"))
    return Clip(skeleton, (loaded["order"],) * len(parents), np.radians(euler), positions, loaded["frametime"])


def _preprocessed(folder: Path, case: dict[str, Any]) -> Iterator[Row]:
    """All 16 arrays of the release's preprocessing, and its float64 run."""
    file = "preprocess.npz"
    if not ((folder / file).exists() and (folder / "load.npz").exists()):
        return
    arrays, clip = read_arrays(folder / file), _recorded_clip(folder, case)
    motion = features.encode(clip)
    ours = {
        **_features(motion, arrays["lrot"]),
        **_character_space(motion.pose, clip.skeleton.parents, arrays),
    }
    for key in [key for key in arrays if not key.endswith("__f64")]:
        yield compare(STAGE, case, file, key, ours[key], arrays[key])
        if f"{key}__f64" in arrays:
            entry = meta(case, file, key)
            exact, every = arrays[f"{key}__f64"], entry["f64_rows"]["step"]
            error = max_error(np.asarray(ours[key])[::every], exact)
            yield Row(STAGE, f"preprocess/{key}__f64", error, entry["f32_vs_f64"]["suggested_atol"])


def _features(motion: features.Motion, lrot: np.ndarray) -> dict[str, Any]:
    """Our features by the release's names."""
    pose = motion.pose
    gaze = jnp.broadcast_to(motion.gaze, pose.root.pos.shape)
    return {
        "root_pos": pose.root.pos,
        "root_rot": pose.root.rot,
        "root_vel": pose.root_vel,
        "root_vrt": pose.root_ang,
        "lpos": pose.joint_pos,
        "lrot": _signed_like(rotation.axes_to_quaternion(pose.joint_axes), lrot),
        "ltxy": pose.joint_axes,
        "lvel": pose.joint_vel,
        "lvrt": pose.joint_ang,
        "gaze_pos": gaze,
        "gaze_dir": gaze_direction(pose.root, gaze),
    }


def _character_space(pose: Pose, parents: tuple[int, ...], arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Joints relative to the root: forward kinematics with the root at rest in the origin."""
    still = jnp.zeros_like(pose.root_vel)
    origin = Root(still, jnp.zeros_like(pose.root.rot).at[:, 0].set(1.0))
    at_rest = pose._replace(root=origin, root_vel=still, root_ang=still)
    world = jax.vmap(lambda one: kinematics.forward(one, parents))(at_rest)
    return {
        "cpos": world.pos,
        "crot": _signed_like(quaternion.from_matrix(world.mat), arrays["crot"]),
        "ctxy": rotation.matrix_to_axes(world.mat),
        "cvel": world.vel,
        "cvrt": world.ang,
    }


def _signed_like(q: jax.Array, expected: np.ndarray) -> np.ndarray:
    """Quaternions in the sign of the expected ones: both signs are the same rotation."""
    ours = np.asarray(q)
    return np.where(np.sum(ours * expected, axis=-1, keepdims=True) < 0, -ours, ours)


def _written(folder: Path, case: dict[str, Any]) -> Iterator[Row]:
    """Poses written as generation writes them, as they are and moved to the origin."""
    if not (folder / "poses.npz").exists():
        return
    loaded = case["loaded"]
    arrays = {key: jnp.asarray(array) for key, array in read_arrays(folder / "poses.npz").items()}
    root, local = Root(arrays["V_root_pos"], arrays["V_root_rot"]), arrays["V_lpos"]
    axes, still = rotation.quaternion_to_axes(arrays["V_lrot"]), jnp.zeros_like(root.pos)
    poses = Pose(root, still, still, local, axes, local, local)
    for file, rebase in (("write_bvh.bvh", False), ("write_bvh_start.bvh", True)):
        if (folder / file).exists():
            skeleton = bvh.read(folder / file).skeleton
            clip = features.decode(poses, skeleton, loaded["frametime"], rebase=rebase)
            yield from _compare_text(file, bvh.format(clip), (folder / file).read_text())


def _saved(folder: Path, source: str, file: str, frames: int | None, translations: bool) -> Iterator[Row]:
    """A file that was read and written again."""
    if (folder / source).exists() and (folder / file).exists():
        clip = edit.trim(bvh.read(folder / source), 0, frames)
        yield from _compare_text(file, bvh.format(clip, translations), (folder / file).read_text())


def _compare_text(file: str, ours: str, expected: str) -> Iterator[Row]:
    """Hierarchy as text (the root's OFFSET, which is computed, as numbers), positions and rotations."""
    (our_tree, our_offset), (tree, offset) = _hierarchy(ours), _hierarchy(expected)
    yield Row(STAGE, f"{file}/hierarchy", float(our_tree != tree), 0.0)
    yield Row(STAGE, f"{file}/root offset", max_error(our_offset, offset), CENTIMETRES)
    a, b = bvh.parse(ours, "ours"), bvh.parse(expected, file)
    yield Row(STAGE, f"{file}/positions", max_error(a.positions, b.positions), CENTIMETRES)
    qa, qb = features.local_quaternions(a), features.local_quaternions(b)
    with jax.enable_x64(True):
        turn = quaternion.to_scaled_axis(quaternion.positive(quaternion.multiply(qa, quaternion.inverse(qb))))
        degrees = np.degrees(np.linalg.norm(turn, axis=-1))
    yield Row(STAGE, f"{file}/rotations", float(degrees.max()), DEGREES)


def _hierarchy(text: str) -> tuple[str, list[float]]:
    """All text before the first frame without the root's OFFSET, and that."""
    head = text[: text.index("\n", text.index("Frame Time"))]
    found = re.search(r"OFFSET (.*)\n", head)
    assert found is not None
    return head.replace(found[1], "", 1), [float(number) for number in found[1].split()]
