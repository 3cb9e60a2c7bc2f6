"""Parameters and milliseconds per frame of every network, beside plain PyTorch eager (ZeroEGGS Table 2 and Sec. 4).

    taskset -c 0 python experiments/10_table2.py -o runs/table2 [--checkpoint RUN] [--frames 600] [--repeats 7]

Without --checkpoint the paper's size with random weights and the bundled model. Both sides have the same weights (the
twin of torch_twin.py), hear the same speech, see the same example, and must agree before anything is timed. They take
turns on one core; figures are medians. The ratio is what counts: machines differ. PyTorch: the extra `reference`.
"""

import argparse
import os
import platform
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

import ledger
from zeggs_jax.data.scale import Scale, Scales
from zeggs_jax.motion import pose
from zeggs_jax.motion.pose import Pose, Root
from zeggs_jax.stage import plots
from zeggs_jax.synthetic import body
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs.model import Model, ZeroEggsConfig, decode, encode_speech, encode_style, init

NAME = "10_table2"
EXAMPLE = 256  # frames
PARTS = ("speech", "style", "decoder")
SIDES = ("PyTorch eager", "zeggs-jax")
ALLOWED = 2e-4  # relative distance of the two sides before they are timed; closed loops part slowly

Call = Callable[[], Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkpoint", type=Path, help="a run or converted checkpoint")
    parser.add_argument("--frames", type=int, default=600)
    parser.add_argument("--repeats", type=int, default=7)
    ledger.add_docs(parser)
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args()
    try:
        import torch
    except ImportError:
        parser.error("it compares with PyTorch, which is not installed; install it with pip install '.[reference]'")
    args.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    models = {"paper size": paper_size, "bundled": g.bundled_model}
    if args.checkpoint:
        models = {args.checkpoint.name: partial(g.load_model, args.checkpoint)}
    with tqdm(total=len(models) * len(PARTS) * (args.repeats + 1), desc="table 2", unit="turn") as bar:
        rows = [row for name, make in models.items() for row in bench(name, make(), args.frames, args.repeats, bar)]
    load = f"load {os.getloadavg()[0]:.1f}, " if hasattr(os, "getloadavg") else ""
    about = (
        f"{cores()} core(s), {args.frames} frames, batch 1, float32, {args.repeats} repeats in turns, {load}"
        f"{platform.machine()}, jax {jax.__version__}, torch {torch.__version__}:"
    )
    ledger.tell(f"{about}\n\n{table(rows)}", NAME, args.docs)
    ledger.save(args.out / "table2.json", {"frames": args.frames, "cores": cores(), "rows": rows})
    draw(args.out / "table2.png", rows)


def table(rows: list[ledger.Row]) -> str:
    """A line for each network."""
    head = ["model", "network", "parameters", *(f"{side}, ms/frame (min .. max)" for side in SIDES), "ratio of medians"]
    body = []
    for row in rows:
        spans = [f"{statistics.median(t):.3g} ({min(t):.3g} .. {max(t):.3g})" for t in row["times"].values()]
        body.append([row["model"], row["network"], f"{row['parameters']:,}", *spans, f"{row['ratio']:.2f}x"])
    return ledger.table(head, body)


def cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def paper_size() -> Model:
    """The paper's networks with random weights, unscaled, for the synthetic body."""
    config = ZeroEggsConfig()
    sizes = (config.speech.features, config.vector_size + 3, config.vector_size)
    scales = Scales(*(Scale(jnp.zeros(size), jnp.ones(size)) for size in sizes))
    return Model(config, init(jax.random.key(0), config), scales, body.rest_skeleton())


def bench(name: str, model: Model, frames: int, repeats: int, bar: tqdm) -> list[ledger.Row]:
    """A row for each network: its size, and what a frame takes on both sides."""
    if model.config.labels or model.config.style.kind != "attn":
        raise ValueError(f"model '{name}' has no attention style encoder; PyTorch's twin has no other.")
    ours, theirs = calls(model, frames)
    rows = []
    for part in PARTS:
        bar.set_postfix_str(f"{part} of {name}")
        apart = distance(ours[part](), theirs[part]())
        if not apart < ALLOWED:
            raise ValueError(f"{part} of '{name}' and its twin are {apart:.1e} apart; times of the two mean nothing.")
        bar.update()
        times: dict[str, list[float]] = {side: [] for side in SIDES}
        for _ in range(repeats):
            for side, call in zip(SIDES, (theirs[part], ours[part]), strict=True):
                start = time.perf_counter()
                call()
                count = EXAMPLE if part == "style" else frames
                times[side].append(1e3 * (time.perf_counter() - start) / count)
            bar.update()
        slow, quick = (statistics.median(times[side]) for side in SIDES)
        size = sum(int(np.prod(leaf.shape)) for leaf in jax.tree.leaves(model.params[part]))
        rows.append({"model": name, "network": part, "parameters": size, "times": times, "ratio": slow / quick,
                     "apart": apart})  # fmt: skip
    return rows


def calls(model: Model, frames: int) -> tuple[dict[str, Call], dict[str, Call]]:
    """A call for each network on both sides; ours are compiled by the first."""
    config, draw = model.config, np.random.default_rng(0)
    mean, std = (np.asarray(x) for x in model.scales.speech)
    features = (mean + std * draw.normal(size=(frames, len(mean)))).astype(np.float32)
    mean, std = (np.asarray(x) for x in model.scales.pose_out)
    example = (mean + std * draw.normal(size=(EXAMPLE, len(mean)))).astype(np.float32)
    root = Root(jnp.zeros(3), jnp.array([1.0, 0.0, 0.0, 0.0]))
    first, gaze = pose.from_vector(jnp.asarray(example[0]), root), np.array([0, 100, 500], np.float32)
    speech = np.asarray(encode_speech(model.params, config, model.scales, jnp.asarray(features)))
    style = np.asarray(encode_style(model.params, config, model.scales, jnp.asarray(example)).mean)
    spoken, held, look = jnp.asarray(speech), jnp.tile(style, (frames, 1)), jnp.tile(gaze, (frames, 1))
    jitted = {
        "speech": jax.jit(lambda p, x: encode_speech(p, config, model.scales, x)),
        "style": jax.jit(lambda p, x: encode_style(p, config, model.scales, x).mean),
        "decoder": jax.jit(lambda p, first: _vectors(decode(p, config, model.scales, first, spoken, held, look))),
    }
    inputs = {"speech": jnp.asarray(features), "style": jnp.asarray(example), "decoder": first}
    params = jax.tree.map(jnp.asarray, model.params)
    ours = {part: (lambda part=part: jax.block_until_ready(jitted[part](params, inputs[part]))) for part in PARTS}
    return ours, twin_calls(model, features, example, speech, style, gaze)


def _vectors(poses: Pose) -> jax.Array:
    return jax.vmap(pose.to_vector)(poses)


def twin_calls(model: Model, features, example, speech, style, gaze) -> dict[str, Call]:
    """The same of PyTorch."""
    import torch

    import torch_twin as twins

    single = lambda x: torch.tensor(np.asarray(x, np.float32))  # noqa: E731
    own = {name: (single(scale.mean), single(scale.std)) for name, scale in model.scales._asdict().items()}
    twin = twins.Twin(twins.flat(model.params), model.config, own, model.skeleton.parents)
    heard, seen, spoken = (torch.tensor(x)[None] for x in (features, example, speech))
    held = torch.tensor(style)[None]
    look = torch.tensor(gaze)[None]
    turn = torch.tensor([1.0, 0.0, 0.0, 0.0])[None, None]
    first = twins.Body(torch.zeros(1, 1, 3), turn, seen[:, :1])

    def quietly(call: Call) -> Call:
        def run() -> np.ndarray:
            with torch.no_grad():
                return call()[0].numpy()

        return run

    return {
        "speech": quietly(lambda: twins.encode_speech(twin, heard, train=False)),
        "style": quietly(lambda: twins.encode_style(twin, seen, train=False)[0]),
        "decoder": quietly(lambda: twins.decode(twin, first, spoken, held, look).vector),
    }


def distance(ours: Any, theirs: Any) -> float:
    """Largest difference over the first frames of a loop, or all of a network, against the size of the values."""
    a, b = np.asarray(ours, np.float64), np.asarray(theirs, np.float64)
    if a.ndim == 2 and a.shape[-1] > 200:
        a, b = a[1:9], b[1:9]
    return float(np.abs(a - b).max() / (np.abs(b).max() + 1e-12))


def draw(path: Path, rows: list[ledger.Row]) -> None:
    """Milliseconds per frame of both sides, median and range, a line for each network, on a logarithmic axis."""
    names = list(dict.fromkeys(row["model"] for row in rows))
    with plots.sheet(path, plots.COLUMN, 0.75 + 0.95 * len(names)) as figure:
        every = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(every, names, strict=True):
            of = [row for row in rows if row["model"] == name]
            total = sum(row["parameters"] for row in of)
            axes.set_title(f"{name}, {total / 1e6:.1f} million parameters")
            for number, side in enumerate(SIDES):
                values = np.array([row["times"][side] for row in of])
                middle = np.median(values, axis=1)
                at, colour = np.arange(len(of)) + 0.17 * (2 * number - 1), (plots.SOFT, plots.COLOURS[1])[number]
                axes.hlines(at, values.min(axis=1), values.max(axis=1), color=colour, linewidth=2.0, alpha=0.5)
                axes.plot(middle, at, "os"[number], color=colour, markersize=3.4, label=side)
                for y, value, right in zip(at, middle, values.max(axis=1), strict=True):
                    axes.text(right * 1.22, y, f"{value:.2g}", va="center", fontsize=5.5)
            axes.set_yticks(range(len(of)), [row["network"] for row in of])
            axes.set(xscale="log", ylim=(len(of) - 0.5, -0.5))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.grid(axis="x")
        low = min(min(times) for row in rows for times in row["times"].values())
        high = max(max(times) for row in rows for times in row["times"].values())
        every[-1].set(xlabel="ms per frame", xlim=(0.5 * low, 4.0 * high))
        every[0].legend(loc="upper right")


if __name__ == "__main__":
    main()
