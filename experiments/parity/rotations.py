"""Rotations: every array of the golden set's `rotations` folder, in float32 and in float64, and gradients.

The release has each function twice, for NumPy (preprocessing, BVH) and for PyTorch (networks, losses). Ours
follow the PyTorch side; the functions below whose name begins with `_numpy` reproduce the NumPy side instead.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from parity.golden import Row, meta, read_arrays, read_case
from parity.left_out import leave_out
from zeggs_jax.geometry import quaternion as Q
from zeggs_jax.geometry import rotation as R
from zeggs_jax.motion.kinematics import World, forward
from zeggs_jax.motion.pose import Pose, Root

Arrays = dict[str, Any]
STAGE = "rotations"
ORDERS = ("zyx", "xzy", "xyz", "yxz", "yzx", "zxy")
# Their inputs have unit length in float32 only and are made unit, or used as they are, in different places.
UNIT_ONLY_IN_FLOAT32 = frozenset(
    f"{key}__f64"
    for key in (
        *("from_angle_axis", "quat_from_angle_axis", "slerp", "mul_scalar", "from_xform", "to_euler_xzy"),
        *("orthogonalize_from_xy", "from_xform_of_orthogonalized"),
        *(f"{fk}_{part}" for fk in ("fk", "fk_vel", "quat_fk", "quat_fk_vel") for part in ("rot", "pos", "vrt", "vel")),
        *(f"xform_fk_vel_{part}" for part in ("mat", "pos", "vrt", "vel")),
    )
)


def check(golden: Path, reference: Path | None = None) -> Iterator[Row]:
    """One row per recorded array and precision; rows that are ill conditioned by nature are left out."""
    case = read_case(golden / STAGE)
    tables = {"quat_np.npz": NUMPY, "torch.npz": TORCH, "xform_np.npz": MATRIX, "grads.npz": GRADIENTS}
    present = [file for file in tables if (golden / STAGE / file).exists()]
    if not present:
        raise FileNotFoundError(f"'{golden / STAGE}' holds none of {', '.join(tables)}.")
    for file in set(case["files"]) - set(tables):
        leave_out(STAGE, file, "no check for this file")
    for file in present:
        arrays = read_arrays(golden / STAGE / file)
        outputs = [key for key, entry in case["files"][file]["arrays"].items() if entry["role"] == "output"]
        # The release's NumPy side works in float64 (its results say so), and so does our preparation.
        preparation = file in ("quat_np.npz", "xform_np.npz")
        double = _run(tables[file], arrays, np.float64)
        single = double if preparation else _run(tables[file], arrays, np.float32)
        for key in outputs:
            entry, label = meta(case, file, key), f"{file.removesuffix('.npz')}/{key}"
            yield _row(label, entry, single[key], arrays[key])
            if f"{key}__f64" in arrays:
                yield _row_float64(f"{label}__f64", entry, double[key], arrays[f"{key}__f64"])


def _run(table: dict[str, Callable[[Arrays], Any]], arrays: Arrays, dtype: type) -> dict[str, np.ndarray]:
    """All functions of a table on the recorded inputs."""
    with jax.enable_x64(dtype is np.float64):
        recorded = {key: array for key, array in arrays.items() if not key.endswith("__f64")}
        inputs = {k: jnp.asarray(v, dtype if v.dtype == np.float32 else v.dtype) for k, v in recorded.items()}
        return {key: np.asarray(function(inputs)) for key, function in table.items()}


def _well_conditioned(entry: dict[str, Any], expected: np.ndarray) -> np.ndarray:
    """Rows to compare; where the release's slerp of (nearly) equal quaternions is zero is left out too."""
    rows = np.ones(len(expected), bool)
    rows[[int(row) for row in entry["f32_vs_f64"].get("ill_conditioned_rows", {})]] = False
    if entry["meaning"].startswith(("slerp", "mul_scalar")):
        rows &= _largest(expected) > 0
    return rows


def _largest(x: np.ndarray) -> np.ndarray:
    """Largest entry of each row."""
    return np.abs(x).reshape(len(x), -1).max(axis=1)


def _row(label: str, entry: dict[str, Any], ours: np.ndarray, expected: np.ndarray) -> Row:
    """Largest error of a row relative to its largest entry (of zeros: to float32 rounding of the array)."""
    rows = _well_conditioned(entry, expected)
    size = np.maximum(_largest(expected), np.finfo(np.float32).eps * np.abs(expected[rows]).max())
    error = (_largest(ours - expected) / size)[rows].max()
    return Row(STAGE, label, float(error), entry["f32_vs_f64"]["suggested_row_rtol"])


def _row_float64(label: str, entry: dict[str, Any], ours: np.ndarray, expected: np.ndarray) -> Row:
    """Largest error relative to the array's largest value: 1e-9, as the set's README suggests."""
    rows = _well_conditioned(entry, expected)
    error = _largest(ours - expected)[rows].max() / np.abs(expected)[rows].max()
    return Row(STAGE, label, float(error), 1e-6 if label.split("/")[1] in UNIT_ONLY_IN_FLOAT32 else 1e-9)


