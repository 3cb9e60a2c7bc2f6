"""Runs an exported one-frame step without JAX: ONNX by onnxruntime, or StableHLO compiled by IREE.

    zeggs export --onnx step.onnx --stablehlo step.mlirbc --style happy
    pip install onnxruntime                                 # or: pip install iree-base-compiler iree-base-runtime
    python experiments/exported_step.py step.onnx --frames 600
    python experiments/exported_step.py step.mlirbc --frames 600

It first checks that the runtime makes what JAX made, then performs: without --speech in silence, with it a recording
(WAV, 16 bits, the model's rate), whose loudness in LUFS is told. What comes out is what the stream tells:

    python -c "import sys, wave; sys.stdout.buffer.write(wave.open('speech.wav').readframes(10**9))" \\
        | zeggs stream --style happy --loudness -20 > frames.jsonl
    python experiments/exported_step.py step.onnx --speech speech.wav --loudness -20 --against frames.jsonl

This file reads only NAME.json beside the step and uses only numpy, as an engine would its own arithmetic.
"""

import argparse
import json
import time
import wave
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Run = Callable[[list[np.ndarray]], list[np.ndarray]]
TURN, PLACE = 1e-3, 1e-3  # that a runtime may differ by: quaternion, cm


def by_iree(path: Path) -> Run:
    """The StableHLO module's `main`, compiled for this CPU."""
    import iree.compiler as compiler  # pyright: ignore[reportMissingImports]
    import iree.runtime as runtime  # pyright: ignore[reportMissingImports]

    extra = ["--iree-llvmcpu-target-cpu=host"]
    binary = compiler.compile_file(str(path), target_backends=["llvm-cpu"], input_type="stablehlo", extra_args=extra)
    config = runtime.Config("local-sync")
    module: Any = runtime.load_vm_module(runtime.VmModule.copy_buffer(config.vm_instance, binary), config)
    return lambda given: [np.asarray(a) for a in module.main(*given)]


def by_onnxruntime(path: Path) -> Run:
    """The ONNX model; its inputs stand in the description's order."""
    import onnxruntime  # pyright: ignore[reportMissingImports]

    session = onnxruntime.InferenceSession(str(path))
    names = [one.name for one in session.get_inputs()]
    return lambda given: session.run(None, dict(zip(names, given, strict=True)))


