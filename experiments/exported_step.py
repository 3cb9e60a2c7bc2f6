"""Runs an exported one-frame step without JAX: StableHLO compiled by IREE, or ONNX by onnxruntime.

    zeggs export --stablehlo step.mlirbc --onnx step.onnx --style happy
    pip install iree-base-compiler iree-base-runtime        # or: pip install onnxruntime
    python experiments/exported_step.py step.mlirbc --frames 60
    python experiments/exported_step.py step.onnx --frames 60

Each frame is given the speech features around it (here: silence), the style, the target and the state that the frame
before handed on; it answers with the next state, the joints' rotations and the place of joint 0. This file reads only
NAME.json beside the step, as an engine would.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

Run = Callable[[list[np.ndarray]], list[np.ndarray]]


def by_iree(path: Path) -> Run:
    """The StableHLO module's `main`, compiled for this CPU."""
    import iree.compiler as compiler  # pyright: ignore[reportMissingImports]
    import iree.runtime as runtime  # pyright: ignore[reportMissingImports]

    extra = ["--iree-llvmcpu-target-cpu=host"]
    binary = compiler.compile_file(str(path), target_backends=["llvm-cpu"], input_type="stablehlo", extra_args=extra)
    config = runtime.Config("local-task")
    module = runtime.load_vm_module(runtime.VmModule.copy_buffer(config.vm_instance, binary), config)
    return lambda given: [np.asarray(a) for a in module.main(*given)]


def by_onnxruntime(path: Path) -> Run:
    """The ONNX model; its inputs stand in the description's order."""
    import onnxruntime  # pyright: ignore[reportMissingImports]

    session = onnxruntime.InferenceSession(str(path))
    names = [one.name for one in session.get_inputs()]
    return lambda given: session.run(None, dict(zip(names, given, strict=True)))


def perform(run: Run, told: dict, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotations [T, J, 4] and places [T, 3] of the frames after the first pose, as a loop in any engine would."""
    given = [np.array(one["start"], np.float32).reshape(one["shape"]) for one in told["inputs"]]
    made = []
    for _ in range(frames):
        *state, turns, place = run(given)
        given[-len(state) :] = state  # speech, style and target come first; here they stay
        made.append((turns, place))
    turns, places = zip(*made, strict=True)
    return np.stack(turns), np.stack(places)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("step", type=Path)
    parser.add_argument("--frames", type=int, default=60)
    asked = parser.parse_args()
    told = json.loads(asked.step.with_suffix(".json").read_text())
    run = by_onnxruntime(asked.step) if asked.step.suffix == ".onnx" else by_iree(asked.step)
    start = time.perf_counter()
    turns, places = perform(run, told, asked.frames)
    passed = (time.perf_counter() - start) / asked.frames
    print(f"{asked.frames} frames of {turns.shape[1]} joints, {1e3 * passed:.2f} ms each; joint 0 ends at {places[-1]}")
    lengths = np.linalg.norm(turns, axis=-1)
    if not np.abs(lengths - 1.0).max() < 1e-3:  # NaN too
        raise SystemExit("the step made rotations of another length than 1.")


if __name__ == "__main__":
    main()