def _numpy_exp(half: jax.Array) -> jax.Array:
    """NumPy side: below 1e-5 it is (1, v), ours is the same divided by its length (plus 1e-5)."""
    q = Q.exp(half)
    small = jnp.linalg.norm(half, axis=-1, keepdims=True) < Q.SMALL
    return jnp.where(small, q / q[..., :1], q)


def _numpy_to_euler_xzy(z: Arrays) -> jax.Array:
    """NumPy side: asked for xzy it returns the angles of order yzx, as columns x, y, z."""
    y_z_x = Q.to_euler(z["q"], "yzx")
    return jnp.stack([y_z_x[:, 2], y_z_x[:, 0], y_z_x[:, 1]], axis=-1)


def _angle_axis(z: Arrays) -> jax.Array:
    """Exponential of an axis times half an angle, without the linear branch at small angles."""
    return _numpy_exp(z["axis"] * z["angle"][:, None] * 0.5)


def _tree(z: Arrays, mat: jax.Array, moving: bool = True) -> World:
    """World values of the recorded tree of joints."""
    parents = tuple(int(parent) for parent in z["parents"])
    still = jnp.zeros_like(z["lpos"])
    vel, ang = (z["lvel"], z["lvrt"]) if moving else (still, still)
    zero = jnp.zeros_like(still[:, 0])
    root = Root(zero, jnp.zeros((len(zero), 4), zero.dtype).at[:, 0].set(1.0))
    pose = Pose(root, zero, zero, z["lpos"], R.matrix_to_axes(mat), vel, ang)
    return _forward(pose, parents)


@partial(jax.jit, static_argnums=1)
def _forward(poses: Pose, parents: tuple[int, ...]) -> World:
    return jax.vmap(lambda pose: forward(pose, parents))(poses)


def _tree_rotation(z: Arrays) -> jax.Array:
    """Quaternions of our world matrices, in the sign that products of the local quaternions have."""
    q = Q.from_matrix(_tree(z, Q.to_matrix(z["lrot"])).mat)
    by_product: list[jax.Array] = []
    for joint, parent in enumerate(np.asarray(z["parents"])):
        local = z["lrot"][:, joint]
        by_product.append(local if parent < 0 else Q.multiply(by_product[parent], local))
    dot = jnp.sum(q * jnp.stack(by_product, axis=1), axis=-1, keepdims=True)
    return jnp.where(dot < 0, -q, q)


def _kinematics(fk: str, fk_vel: str) -> dict[str, Callable[[Arrays], Any]]:
    """The four arrays of forward kinematics, and the two without velocities."""
    return {
        f"{fk}_rot": _tree_rotation,
        f"{fk}_pos": lambda z: _tree(z, Q.to_matrix(z["lrot"]), moving=False).pos,
        f"{fk_vel}_rot": _tree_rotation,
        f"{fk_vel}_pos": lambda z: _tree(z, Q.to_matrix(z["lrot"])).pos,
        f"{fk_vel}_vrt": lambda z: _tree(z, Q.to_matrix(z["lrot"])).ang,
        f"{fk_vel}_vel": lambda z: _tree(z, Q.to_matrix(z["lrot"])).vel,
    }


def _ahead(z: Arrays) -> jax.Array:
    return jnp.broadcast_to(jnp.array([0.0, 0.0, 1.0], z["fwd"].dtype), z["fwd"].shape)


NUMPY: dict[str, Callable[[Arrays], Any]] = {
    "mul": lambda z: Q.multiply(z["q"], z["p"]),
    "mul_vec": lambda z: Q.rotate(z["q"], z["v"]),
    "inv": lambda z: Q.inverse(z["q"]),
    "abs": lambda z: Q.positive(z["q"]),
    "log": lambda z: Q.log(z["q"]),
    "exp": lambda z: _numpy_exp(z["h"]),
    "to_helical": lambda z: Q.to_scaled_axis(z["q"]),
    "from_helical": lambda z: _numpy_exp(z["h"] * 0.5),
    "from_angle_axis": _angle_axis,
    "diff_world": lambda z: Q.positive(Q.multiply(z["q"], Q.inverse(z["p"]))),
    "diff_local": lambda z: Q.positive(Q.multiply(Q.inverse(z["p"]), z["q"])),
    "normalize": lambda z: Q.normalize(jnp.float32(z["q"]) * (1 + jnp.float32(z["a"][:, None])) + 0 * z["q"]),
    "between": lambda z: Q.between(z["v"], z["w"]),
    "slerp": lambda z: Q.slerp(z["q"], z["p"], z["a"]),
    "mul_scalar": lambda z: Q.slerp(jnp.zeros_like(z["q"]).at[:, 0].set(1.0), z["q"], z["a"]),
    "to_xform": lambda z: Q.to_matrix(z["q"]),
    "from_xform": lambda z: Q.from_matrix(Q.to_matrix(z["q"])),
    **{f"from_euler_{order}": (lambda z, order=order: Q.from_euler(z["e"], order)) for order in ORDERS},
    "to_euler_zyx": lambda z: Q.to_euler(z["q"], "zyx"),
    "to_euler_xzy": _numpy_to_euler_xzy,
    "unroll": lambda z: Q.unroll(z["seq"]),
    "between_z_fwd_normalized": lambda z: Q.normalize(Q.between(_ahead(z), z["fwd"])),
    **_kinematics("fk", "fk_vel"),
}