def speech_rows(samples: np.ndarray, told: dict[str, Any]) -> np.ndarray:
    """Samples [n], levelled -> the speech features of each frame [T, mels + 1]."""
    how, rate = told["features"], told["rate"]
    window, hop, steps = how["window"], how["hop"], how["rate_hz"] / how["hop"] / rate
    padded = np.pad(samples, window // 2, mode="reflect")
    pieces = np.lib.stride_tricks.sliding_window_view(padded, window)[::hop][: -(-len(samples) // hop)]
    heights = np.abs(np.fft.rfft(pieces * np.hanning(window))) / window
    basis = np.zeros((heights.shape[1], how["mels"]))
    for band, one in enumerate(how["filters"]):
        basis[one["first"] : one["first"] + len(one["weights"]), band] = one["weights"]
    mel, floor = heights @ basis, how["min_clipping"] / window
    if how["log_mel"]:
        mels = np.log(np.maximum(mel, how["log_floor"]))
    else:
        mels = np.log(10.0) / 20.0 * (1.0 - np.log(np.maximum(mel, floor)) / np.log(floor))
    energy = np.linalg.norm(np.exp(mels), axis=1, keepdims=True)
    rows = np.concatenate([mels, np.log(energy) if how["log_mel"] else energy], axis=1)
    frames = round(rate * len(samples) / how["rate_hz"])
    at = np.minimum(steps * np.arange(frames), len(rows) - 1)  # linear between the spectra
    left = np.minimum(at.astype(int), len(rows) - 2)
    share = (at - left)[:, None]
    return ((1.0 - share) * rows[left] + share * rows[left + 1]).astype(np.float32)


def perform(run: Run, told: dict[str, Any], spectra: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations [T, J, 4], places [T, 3] and seconds [T] of the frames after the first pose: any engine's loop."""
    names = [one["name"] for one in told["inputs"]]
    given = {one["name"]: np.array(one["start"], np.float32).reshape(one["shape"]) for one in told["inputs"]}
    outputs, made = [one["name"] for one in told["outputs"]], []
    for spectrum in spectra:
        given["spectrum"] = spectrum
        start = time.perf_counter()
        said = dict(zip(outputs, run([given[name] for name in names]), strict=True))
        passed = time.perf_counter() - start
        given |= {into: said[out] for out, into in told["state"].items()}
        made.append((said["turns"], said["place"], passed))
    turns, places, seconds = zip(*made, strict=True)
    return np.stack(turns), np.stack(places), np.array(seconds)


def apart(turns: np.ndarray, places: np.ndarray, other: Any, other_places: Any) -> tuple[float, float]:
    """The greatest difference of rotations (a quaternion and its opposite are the same) and of places, cm."""
    other = np.asarray(other)
    nearest = np.minimum(np.abs(turns - other).max(-1), np.abs(turns + other).max(-1))
    return float(nearest.max()), float(np.abs(places - np.asarray(other_places)).max())


def agree(what: str, turns: np.ndarray, places: np.ndarray, other: Any, other_places: Any) -> None:
    turn, place = apart(turns, places, other, other_places)
    print(f"{what}: rotations differ by {turn:.1e}, places by {place:.1e} cm at most")
    if not (turn < TURN and place < PLACE):  # NaN too
        raise SystemExit("this runtime makes another motion; is the step of this description?")


def heard(path: Path, loudness: float, told: dict[str, Any]) -> list[np.ndarray]:
    """The features around each frame of a recording but the first, the ends repeated as far as the encoder sees."""
    how = told["features"]
    with wave.open(str(path)) as file:
        if (file.getnchannels(), file.getsampwidth(), file.getframerate()) != (1, 2, how["rate_hz"]):
            raise SystemExit(
                f"'{path}' is another kind of sound; give a WAV of one channel, 16 bits, {how['rate_hz']} Hz."
            )
        samples = np.frombuffer(file.readframes(file.getnframes()), "<i2") / 32768.0
    gain = 10.0 ** ((how["loudness"] - loudness) / 20.0) if how["normalize_loudness"] else 1.0
    rows = speech_rows(samples * gain, told)
    behind, ahead = told["seen"]["behind"], told["seen"]["ahead"]
    rows = np.pad(rows, ((behind, ahead), (0, 0)), mode="edge")
    return [rows[t : t + behind + 1 + ahead] for t in range(1, len(rows) - behind - ahead)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", type=Path, help="NAME.onnx or NAME.mlirbc, with NAME.json beside it")
    parser.add_argument("--frames", type=int, default=600, help="of silence, without --speech")
    parser.add_argument("--speech", type=Path, help="a WAV of one channel and 16 bits")
    parser.add_argument("--loudness", type=float, default=-20.0, help="of the speech, LUFS")
    parser.add_argument("--against", type=Path, help="what 'zeggs stream' told of the same speech")
    asked = parser.parse_args()
    told = json.loads(asked.step.with_suffix(".json").read_text())
    run = by_onnxruntime(asked.step) if asked.step.suffix == ".onnx" else by_iree(asked.step)
    silence = np.array(told["inputs"][0]["start"], np.float32).reshape(told["inputs"][0]["shape"])
    turns, places, _ = perform(run, told, [silence] * told["check"]["frames"])
    agree("against JAX", turns[-1], places[-1], told["check"]["turns"], told["check"]["place"])
    spectra = [silence] * asked.frames if asked.speech is None else heard(asked.speech, asked.loudness, told)
    turns, places, seconds = perform(run, told, spectra)
    middle, late = 1e3 * np.percentile(seconds, [50, 99])
    print(f"{len(turns)} frames of {turns.shape[1]} joints: {middle:.2f} ms each, {late:.2f} ms at the 99th percentile")
    if asked.against is not None:
        lines = [json.loads(line) for line in asked.against.read_text().splitlines()]
        frames = [one for one in lines if "turns" in one][1:]  # the first is the first pose
        agree("against the stream", turns, places, *([one[key] for one in frames] for key in ("turns", "place")))


if __name__ == "__main__":
    main()
