"""Milliseconds per generated frame at the paper's size, beside a plain PyTorch twin and the memory's own limit.

    taskset -c 0 python experiments/bench_decoder.py [--frames 256] [--repeats 7] [--json FILE]
    python experiments/bench_decoder.py
    taskset -c 0 python experiments/bench_decoder.py --batch 8 32 128 --sides eager float32
    python experiments/bench_decoder.py --compilation

All sides run closed loop, float32 unless they say so, with the same random weights, and must first agree on the
motion; they take turns within one process. The floor is the time to read a frame's weights at the rate at which a
matrix of 64 MB is read for one product W x, measured in the same turns. PyTorch comes with the extra `reference`; its
sides are eager, script (jit.script), compile (torch.compile) and dynamic (dynamic int8). Ours are float32, bfloat16
and int8 (kernels, see `nn.native`). The ratio is what counts: machines differ. --compilation instead tells how long
the piece that generation runs takes to compile, cold and cached, and what 20 lengths of speech compile.
"""

import argparse
import json
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import torch
from jax import monitoring
from jax.experimental.compilation_cache import compilation_cache

from zeggs_jax.data.scale import Scale, Scales
from zeggs_jax.motion.features import Motion
from zeggs_jax.motion.pose import Root, from_vector
from zeggs_jax.nn import native, reduced
from zeggs_jax.zeroeggs import decoder, folded, synthesis
from zeggs_jax.zeroeggs.decoder import Frame
from zeggs_jax.zeroeggs.model import Model, ZeroEggsConfig, init

CONFIG = ZeroEggsConfig()
HIDDEN, POSE, DT = CONFIG.decoder.hidden, CONFIG.vector_size, CONFIG.frame_time
TORCH, OURS = ("eager", "script", "compile", "dynamic"), ("float32", "bfloat16", "int8")
AGREE_FRAMES, AGREE = 20, {"float32": 1e-3, "bfloat16": 0.1, "int8": 0.3, "dynamic": 0.5}


class TorchDecoder(torch.nn.Module):
    """The recurrent decoder of the specification, written plainly: one Python loop, one frame a turn."""

    def __init__(self, inputs: int, hidden: int, outputs: int, layers: int) -> None:
        super().__init__()
        self.embed = torch.nn.Linear(inputs, hidden)
        self.gru = torch.nn.GRU(hidden + inputs, hidden, num_layers=layers, batch_first=True)
        self.out = torch.nn.Linear(hidden, outputs)

    def forward(self, vector, pos, rot, hidden, speech, style, gaze):  # [B, P], ..., speech [T, B, S]
        rows = []
        for t in range(speech.shape[0]):
            look = rotate(rot * torch.tensor([1.0, -1.0, -1.0, -1.0]), gaze - pos)
            x = torch.cat([vector, look, speech[t], style], -1)
            embedded = torch.nn.functional.elu(self.embed(x))
            output, hidden = self.gru(torch.cat([embedded, x], -1)[:, None], hidden)
            vector = self.out(output[:, 0])
            pos, rot = integrate(pos, rot, vector[:, :3], vector[:, 3:6])
            rows.append(torch.cat([pos, rot, vector], -1))
        return torch.stack(rows)


def rotate(q, v):
    t = 2.0 * torch.linalg.cross(q[:, 1:], v)
    return v + q[:, :1] * t + torch.linalg.cross(q[:, 1:], t)


def integrate(pos, rot, velocity, turn):
    half = rotate(rot, turn * 0.016667) / 2.0
    angle = torch.linalg.norm(half, dim=-1, keepdim=True) + 1e-8
    w, v = torch.cos(angle), half * torch.sin(angle) / angle
    a, b = rot[:, :1], rot[:, 1:]
    turned = torch.cat([w * a - (v * b).sum(-1, keepdim=True), w * b + a * v + torch.linalg.cross(v, b)], -1)
    return pos + rotate(rot, velocity * 0.016667), turned


