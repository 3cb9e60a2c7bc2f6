"""The one-frame step of a model as a file for engines that know no JAX: StableHLO or ONNX, with what it starts from.

The step's inputs are the speech features around a frame, the style, the target and the state that the frame before
handed on; its outputs are the next state, each joint's rotation (wxyz) in its parent's frame and the place of joint 0
(cm, y up, the body starting in the middle and facing +Z). Weights are inside. Beside the file stands a description,
NAME.json: all inputs and outputs in order, the start of each input, which output is which input of the next frame, the
body, how the features are made, and what the first frames must be (docs/STREAMING.md tells how an engine uses it).
"""

import json
import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.tree_util import keystr, tree_leaves_with_path
from jaxtyping import Array, Float

from ..motion import bvh, features
from ..motion import pose as poses
from ..motion.pose import Root
from ..nn.straight import straightened
from ..speech import features as speech_features
from ..speech import wav
from ..speech.features import SpeechFeatureConfig
from . import steering, synthesis
from .decoder import Frame
from .model import Model
from .steering import Request

NAMES = ("spectrum", "style", "target")
CHECKED = 8  # frames after the first pose, in silence, that the description tells the last of


class Step(NamedTuple):
    """The function of a frame, and the arrays that the first frame is given."""

    run: Callable[..., tuple[Array, ...]]  # (spectrum [kernel, F], style [Z], target [3], *state)
    start: dict[str, Float[np.ndarray, "..."]]  # by name, in the order of the inputs
    outputs: tuple[str, ...]


def step(model: Model, request: Request) -> Step:
    """One frame of `model`, in the fast form where there is one; it starts as `generate` does with this request.

    Raises:
        ValueError, OSError: as `generate` for styles and first poses.
    """
    space = steering.read_space(request, model)
    chosen = steering.read_styles(request, model, space)
    motion = steering.starting_pose(request, chosen, model)
    point = np.asarray(steering.style_sequence(request, chosen, 1, bvh.rate_hz(model.config.frame_time), space)[0])
    first = jax.tree.map(lambda a: np.asarray(a[0], np.float32), motion.pose)
    target = poses.gaze_direction(first.root, motion.gaze)  # in the world that the body starts in the middle of
    stand: Any = np.zeros(3, np.float32), np.array([1.0, 0.0, 0.0, 0.0], np.float32)
    middle = Root(*stand)
    config, ready = model.config, synthesis.ready(model)
    given = Frame(np.zeros(config.speech.size, np.float32), point, target)
    state = synthesis.begin(ready, config, first._replace(root=middle), given)
    leaves, form = jax.tree.flatten(state)
    names = [keystr(path, simple=True, separator="_") for path, _ in tree_leaves_with_path(state)]

    def run(spectrum: Array, style: Array, target: Array, *last: Array) -> tuple[Array, ...]:
        after, made = synthesis.advance(
            ready, config, jax.tree.unflatten(form, last), spectrum, style[None], target[None]
        )
        turns, places = features.joints(jax.tree.map(lambda a: a[0], made), middle)
        return (*jax.tree.leaves(after), turns, places[0])

    silence = speech_features.level(np.zeros((1, config.features.mels)), config.features)
    spectrum = np.tile(speech_features.with_energy(silence, config.features), (config.speech.kernel, 1))
    arrays = [np.asarray(a, np.float32) for a in (spectrum, point, target, *leaves)]
    start = dict(zip((*NAMES, *names), arrays, strict=True))
    outputs = (*(f"next_{name}" for name in names), "turns", "place")  # ONNX wants other names than the inputs'
    return Step(straightened(run, *arrays), start, outputs)


def stablehlo(made: Step) -> bytes:
    """The step as a StableHLO module, in its portable bytecode; its function is `main`."""
    from jax import export

    shapes = [jax.ShapeDtypeStruct(a.shape, a.dtype) for a in made.start.values()]
    return export.export(jax.jit(made.run, keep_unused=True), platforms=["cpu"])(*shapes).mlir_module_serialized


def onnx(made: Step) -> bytes:
    """The step as an ONNX model with named inputs and outputs; ValueError without the extra 'onnx'."""
    try:
        from jax2onnx import to_onnx  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ValueError("ONNX needs the extra 'onnx'; pip install 'zeggs-jax[onnx]'.") from error
    shapes = [jax.ShapeDtypeStruct(a.shape, a.dtype) for a in made.start.values()]
    model: Any = to_onnx(
        made.run, inputs=shapes, model_name="zeggs", input_names=list(made.start), output_names=list(made.outputs)
    )
    return model.SerializeToString()


def describe(made: Step, model: Model) -> dict[str, Any]:
    """What has to be known to run the file, as plain values."""
    config, names = model.config, list(made.start)
    *_, turns, place = last = _performed(made, CHECKED)
    return {
        "inputs": [
            {"name": name, "shape": list(a.shape), "start": a.ravel().tolist()} for name, a in made.start.items()
        ],
        "outputs": [{"name": name, "shape": list(a.shape)} for name, a in zip(made.outputs, last, strict=True)],
        "state": dict(zip(made.outputs[:-2], names[len(NAMES) :], strict=True)),  # output: input of the next frame
        "check": {"frames": CHECKED, "turns": turns.tolist(), "place": place.tolist()},
        "rate": bvh.rate_hz(config.frame_time),
        "ahead": config.speech.ahead,  # rows of the spectrum that come later than the frame
        "seen": {"behind": config.speech.behind, "ahead": config.speech.ahead},
        "joints": list(model.skeleton.names),
        "parents": list(model.skeleton.parents),
        "offsets": np.round(np.asarray(model.skeleton.offsets, np.float64), 5).tolist(),
        "features": asdict(config.features) | {"loudness": wav.TARGET_LUFS, "filters": _filters(config.features)},
    }


def _performed(made: Step, frames: int) -> list[np.ndarray]:
    """The outputs of the last of some frames after the first pose, in silence."""
    run, (spectrum, style, target, *state) = jax.jit(made.run), made.start.values()
    said: Any = ()
    for _ in range(frames):
        said = run(spectrum, style, target, *state)
        state = said[:-2]
    return [np.asarray(a) for a in said]


def _filters(config: SpeechFeatureConfig) -> list[dict[str, Any]]:
    """Each mel band's weights of the spectrum's bins, from the first one that it hears."""
    rows = speech_features.mel_basis(config)
    heard = [np.flatnonzero(row) for row in rows]
    return [
        {"first": int(at[0]) if at.size else 0, "weights": [float(f"{w:.7g}") for w in row[at]]}
        for row, at in zip(rows, heard, strict=True)
    ]


def write(path: str | Path, content: bytes, made: Step, model: Model) -> Path:
    """Writes the file and, beside it, its description; returns where that is."""
    path = Path(path)
    beside = path.with_suffix(".json")
    text = json.dumps(describe(made, model), separators=(",", ":")).encode()
    for place, data in ((beside, text), (path, content)):
        temporary = place.with_name(f".{place.name}.part{os.getpid()}")
        try:
            temporary.write_bytes(data)
            os.replace(temporary, place)
        finally:
            temporary.unlink(missing_ok=True)
    return beside