TORCH: dict[str, Callable[[Arrays], Any]] = {
    "quat_mul": lambda z: Q.multiply(z["q"], z["p"]),
    "quat_mul_vec": lambda z: Q.rotate(z["q"], z["v"]),
    "quat_inv": lambda z: Q.inverse(z["q"]),
    "quat_inv_mul": lambda z: Q.multiply(Q.inverse(z["q"]), z["p"]),
    "quat_inv_mul_vec": lambda z: Q.rotate(Q.inverse(z["q"]), z["v"]),
    "quat_abs": lambda z: Q.positive(z["q"]),
    "quat_diff_world": lambda z: Q.positive(Q.multiply(z["q"], Q.inverse(z["p"]))),
    "quat_diff_local": lambda z: Q.positive(Q.multiply(Q.inverse(z["p"]), z["q"])),
    "quat_diff_linear": lambda z: 2.0 * Q.positive(Q.multiply(z["q"], Q.inverse(z["p"])))[:, 1:],
    "quat_normalize": lambda z: Q.normalize(z["p"], Q.SMALL),
    "quat_to_xform": lambda z: Q.to_matrix(z["q"]),
    "quat_to_xy": lambda z: Q.to_matrix(z["q"])[..., :2],
    "quat_log": lambda z: Q.log(z["q"]),
    "quat_exp": lambda z: Q.exp(z["h"]),
    "quat_to_helical": lambda z: Q.to_scaled_axis(z["q"]),
    "quat_from_helical": lambda z: Q.from_scaled_axis(z["h"]),
    "quat_from_helical_approx": lambda z: Q.normalize(
        jnp.concatenate([jnp.ones_like(z["h"][:, :1]), z["h"] * 0.5], axis=-1), Q.SMALL
    ),
    "quat_from_angle_axis": _angle_axis,
    **_kinematics("quat_fk", "quat_fk_vel"),
    "modules_normalize": lambda z: Q.normalize(z["v"], 1e-8),
    "xform_orthogonalize_from_xy": lambda z: R.axes_to_matrix(z["xy"]),
    "xform_fk_vel_mat": lambda z: _tree(z, z["lmat"]).mat,
    "xform_fk_vel_pos": lambda z: _tree(z, z["lmat"]).pos,
    "xform_fk_vel_vrt": lambda z: _tree(z, z["lmat"]).ang,
    "xform_fk_vel_vel": lambda z: _tree(z, z["lmat"]).vel,
}

MATRIX: dict[str, Callable[[Arrays], Any]] = {
    "orthogonalize_from_xy": lambda z: R.axes_to_matrix(z["xy"]),
    "from_xform_of_orthogonalized": lambda z: R.axes_to_quaternion(z["xy"]),
    **{f"from_euler_{order}": (lambda z, order=order: Q.to_matrix(Q.from_euler(z["e"], order))) for order in ORDERS},
    "from_angle_axis": lambda z: Q.to_matrix(_angle_axis(z)),
}


def _gradient(function: Callable[..., jax.Array], names: str, cotangent: str, by: int = 0) -> Callable[..., Any]:
    """Reverse-mode gradient of `sum(function * cotangent)` by one argument."""

    def run(z: Arrays) -> jax.Array:
        arguments = [z[name] for name in names.split()]
        return jax.grad(lambda *args: jnp.sum(function(*args) * z[cotangent]), argnums=by)(*arguments)

    return run


GRADIENTS: dict[str, Callable[[Arrays], Any]] = {
    "quat_from_helical__d0": _gradient(Q.from_scaled_axis, "h", "ct4"),
    "quat_mul_vec__d0": _gradient(Q.rotate, "q v", "ct3"),
    "quat_mul_vec__d1": _gradient(Q.rotate, "q v", "ct3", by=1),
    "quat_mul__d0": _gradient(Q.multiply, "q p", "ct4"),
    "quat_mul__d1": _gradient(Q.multiply, "q p", "ct4", by=1),
    "quat_to_xform__d0": _gradient(Q.to_matrix, "q", "ct33"),
    "quat_to_helical__d0": _gradient(Q.to_scaled_axis, "q", "ct3"),
    "xform_orthogonalize_from_xy__d0": _gradient(R.axes_to_matrix, "xy", "ct33"),
    "modules_normalize__d0": _gradient(lambda v: Q.normalize(v, 1e-8), "v", "ct3"),
}