def material(batch: int, frames: int) -> tuple[Any, Scales, Any, Frame]:
    """Parameters, scales that change nothing, first poses and what is given; clips are the last axis."""
    params = jax.device_get(init(jax.random.key(0), CONFIG)["decoder"])
    scales = Scales(*(Scale(jnp.zeros(n), jnp.ones(n)) for n in (81, POSE + 3, POSE)))
    rng = np.random.default_rng(0)
    normal = lambda *shape: rng.normal(size=shape).astype(np.float32)  # noqa: E731
    root = Root(jnp.zeros((3, batch)), jnp.tile(jnp.array([[1.0], [0.0], [0.0], [0.0]]), (1, batch)))
    first = jax.vmap(from_vector, -1, -1)(0.1 * normal(POSE, batch), root)
    style = np.tile(normal(1, 64, batch), (frames, 1, 1))
    gaze = np.tile(np.array([0.0, 0.0, 3.0], np.float32)[None, :, None], (frames, 1, batch))
    return params, scales, first, Frame(normal(frames, 64, batch), style, gaze)


def ours(precision: reduced.Precision, batch: int, frames: int) -> tuple[Callable[[], np.ndarray], int]:
    """A call that decodes all frames, in the pieces of generation, and the bytes of weights a frame reads."""
    params, scales, first, given = material(batch, frames)
    weights = reduced.with_precision(folded.fold(params, CONFIG.decoder, scales, DT), precision)
    begin = jax.vmap(partial(folded.begin, params, weights, CONFIG.decoder, scales), -1, -1)
    state = jax.jit(begin)(first, jax.tree.map(lambda a: a[0], given))
    advance = folded.advance_many
    if batch == 1:
        advance, (state, given) = folded.advance, jax.tree.map(lambda a: a[..., 0], (state, given))
    run = jax.jit(advance, static_argnums=1, donate_argnums=2)
    pieces = [jax.tree.map(lambda a, t=t: a[t : t + folded.CHUNK], given) for t in range(0, frames, folded.CHUNK)]

    def call() -> np.ndarray:
        last, made = jax.tree.map(jnp.copy, state), []
        for piece in pieces:
            last, poses = run(weights, CONFIG.decoder, last, piece)
            made.append(poses.joint_pos)
        made = [np.asarray(a).reshape(batch, folded.CHUNK, -1) for a in jax.block_until_ready(made)]
        return np.moveaxis(np.concatenate(made, axis=1), 0, -1)

    inside = (weights.embedded, weights.layers, weights.root, weights.gaze)
    before = (weights.given, weights.joints)
    size = lambda tree: sum(leaf.nbytes for leaf in jax.tree.leaves(tree))  # noqa: E731
    return call, size(inside) + size(before) // folded.CHUNK


def theirs(side: str, batch: int, frames: int) -> Callable[[], np.ndarray]:
    """The same of the PyTorch twin, with the same weights."""
    params, scales, first, given = material(batch, frames)
    net, layers = params["recurrent"], CONFIG.decoder.layers
    twin: Any = TorchDecoder(net["dense_in"]["weight"].shape[1], HIDDEN, POSE, layers).eval()
    state = {"embed": net["dense_in"], "out": net["dense_out"]}
    named = {f"{place}.{name}": array for place, arrays in state.items() for name, array in arrays.items()}
    named |= {f"gru.{n}_l{i}": a for i in range(layers) for n, a in net["gru"][f"layer{i}"].items()}
    twin.load_state_dict({name: torch.tensor(np.asarray(array)) for name, array in named.items()})
    begin = jax.vmap(partial(decoder.begin, params, CONFIG.decoder, scales), -1, -1)
    pose, hidden = begin(first, jax.tree.map(lambda a: a[0], given))
    rows = lambda a: torch.tensor(np.moveaxis(np.asarray(a), -1, -2).copy())  # noqa: E731
    vector = jax.vmap(decoder.poses.to_vector, -1, -1)(pose)
    inputs = [rows(a) for a in (vector, *pose.root, hidden, given.speech, given.style[0], given.target[0])]
    if side == "script":
        twin = torch.jit.script(twin)
    elif side == "compile":
        twin = torch.compile(twin)
    elif side == "dynamic":
        twin = torch.ao.quantization.quantize_dynamic(twin, {torch.nn.Linear, torch.nn.GRU}, torch.qint8)

    def call() -> np.ndarray:
        with torch.inference_mode():
            made = twin(*inputs).numpy()
        return np.moveaxis(made[..., 13 : 13 + 3 * CONFIG.joints], 1, 2)

    return call


def probe() -> Callable[[], Any]:
    """Eight products with a matrix of 64 MB, each with the one before in it."""
    weight = jnp.asarray(np.random.default_rng(0).normal(size=(16384, 1024)).astype(np.float32))
    run = jax.jit(lambda w, x: jax.lax.scan(lambda x, _: ((w @ x)[-1024:] * 1e-2, None), x, None, 8)[0])
    return lambda: jax.block_until_ready(run(weight, jnp.ones(1024)))


