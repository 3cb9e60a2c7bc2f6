"""What the network stages share: the set's weights as our parameters, and rows in float32 and in float64."""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np

from zeggs_jax.zeroeggs.config import ZeroEggsConfig
from zeggs_jax.zeroeggs.torch_names import rename, torch_names

from .golden import Row, compare, max_error, meta, recipe

Arrays = dict[str, np.ndarray]


def state_dict(case: dict[str, Any], file: str, arrays: Arrays, spec: dict[str, Any]) -> Arrays:
    """A network's weights: stored as `w.<name>`, else made by the recipe from the names and shapes."""
    stored = {key.removeprefix("w."): value for key, value in arrays.items() if key.startswith("w.")}
    if stored:
        return stored
    made = spec if "tensors" in spec else spec.get("weights", {})
    if isinstance(made, dict):
        shapes = {name: tensor["shape"] for name, tensor in made["tensors"].items()}
    else:
        described = case["files"][file]["arrays"]
        shapes = {key.removeprefix("w."): value["shape"] for key, value in described.items() if key.startswith("w.")}
        made = spec
    return {
        name: recipe(name, tuple(shape), made["recipe_seed"], made.get("gain", 1.0)) for name, shape in shapes.items()
    }


def parameters(network: str, state: Arrays, config: ZeroEggsConfig, dtype: Any = np.float32) -> dict[str, Any]:
    """Our parameters of one network ('speech_encoder', 'style_encoder', 'decoder') from its state_dict."""
    names = {ours: name for ours, name in torch_names(config).items() if name.startswith(f"{network}/")}
    arrays = {f"{network}/{name}": array.astype(dtype) for name, array in state.items()}
    return next(iter(rename(arrays, names).values()))


def rows(
    stage: str,
    case: dict[str, Any],
    file: str,
    arrays: Arrays,
    run: Callable[[Any], dict[str, Any]],
    float64_error: float = 1e-9,
    part: bool = False,
) -> Iterator[Row]:
    """A row for every output and intermediate array of `file`; `run(dtype)` gives them (some, if a `part`).

    float32 against the reference's float32 within its own tolerance; float64 against its float64 within
    `float64_error` of the largest value, at the frames that were kept.
    """
    ours = run(np.float32)
    described = case["files"][file]["arrays"]
    stored = {key for key in arrays if described.get(key, {}).get("role") in ("output", "intermediate")}
    if not part and stored - set(ours):
        raise ValueError(f"nothing was computed for {sorted(stored - set(ours))} of '{file}'.")
    for key, value in ours.items():
        if key in stored:
            yield compare(stage, case, file, key, value, arrays[key])
    if not any(f"{key}__f64" in arrays for key in ours):
        return
    with jax.enable_x64(True):
        exact = {key: np.asarray(value) for key, value in run(np.float64).items()}
    for key, value in exact.items():
        if f"{key}__f64" in arrays:
            about = meta(case, file, key)
            if kept := about.get("f64_rows"):
                value = value[(slice(None),) * kept["axis"] + (slice(None, None, kept["step"]),)]
            error = max_error(value, arrays[f"{key}__f64"])
            scale = about["f32_vs_f64"]["scale"]
            yield Row(stage, f"{file.removesuffix('.npz')}/{key}__f64", error, float64_error * max(scale, 1.0))
