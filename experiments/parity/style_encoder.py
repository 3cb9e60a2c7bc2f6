"""Golden case `style_encoder`: both kinds, with and without VAE, inner layers, temperature, positions."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from zeggs_jax.nn.attention import positions
from zeggs_jax.zeroeggs.config import ZeroEggsConfig
from zeggs_jax.zeroeggs.style_encoder import StyleEncoder, StyleEncoderConfig, reparameterise

from .golden import Row, max_error, present_files, read_arrays, read_case, recipe
from .networks import Arrays, parameters, rows, state_dict

STAGE = "style_encoder"


def check(golden: Path, reference: Path | None) -> Iterator[Row]:
    """Every file of the folder."""
    folder = golden / STAGE
    case = read_case(folder)
    for file in present_files(folder, case):
        arrays = read_arrays(folder / file)
        if file == "positional.npz":
            yield from _positions(arrays)
            continue
        spec = case["configs"][file.removesuffix(".npz")]
        state = state_dict(case, file, arrays, spec)
        tolerance = 1e-6 if spec["type"] == "attn" else 1e-9  # the reference's positions are float32 in both runs
        run = lambda dtype, a=arrays, c=spec, s=state: _run(c, s, a, dtype)  # noqa: E731
        yield from rows(STAGE, case, file, arrays, run, tolerance)


def _positions(arrays: Arrays) -> Iterator[Row]:
    """The table is float32 arithmetic: an angle near p is off by p * 2^-23, and so is its sine."""
    rows_kept = arrays["rows"]
    rounding = rows_kept[:, None] * 2.0**-23 + 1e-6
    for width in (64, 16):
        ours = positions(int(rows_kept.max()) + 1, width)[rows_kept]
        off = (ours - arrays[f"pos_{width}"]) / rounding
        yield Row(STAGE, f"positional/pos_{width}, in roundings", max_error(off, np.zeros_like(off)), 1.0)


def _run(spec: dict[str, Any], state: Arrays, arrays: Arrays, dtype: Any) -> dict[str, Any]:
    config = StyleEncoderConfig(spec["type"], spec["hidden_size"], spec["style_embedding_size"], spec["use_vae"])
    params = parameters(STAGE, state, ZeroEggsConfig(style=config), dtype)

    @jax.vmap
    def one(x, noise):
        encoder = StyleEncoder(config)
        style, kept = encoder.apply({"params": params}, x, x.shape[0], capture_intermediates=True)
        draws = [reparameterise(style, noise, 1 / by) for by in (1.0, 0.5)]  # the release divides by it
        return style, draws, kept["intermediates"]["encoder"]

    ours = {}
    lengths = {key.removeprefix("style_") for key in arrays if key.startswith("style_")}
    for frames in sorted(int(length) for length in lengths if length.isdigit()):
        x = jnp.asarray(_example(spec, arrays, frames), dtype)
        noise = arrays.get(f"eps_{frames}", np.zeros((len(x), config.size)))
        style, draws, inner = one(x, jnp.asarray(noise, dtype))
        ours[f"style_{frames}"], ours[f"style_{frames}_temp0.5"] = draws
        ours[f"mu_{frames}"], ours[f"logvar_{frames}"] = style
        if config.kind == "attn":
            ours[f"convs_{frames}"] = inner["norm1"]["__call__"][0]
            ours[f"attention_{frames}"] = inner["block"]["attention_norm"]["__call__"][0]
            ours[f"block_{frames}"] = inner["block"]["__call__"][0]
    return {key: value for key, value in ours.items() if key in arrays}


def _example(spec: dict[str, Any], arrays: Arrays, frames: int) -> np.ndarray:
    if "input" not in spec:
        return arrays[f"x_{frames}"]
    shape = (1, 300, spec["input_size"])
    gain = float(np.sqrt(np.prod(shape[1:])))
    return recipe("style_input.x", shape, spec["input"]["recipe_seed"], gain)[:, :frames]
