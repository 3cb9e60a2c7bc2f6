"""Golden case `speech_encoder`: layers and output; the published weights on real features."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from zeggs_jax.data import scale
from zeggs_jax.data.scale import Scale
from zeggs_jax.zeroeggs import torch_pickle
from zeggs_jax.zeroeggs.config import ZeroEggsConfig
from zeggs_jax.zeroeggs.speech_encoder import SpeechEncoder, SpeechEncoderConfig

from .golden import Row, present_files, read_arrays, read_case
from .left_out import leave_out
from .networks import Arrays, parameters, rows, state_dict

STAGE = "speech_encoder"


def check(golden: Path, reference: Path | None) -> Iterator[Row]:
    """Every file of the folder; the published weights only with `reference`."""
    folder = golden / STAGE
    case = read_case(folder)
    for file in present_files(folder, case):
        arrays, spec = read_arrays(folder / file), case.get(file.removesuffix(".npz"), {})
        if "file" in spec:
            if reference is not None:
                yield from _published(case, file, arrays, spec, reference)
            else:
                leave_out(STAGE, file, "needs --reference")
            continue
        stored = read_arrays(folder / "small.npz") if file == "small_short.npz" else arrays
        state = state_dict(case, file, stored, spec)
        yield from rows(STAGE, case, file, arrays, lambda dtype, a=arrays, s=state: _run(s, a["x"], dtype))


def _network(state: Arrays, dtype: Any) -> tuple[Any, Any]:
    hidden, features, _ = state["layer0.weight"].shape
    size, _, kernel = state["layer1.weight"].shape
    config = ZeroEggsConfig(speech=SpeechEncoderConfig(features, hidden, size, kernel))
    return SpeechEncoder(config.speech), parameters(STAGE, state, config, dtype)


def _run(state: Arrays, x: np.ndarray, dtype: Any) -> dict[str, Any]:
    encoder, params = _network(state, dtype)

    def one(clip):
        return encoder.apply({"params": params}, clip, capture_intermediates=True)

    y, kept = jax.vmap(one)(jnp.asarray(x, dtype))
    layers = kept["intermediates"]
    before = {f"layer{i}": jnp.swapaxes(layers[f"conv{i}"]["__call__"][0], 1, 2) for i in range(2)}
    return {**before, "y": y}


def _published(case: dict, file: str, arrays: Arrays, spec: dict, reference: Path) -> Iterator[Row]:
    path = reference / spec["file"].removeprefix("reference/")
    state = torch_pickle.read(path.read_bytes(), path.name)
    name = file.removesuffix(".npz")
    for key, sums in spec["tensors"].items():
        weights = state[key].astype(np.float64)
        error = max(abs(weights.sum() - sums["sum_f64"]), abs(np.square(weights).sum() - sums["sumsq_f64"]))
        yield Row(STAGE, f"{name}/w.{key}", error, 1e-9)
    stats = read_arrays(path.parent / "stats.npz")

    def run(dtype: Any) -> dict[str, Any]:
        encoder, params = _network(state, dtype)
        scaling = Scale(stats["audio_input_mean"].astype(dtype), stats["audio_input_std"].astype(dtype))
        ours = {}
        for key in arrays:
            if key.startswith("features_"):
                x = scale.apply(scaling, jnp.asarray(arrays[key], dtype))
                ours["x" + key.removeprefix("features")] = x[None]
                ours["y" + key.removeprefix("features")] = encoder.apply({"params": params}, x)[None]
        return ours

    yield from rows(STAGE, case, file, arrays, run)
