"""Golden case `losses`: the 17 terms, the divergence, the total, their gradients and the kinematics they compare."""

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from zeggs_jax.motion import kinematics
from zeggs_jax.motion.pose import Pose, Root
from zeggs_jax.motion.skeleton import REFERENCE_PARENTS
from zeggs_jax.zeroeggs import losses
from zeggs_jax.zeroeggs.style_encoder import StyleDistribution

from .golden import Row, allowed, max_error, meta, read_arrays, read_case

STAGE, FILE = "losses", "losses.npz"
POSE = ("root_pos", "root_rot", "root_vel", "root_vrt", "lpos", "ltxy", "lvel", "lvrt")  # the release's names
TERMS = (
    "root_pos", "root_rot", "root_vel", "root_vrt", "lpos", "lrot", "lvel", "lvrt",
    "cpos", "crot", "cvel", "cvrt", "ldvl", "ldvt", "cdvl", "cdvt", "gaze", "kl_div",
)  # fmt: skip
"""The release's names of the fields of Terms, in their order, then of the divergence."""

RELATIVE = 1e-6  # of a loss value in float32, as the set's README advises
EXACT = 1e-9  # of the largest value in float64
QUANTILE = 0.999  # of a gradient's entries: the loss is L1, an entry near zero error may flip its sign
NORM = 1e-4  # of a gradient's norm

Arrays = dict[str, np.ndarray]


def check(golden: Path, reference: Path | None = None) -> Iterator[Row]:
    """A row for every quantity, in float32, and in float64 where the set has it."""
    folder = golden / STAGE
    if not (folder / FILE).exists():
        raise ValueError(f"'{folder}' holds no {FILE} to check.")
    case, stored = read_case(folder), read_arrays(folder / FILE)
    for key, value in compute(case, stored, np.float32).items():
        yield from rows(case, key, value, stored[key])
    if not any(key.endswith("__f64") for key in stored):
        return
    with jax.enable_x64(True):
        for key, value in compute(case, stored, np.float64).items():
            if f"{key}__f64" in stored:
                about = meta(case, FILE, key)
                if kept := about.get("f64_rows"):
                    value = value[(slice(None),) * kept["axis"] + (slice(None, None, kept["step"]),)]
                error = max_error(value, stored[f"{key}__f64"])
                yield Row(STAGE, f"{key}__f64", error, EXACT * about["f32_vs_f64"]["scale"])


def rows(case: dict[str, Any], key: str, ours: np.ndarray, theirs: np.ndarray) -> Iterator[Row]:
    """Loss values relative to themselves, gradients by quantile and norm, the rest by the largest error."""
    if key in ("terms", "total", "kl_weight", "kl_div"):
        error = max_error(np.divide(ours, theirs, where=theirs != 0, out=np.ones_like(theirs)), np.ones_like(theirs))
        yield Row(STAGE, f"{key}, relative", error, RELATIVE)
    elif key.startswith("d"):
        yield from gradient_rows(STAGE, key, ours, theirs, allowed(case, FILE, key))
    else:
        scale = float(np.abs(theirs).max())
        yield Row(STAGE, key, max_error(ours, theirs), 16 * 1.2e-7 * scale)  # the set gives it no tolerance


def gradient_rows(stage: str, name: str, ours: Any, theirs: Any, atol: float) -> Iterator[Row]:
    """A high quantile of the errors against `atol`, and the norm of all of them against the gradient's."""
    ours, theirs = np.asarray(ours, np.float64), np.asarray(theirs, np.float64)
    if ours.shape != theirs.shape:
        yield Row(stage, f"{name}, shape", np.inf, 0.0)
        return
    error, norm = np.abs(ours - theirs), np.linalg.norm(theirs)
    yield Row(stage, f"{name}, {QUANTILE:.1%} of entries", float(np.quantile(error, QUANTILE)), atol)
    yield Row(stage, f"{name}, norm", float(np.linalg.norm(error)), NORM * float(norm))


def compute(case: dict[str, Any], stored: Arrays, dtype: Any) -> Arrays:
    """Our value of every output and intermediate array of the case."""
    described = case["files"][FILE]["arrays"]
    given = {key: stored[key].astype(dtype) for key in stored if described.get(key, {}).get("role") == "input"}
    predicted, target = (pose_of(given, prefix) for prefix in ("O_", "W_"))
    style = StyleDistribution(jnp.asarray(given["mu"]), jnp.asarray(given["logvar"]))
    frame_time, gaze = case["dt"], jnp.asarray(given["W_gaze_pos"])
    ours: dict[str, Any] = {key: [] for key in ("terms", "total", "kl_weight", "kl_div", "d_mu", "d_logvar")}
    by_pose = predicted
    for step in given["iterations"]:
        (total, terms), (by_pose, by_style) = losses_and_gradients(
            predicted, target, gaze, style, step, REFERENCE_PARENTS, frame_time
        )
        ours["total"].append(total)
        ours["terms"].append([terms[name.removeprefix("loss_")] for name in case["terms"]])
        ours["kl_weight"].append(losses.kl_weight(step))
        ours["kl_div"].append(jnp.mean(jax.vmap(losses.kl)(style)))
        ours["d_mu"].append(by_style.mean)
        ours["d_logvar"].append(by_style.log_var)
    ours |= {f"dO_{name}": value for name, value in zip(POSE, (*by_pose.root, *by_pose[1:]), strict=True)}
    for prefix, motion in (("W_", target), ("O_", predicted)):
        if f"{prefix}cpos" not in described:
            continue
        kept = slice(None, None, int(re.findall(r"::(\d+)", described[f"{prefix}cpos"]["meaning"])[0]))
        world = jax.vmap(partial(kinematics.place, parents=REFERENCE_PARENTS))(motion).world
        world = np.moveaxis(np.asarray(world), -1, 1)[:, kept].transpose(0, 1, 4, 2, 3)  # [B, t, J, 3, 6]
        ours |= {f"{prefix}{name}": world[..., i] for i, name in enumerate(("cpos", "cvel", "cvrt"))}
        ours[f"{prefix}cmat"] = world[..., kinematics.AXES]
    return {key: np.array(value, dtype) for key, value in ours.items() if key in stored}


@partial(jax.jit, static_argnames=("parents", "frame_time"))
def losses_and_gradients(
    predicted: Pose,
    target: Pose,
    gaze: Any,
    style: StyleDistribution,
    step: Any,
    parents: Any,
    frame_time: Any,
) -> tuple[Any, Any]:
    """((total, terms by the release's names), gradients by prediction and style) of a batch."""

    def loss(predicted: Pose, style: StyleDistribution) -> tuple[Any, dict[str, Any]]:
        clips = jax.vmap(partial(losses.reconstruction, parents=parents, frame_time=frame_time))
        terms = jax.tree.map(jnp.mean, clips(predicted, target, gaze))
        divergence = losses.kl_weight(step) * jnp.mean(jax.vmap(losses.kl)(style))
        return losses.total(terms, divergence), dict(zip(TERMS, (*terms, divergence), strict=True))

    return jax.value_and_grad(loss, argnums=(0, 1), has_aux=True)(predicted, style)


def pose_of(arrays: Arrays, prefix: str) -> Pose:
    """The Pose that a set stores under `prefix` and the release's names."""
    pos, rot, *rest = (jnp.asarray(arrays[f"{prefix}{name}"]) for name in POSE)
    return Pose(Root(pos, rot), *rest)