def timed(calls: dict[str, Callable[[], Any]], repeats: int) -> dict[str, list[float]]:
    """Seconds of every call, which take turns, after one of each that is not counted."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repeats):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            times[name].append(time.perf_counter() - start)
    return times


def measure(batch: int, sides: list[str], frames: int, repeats: int) -> list[dict[str, Any]]:
    """A row for every side: milliseconds a frame (of all clips), and beside eager and the floor."""
    calls: dict[str, Callable[[], Any]] = {"probe": probe()}
    read: dict[str, int] = {}
    for side in sides:
        if side in OURS and side != "float32" and native.problem():
            print(f"{side} left out: {native.problem()}")
        elif side in OURS:
            calls[side], read[side] = ours(cast(reduced.Precision, side), batch, frames)
        else:
            calls[side] = theirs(side, batch, frames)
    made = {side: call()[:AGREE_FRAMES] for side, call in calls.items() if side != "probe"}
    reference = next(iter(made.values()))
    for side, poses in made.items():
        apart = float(np.abs(poses - reference).max())
        assert apart < AGREE.get(side, 1e-3), f"{side} makes another motion: {apart:.3g} apart"
    times = timed(calls, repeats)
    rate = 8 * 2**26 / statistics.median(times.pop("probe"))
    rows = []
    for side, seconds in times.items():
        each = [1e3 * s / frames for s in seconds]
        row = {"batch": batch, "side": side, "ms": statistics.median(each), "min": min(each), "max": max(each)}
        if "eager" in times:
            row["times_eager"] = statistics.median(times["eager"]) / statistics.median(seconds)
        if side in read:
            floor = 1e3 * read[side] / rate
            row |= {"MB": read[side] / 1e6, "GB_per_s": rate / 1e9, "floor_ms": floor, "times_floor": row["ms"] / floor}
        rows.append(row)
        print("  ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)
    return rows


def compilation() -> dict[str, float]:
    """Seconds to compile a piece of 64 frames with an empty cache and with a full one, and programs of 20 lengths."""
    _, scales, first, _ = material(1, 1)
    model = Model(CONFIG, init(jax.random.key(0), CONFIG), scales, None)  # pyright: ignore
    gaze: Any = np.array([0.0, 0.0, 3.0], np.float32)
    start = Motion(jax.tree.map(lambda a: np.asarray(a)[None, ..., 0], first), gaze)
    told = lambda n: synthesis.Told(np.zeros((n, 81), np.float32), np.zeros((n, 64), np.float32), start)  # noqa: E731
    found, events = {}, []
    monitoring.register_event_duration_secs_listener(lambda event, duration_secs, **_: events.append(event))
    synthesis.ready(model)
    with tempfile.TemporaryDirectory() as folder:
        jax.config.update("jax_compilation_cache_dir", folder)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        for name in ("cold_s", "cached_s"):
            jax.clear_caches()
            compilation_cache.reset_cache()
            begun = time.perf_counter()
            synthesis.synthesize(model, *told(2))
            found[name] = time.perf_counter() - begun
        begun = time.perf_counter()
        synthesis.synthesize(model, *told(2))
        found["of_which_running_s"] = time.perf_counter() - begun
    compiled = "/jax/core/compile/backend_compile_duration"
    before = events.count(compiled)
    for frames in range(2, 202, 10):
        synthesis.synthesize(model, *told(frames))
    return {**found, "recompiles_over_20_lengths": events.count(compiled) - before}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=256, help="rounded up to pieces of 64")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--batch", type=int, nargs="+", default=[1])
    parser.add_argument("--sides", nargs="+", choices=TORCH + OURS, default=["eager", "script", "dynamic", *OURS])
    parser.add_argument("--compilation", action="store_true", help="only how long it takes to compile")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    args = parser.parse_args()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    torch.set_num_threads(cores)
    frames = -(-args.frames // folded.CHUNK) * folded.CHUNK
    load = os.getloadavg()[0]
    print(f"paper size, {frames} frames, {cores} core(s), {args.repeats} interleaved repeats, load {load:.1f} before")
    if args.compilation:
        rows: Any = compilation()
        print("  ".join(f"{name} {value:.3g}" for name, value in rows.items()))
    else:
        rows = [row for batch in args.batch for row in measure(batch, args.sides, frames, args.repeats)]
    if args.json:
        args.json.write_text(json.dumps({"cores": cores, "frames": frames, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
