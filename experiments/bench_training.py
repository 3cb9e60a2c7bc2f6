"""Training at the paper's size beside a plain PyTorch eager twin: seconds per step, peak memory, compilation.

    taskset -c 0 python experiments/bench_training.py --batch 32 --window 256 --example 384 --repeats 3
    python experiments/bench_training.py --batch 32 --window 256 --example 384 --repeats 3
    taskset -c 0 python experiments/bench_training.py --batch 8 --window 64 --example 256
    python experiments/bench_training.py --sizes demo --batch 16 --window 75 --example 180
    taskset -c 0 python experiments/bench_training.py --matmul bfloat16 --batch 32 --window 256 --example 384
    python experiments/bench_training.py --alone --batch 32 --window 256 --example 384

Both sides do the whole update: encoders with dropout, decoder in closed loop, kinematics, 17 terms and the divergence,
gradients, RAdam. They take turns within one process, and must first agree on the loss without dropout: that makes the
other a twin. On a shared machine CPU seconds (of all threads) say more than seconds. With --alone each side has new
processes of its own for two steps: their peak memory, and compilation with an empty cache of compiled programs and with
the one that the first process left. PyTorch: extra `reference`.
"""

import argparse
import dataclasses
import importlib
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from zeggs_jax.data.scale import Scale, Scales
from zeggs_jax.data.windows import Batch
from zeggs_jax.motion.pose import Root, from_vector
from zeggs_jax.training import step as steps
from zeggs_jax.zeroeggs.model import init
from zeggs_jax.zeroeggs.objective import Setting, batch_loss, loss_fn, no_draws
from zeggs_jax.zeroeggs.train import TrainConfig, optimiser

PARENTS = (
    -1, 0, 1, 2, 3, 4, 5, 6, 7, 4, 9, 10, 11, 12, 13, 14, 15, 12, 17, 18, 19, 12, 21, 22, 23, 12, 25, 26, 27,
    12, 29, 30, 31, 12, 11, 4, 35, 36, 37, 38, 39, 40, 41, 38, 43, 44, 45, 38, 47, 48, 49, 38, 51, 52, 53, 38,
    55, 56, 57, 38, 37, 0, 61, 62, 63, 64, 63, 62, 0, 68, 69, 70, 71, 70, 69,
)  # fmt: skip
LATE = 100_000  # an update at which the annealed weight of the divergence has reached its limit


def make_batch(config: TrainConfig, batch: int, window: int, example: int) -> tuple[Batch, Scales]:
    """Random clips of 75 joints, and scales that keep a closed loop of random weights in bounds."""
    rng, size = np.random.default_rng(0), config.model.vector_size

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    still = Root(jnp.zeros((batch, window, 3)), jnp.tile(jnp.array([1.0, 0.0, 0.0, 0.0]), (batch, window, 1)))
    poses = from_vector(normal(batch, window, size), still)
    clips = Batch(
        speech=normal(batch, window, config.model.speech.features),
        poses=jax.tree.map(np.asarray, poses),
        gaze=np.tile(np.array([0, 0, 100], np.float32), (batch, 1)),
        example=normal(batch, example, size),
        example_length=np.full(batch, example, np.int32),
        label=np.zeros(batch, np.int32),
    )
    widths = ((config.model.speech.features, 1.0), (size + 3, 10.0), (size, 0.3))
    return clips, Scales(*(Scale(np.zeros(n, np.float32), np.full(n, std, np.float32)) for n, std in widths))


def ours(config: TrainConfig, clips: Batch, scales: Scales, params: Any) -> tuple[Callable[[], float], Any]:
    """A call of the compiled update, and the compiled program."""
    transform = optimiser(config)
    state = steps.begin(jax.tree.map(jnp.array, params), transform)
    start = time.perf_counter()
    lowered = steps.make_step(loss_fn(Setting(config, scales, PARENTS)), transform, 0).lower(state, clips)
    traced = time.perf_counter()
    compiled = lowered.compile()
    print(f"compilation: {traced - start:.1f} s to trace, {time.perf_counter() - traced:.1f} s to compile")

    def update() -> float:
        nonlocal state
        state, metrics = compiled(state, clips)
        return float(metrics["loss"])

    return update, compiled


def theirs(config: TrainConfig, clips: Batch, scales: Scales, params: Any, device: str) -> tuple[Any, Any]:
    """A call of the PyTorch update, and one of its loss alone, without randomness."""
    import torch  # here, so that what JAX needs can be measured without it

    import torch_twin as twins

    torch.set_num_threads(len(os.sched_getaffinity(0)))
    torch.set_default_device(device)
    own = {name: (torch.tensor(s.mean), torch.tensor(s.std)) for name, s in scales._asdict().items()}
    twin = twins.Twin(twins.flat(params), config.model, own, PARENTS)
    vector = np.concatenate([np.asarray(part).reshape(*clips.speech.shape[:2], -1) for part in clips.poses[1:]], -1)
    truth = twins.Body(*(torch.tensor(a) for a in (clips.poses.root.pos, clips.poses.root.rot, vector)))
    batch = {name: torch.tensor(getattr(clips, name)) for name in ("speech", "example", "gaze")}
    transform = torch.optim.RAdam(twin.params.values(), lr=config.learning_rate, eps=config.eps)
    shape = (len(clips.label), config.model.style.size)

    def update() -> float:
        transform.zero_grad()
        loss = twins.loss(twin, batch, truth, torch.randn(shape), config.kl_limit, train=True)
        loss.backward()
        transform.step()
        return float(loss.detach())

    def alone() -> float:
        with torch.no_grad():
            return float(twins.loss(twin, batch, truth, torch.zeros(shape), config.kl_limit, train=False))

    return update, alone


