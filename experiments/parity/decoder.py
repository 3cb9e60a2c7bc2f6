"""Golden case `decoder`: the first step in detail, rollouts, and some frames (`frames`) out of a long one."""

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from zeggs_jax.data.scale import Scales
from zeggs_jax.motion.pose import Pose, Root
from zeggs_jax.zeroeggs import decoder as d
from zeggs_jax.zeroeggs import folded
from zeggs_jax.zeroeggs.config import ZeroEggsConfig
from zeggs_jax.zeroeggs.torch_weights import read_scales

from .golden import Row, present_files, read_arrays, read_case, recipe
from .left_out import leave_out
from .networks import Arrays, parameters, rows, state_dict

STAGE = "decoder"


def check(golden: Path, reference: Path | None) -> Iterator[Row]:
    """Every file of the folder. Without `reference` (its statistics): the networks alone, for one step."""
    folder = golden / STAGE
    case = read_case(folder)
    for file in present_files(folder, case):
        name, arrays = file.removesuffix(".npz"), read_arrays(folder / file)
        long = case.get(name) if name not in case["configs"] else None
        spec = case["configs"].get(_weights_of(name, long))
        if spec is None:
            yield Row(STAGE, f"{name}: case.json does not say with which network", float("inf"), 0.0)
            continue
        config = ZeroEggsConfig(
            frame_time=case["dt"],
            decoder=d.DecoderConfig(spec["hidden_size"], spec["num_rnn_layers"], spec["rnn_cond"]),
        )
        state = state_dict(case, file, arrays, spec)
        if reference is None or "in_root_pos" not in arrays:
            why = "needs --reference" if reference is None else "needs the first pose, in_*"
            leave_out(STAGE, name if long else f"{name}, the rollout", why)
            if not long:
                yield from rows(STAGE, case, file, arrays, _networks_alone(arrays, state, config), part=True)
            continue
        scales = read_scales(read_arrays(reference / "v1" / "stats.npz"), config)
        if long and "speech" not in arrays:
            arrays["speech"] = _long_speech(long, spec["speech_encoding_size"])
        yield from rows(STAGE, case, file, arrays, _whole(arrays, state, config, scales))
        if folded.fits(config.decoder):
            for row in rows(STAGE, case, file, arrays, _folded(arrays, state, config, scales), part=True):
                yield row._replace(name=f"{row.name}, folded")


def _weights_of(name: str, long: dict[str, Any] | None) -> str:
    """The config whose weights a file uses: its own, or for a long rollout the one in "weights": "as <config>"."""
    found = re.match(r"as (\w+)", str(long.get("weights", ""))) if long else None
    return found[1] if found else name


def _long_speech(about: dict[str, Any], size: int) -> np.ndarray:
    """The recipe's array; its name is the one quoted in case.json."""
    shape = (1, about["T"], size)
    quoted = re.search(r"'([^']+)'", about.get("speech", ""))
    return recipe(
        quoted[1] if quoted else "long.speech", shape, about["recipe_seed"], float(np.sqrt(np.prod(shape[1:])))
    )


def _networks_alone(arrays: Arrays, state: Arrays, config: ZeroEggsConfig):
    """Hidden state and first prediction from the stored, already scaled observations."""

    def run(dtype: Any) -> dict[str, Any]:
        network: Any = d.Decoder(config.decoder)
        params = {"params": parameters(STAGE, state, config, dtype)}

        @jax.vmap
        def one(seen0, seen1, frames):
            frame0, frame1 = (jax.tree.map(lambda a, t=t: a[t], frames) for t in range(2))
            hidden = network.apply(params, seen0, frame0.style, method="begin")
            return hidden, *network.apply(params, seen1, frame1, hidden, method="predict")

        kind = "__f64" if dtype is np.float64 else ""
        seen0, seen1 = (jnp.asarray(arrays[f"step_pose{t}{kind}"], dtype) for t in range(2))
        hidden0, predicted, hidden1 = one(seen0, seen1, _frames(arrays, dtype))
        return {
            "step_hidden0": hidden0.swapaxes(0, 1),
            "step_predicted": predicted,
            "step_hidden1": hidden1.swapaxes(0, 1),
        }

    return run


def _whole(arrays: Arrays, state: Arrays, config: ZeroEggsConfig, scales: Scales):
    """Observation, hidden state, prediction of the first step, and the rollout."""

    def run(dtype: Any) -> dict[str, Any]:
        params = parameters(STAGE, state, config, dtype)
        own = jax.tree.map(lambda a: jnp.asarray(a, dtype), scales)

        @jax.vmap
        def one(first: Pose, frames: d.Frame):
            frame0, frame1 = (jax.tree.map(lambda a, t=t: a[t], frames) for t in range(2))
            begun = d.begin(params, config.decoder, own, first, frame0)
            seen = [d.observe(first, frame.target, own.pose_in) for frame in (frame0, frame1)]
            predicted, hidden = d.predict(params, config.decoder, seen[1], frame1, begun.hidden)
            poses = d.rollout(params, config.decoder, own, first, frames, config.frame_time)
            return seen, begun.hidden, predicted, hidden, poses

        seen, hidden0, predicted, hidden1, poses = one(_first(arrays, dtype), _frames(arrays, dtype))
        ours = {
            "step_pose0": seen[0],
            "step_hidden0": hidden0.swapaxes(0, 1),
            "step_pose1": seen[1],
            "step_predicted": predicted,
            "step_hidden1": hidden1.swapaxes(0, 1),
        }
        kept = arrays.get("frames", slice(None))
        return ours | {f"out_{name}": value[:, kept] for name, value in _released(poses).items()}

    return run


def _folded(arrays: Arrays, state: Arrays, config: ZeroEggsConfig, scales: Scales):
    """The rollout in the decoder's fast form."""

    def run(dtype: Any) -> dict[str, Any]:
        params = parameters(STAGE, state, config, dtype)
        own = jax.tree.map(lambda a: jnp.asarray(a, dtype), scales)
        form = folded.fold(params, config.decoder, own, config.frame_time)
        poses = jax.vmap(partial(folded.rollout, params, form, config.decoder, own))(
            _first(arrays, dtype), _frames(arrays, dtype)
        )
        kept = arrays.get("frames", slice(None))
        return {f"out_{name}": value[:, kept] for name, value in _released(poses).items()}

    return run


def _first(arrays: Arrays, dtype: Any) -> Pose:
    part = {key.removeprefix("in_"): jnp.asarray(value, dtype) for key, value in arrays.items() if key[:3] == "in_"}
    root = Root(part.pop("root_pos"), part.pop("root_rot"))
    return Pose(root, *(part[name] for name in ("root_vel", "root_vrt", "lpos", "ltxy", "lvel", "lvrt")))


def _frames(arrays: Arrays, dtype: Any) -> d.Frame:
    """Speech, style and target of every frame; in the long rollout the last two are one row for all."""
    count = arrays["speech"].shape[1]
    parts = [arrays[key] for key in ("speech", "style", "gaze_pos")]
    full = [np.broadcast_to(a, (a.shape[0], count, a.shape[2])) if a.shape[1] == 1 else a for a in parts]
    return d.Frame(*(jnp.asarray(a, dtype) for a in full))


def _released(poses: Pose) -> dict[str, Any]:
    """The arrays of a Pose under the release's names."""
    root, *rest = poses
    names = ("root_pos", "root_rot", "root_vel", "root_vrt", "lpos", "ltxy", "lvel", "lvrt")
    return dict(zip(names, (*root, *rest), strict=True))
