"""The whole of `zeggs generate` at the paper's size, beside the stages of a plain PyTorch eager twin.

    taskset -c 0 python experiments/bench_generate.py
    taskset -c 0 python experiments/bench_generate.py --seconds 10 --repeats 1 --precision int8

Speech of 60 s and a style clip of 60 s at 60 Hz, random weights. Ours is the command in a process of its own, from its
start to its end, with what was compiled kept from a run before; its stages are timed in that process. The twin's are
run here, one after the other: torch imported in a process of its own, features as numpy computes them frame by frame
with pyloudnorm's loudness, the clip read line by line, both encoders and the decoder in PyTorch, the motion written
line by line. What turns the clip into features and poses into angles is left out on its side, and counted on ours.
On a core that others share, CPU seconds tell more than seconds.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

STAGES = {
    "load_model": "checkpoint",
    "read_speech": "speech features",
    "read_styles": "style, read and encoded",
    "style_sequence": "style laid out",
    "synthesize": "decode",
    "finish": "poses to angles",
    "save": "write",
}
Clock = tuple[float, float]  # seconds, CPU seconds


def now() -> Clock:
    return time.time(), time.process_time()


def child(began: float, command: list[str]) -> None:
    """`zeggs` with these arguments; the seconds of its stages go to stderr, as JSON."""
    from zeggs_jax import cli
    from zeggs_jax.zeroeggs import generate as g

    took: dict[str, Clock] = {}

    def timed(call: Callable[..., Any], name: str) -> Callable[..., Any]:
        def run(*given: Any, **options: Any) -> Any:
            start = now()
            try:
                return call(*given, **options)
            finally:
                end = now()
                took[name] = (end[0] - start[0], end[1] - start[1])

        return run

    for function, name in STAGES.items():
        setattr(g, function, timed(getattr(g, function), name))
    took["start, imports"] = (time.time() - began, time.process_time())
    sys.argv = ["zeggs", *command]
    cli.main()
    print(json.dumps(took), file=sys.stderr)


def ours(command: list[str]) -> dict[str, Clock]:
    """Seconds and CPU seconds of the stages of one run of the command, and of all of it."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
    own = [sys.executable, __file__, "--child", str(start), *command]
    done = subprocess.run(own, check=True, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    end, after = time.time(), resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    took = {name: tuple(pair) for name, pair in json.loads(done.stderr.splitlines()[-1]).items()}
    rest = (end - start - sum(t for t, _ in took.values()), cpu - sum(c for _, c in took.values()))
    return {**took, "the rest": rest, "all": (end - start, cpu)}


def theirs(folder: Path, model: Any) -> dict[str, Clock]:
    """The same of the twin's stages."""
    import torch

    import bench_features as plain
    import torch_twin
    from zeggs_jax.speech import wav

    took: dict[str, Clock] = {}

    def timed(name: str, call: Callable[[], Any]) -> Any:
        start = now()
        made = call()
        took[name] = tuple(b - a for a, b in zip(start, now(), strict=True))  # pyright: ignore
        return made

    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
    subprocess.run([sys.executable, "-c", "import torch, numpy, scipy.signal, librosa"], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    took["start, imports"] = (time.time() - start, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    wave = wav.read(folder / "speech.wav")
    rows = timed("speech features", lambda: plain.plain_features(plain.plain_levelled(wave)))
    timed("style clip read", lambda: plain.plain_read(folder / "style.bvh"))
    tensors = {name: (torch.tensor(s.mean), torch.tensor(s.std)) for name, s in model.scales._asdict().items()}
    twin = torch_twin.Twin(torch_twin.flat(model.params), model.config, tensors, model.skeleton.parents)
    frames, size = len(rows), model.config.vector_size
    example = torch.randn(1, frames, size) * 0.1
    first = torch_twin.Body(torch.zeros(1, 1, 3), torch.tensor([[[1.0, 0.0, 0.0, 0.0]]]), example[:, :1])
    gaze = torch.tensor([[0.0, 0.0, 100.0]])
    with torch.inference_mode():
        style, _ = timed("style encoded", lambda: torch_twin.encode_style(twin, example, False))
        heard = timed("speech encoded", lambda: torch_twin.encode_speech(twin, torch.tensor(rows)[None], False))
        timed("decode", lambda: torch_twin.decode(twin, first, heard, style, gaze))
    values = plain.plain_read(folder / "style.bvh")[:frames]
    timed("write", lambda: plain.plain_write(folder / "twin.bvh", "", values))
    return {**took, "all": (sum(t for t, _ in took.values()), sum(c for _, c in took.values()))}


def material(folder: Path, seconds: float) -> tuple[Any, list[str]]:
    """A model, a clip there and back again, and noise with syllables, in a folder; the command's arguments."""
    import bench_stream
    from zeggs_jax.motion import bvh, edit
    from zeggs_jax.speech import wav
    from zeggs_jax.zeroeggs import examples
    from zeggs_jax.zeroeggs.checkpoints import save_model

    model = bench_stream.paper_model()
    save_model(folder / "model", model)
    wav.write(folder / "speech.wav", bench_stream.noise(seconds, np.random.default_rng(1)))
    clip = edit.resample(bvh.read(examples.bundled()["neutral"]), 60.0)
    last = len(clip.euler) - 1
    order = np.abs((np.arange(round(60 * seconds)) + last) % (2 * last) - last)
    bvh.write(folder / "style.bvh", clip._replace(euler=clip.euler[order], positions=clip.positions[order]))
    named = {"--checkpoint": "model", "--style": "style.bvh", "--out": "made.bvh"}
    options = [word for option, name in named.items() for word in (option, str(folder / name))]
    return model, ["generate", str(folder / "speech.wav"), *options]


def told(title: str, runs: list[dict[str, Clock]]) -> float:
    """Prints the medians of runs; CPU seconds of all."""
    median = {name: [statistics.median(run[name][i] for run in runs) for i in range(2)] for name in runs[0]}
    print(f"\n{title}: {', '.join(f'{name} {t:.2f} s (CPU {c:.2f})' for name, (t, c) in median.items())}", flush=True)
    return median["all"][1]


def main() -> None:
    if sys.argv[1:2] == ["--child"]:
        child(float(sys.argv[2]), sys.argv[3:])
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--precision", nargs="+", default=["float32", "bfloat16", "int8"])
    asked = parser.parse_args()
    import torch

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    torch.set_num_threads(cores)
    print(f"paper size, {asked.seconds:g} s of speech and of style, {cores} core(s), load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        model, command = material(Path(folder), asked.seconds)
        commands = {kind: [*command, "--precision", kind] for kind in asked.precision}
        for kind in commands:
            ours(commands[kind])  # not counted: compiles
        runs: dict[str, list[dict[str, Clock]]] = {kind: [] for kind in ("PyTorch eager", *commands)}
        for _ in range(asked.repeats):
            runs["PyTorch eager"].append(theirs(Path(folder), model))
            for kind in commands:
                runs[kind].append(ours(commands[kind]))
    whole = {kind: told(kind, made) for kind, made in runs.items()}
    ratios = {kind: whole["PyTorch eager"] / whole[kind] for kind in commands}
    print("\ntimes PyTorch, in CPU seconds: " + ", ".join(f"{kind} {ratio:.2f}" for kind, ratio in ratios.items()))


if __name__ == "__main__":
    main()