def check_twins(config: TrainConfig, clips: Batch, scales: Scales, params: Any, alone: Callable[[], float]) -> None:
    """Both losses of the same weights and batch, the mean style and no dropout: equal, or a ValueError."""
    few = jax.tree.map(lambda a: jnp.stack([a] * len(clips.label)), no_draws(config.model))
    setting = Setting(dataclasses.replace(config, matmul="float32"), scales, PARENTS)
    mine = float(jax.jit(lambda p: batch_loss(p, clips, few, LATE, setting)[0])(params))
    other = alone()
    print(f"loss without dropout: zeggs-jax {mine:.6f}, PyTorch {other:.6f}")
    if abs(mine / other - 1.0) > 1e-4:
        raise ValueError(f"the losses are {mine} and {other}; they must agree, or the comparison means nothing.")


def compare(calls: dict[str, Callable[[], float]], repeats: int) -> None:
    """Times the calls in turns and prints seconds and CPU seconds."""
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for _ in range(repeats + 1):
        for name, call in calls.items():
            start, cpu = time.perf_counter(), time.process_time()
            call()
            seconds[name].append((time.perf_counter() - start, time.process_time() - cpu))
    medians = []
    for name, values in seconds.items():
        wall, cpu = ([value[i] for value in values[1:]] for i in range(2))
        medians.append((statistics.median(wall), statistics.median(cpu)))
        print(
            f"{name:14s} {medians[-1][0]:7.3f} s/step (min {min(wall):.3f}, max {max(wall):.3f}), "
            f"CPU {medians[-1][1]:.3f} s (min {min(cpu):.3f})"
        )
    print(
        f"ratio of medians: {medians[0][0] / medians[1][0]:.2f}x, of CPU seconds {medians[0][1] / medians[1][1]:.2f}x"
    )


def alone(side: str, config: TrainConfig, clips: Batch, scales: Scales, device: str) -> None:
    """Two updates of one side; prints the peak of this process's memory."""
    params = jax.tree.map(np.asarray, init(jax.random.key(0), config.model))
    if side == "torch":
        update = theirs(config, clips, scales, params, device)[0]
    else:
        update = ours(config, clips, scales, params)[0]
    for _ in range(2):
        update()
    print(f"peak memory: {peak_mib():.0f} MiB")


def each_alone(words: list[str]) -> None:
    """Runs this script anew for each side, ours twice with one cache of compiled programs."""
    with tempfile.TemporaryDirectory() as cache:
        settings = {"JAX_COMPILATION_CACHE_DIR": cache, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
        for title, side in (("zeggs-jax, empty cache", "jax"), ("zeggs-jax, cached", "jax"), ("PyTorch", "torch")):
            print(f"{title}:", flush=True)
            subprocess.run([sys.executable, __file__, *words, "--side", side], env=os.environ | settings, check=True)


def peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", choices=("paper", "demo"), default="paper")
    for name, default in (("batch", 8), ("window", 64), ("example", 256), ("repeats", 5)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--matmul", choices=("float32", "bfloat16"), default="float32", help="our matrix products")
    parser.add_argument("--device", default="cpu", help="where PyTorch runs; JAX takes its own default")
    parser.add_argument("--alone", action="store_true", help="memory and compilation of each side by itself")
    parser.add_argument("--side", choices=("jax", "torch"), help="what --alone gives its processes")
    args = parser.parse_args()
    if args.alone:
        each_alone([word for word in sys.argv[1:] if word != "--alone"])
        return
    config = importlib.import_module("02_synthetic").DEMO if args.sizes == "demo" else TrainConfig()
    config = dataclasses.replace(config, matmul=args.matmul)
    clips, scales = make_batch(config, args.batch, args.window, args.example)
    if args.side:
        alone(args.side, config, clips, scales, args.device)
        return
    params = jax.tree.map(np.asarray, init(jax.random.key(0), config.model))
    other, without_randomness = theirs(config, clips, scales, params, args.device)
    check_twins(config, clips, scales, params, without_randomness)
    update, compiled = ours(config, clips, scales, params)
    print(f"{len(os.sched_getaffinity(0))} core(s), load {os.getloadavg()[0]:.1f}, jax {jax.__version__}")
    compare({"PyTorch eager": other, "zeggs-jax": update}, args.repeats)
    temporary = compiled.memory_analysis().temp_size_in_bytes / 2**20
    print(
        f"zeggs-jax holds {temporary:.0f} MiB of temporary arrays in a step; both together peak at {peak_mib():.0f} MiB"
    )


if __name__ == "__main__":
    main()
