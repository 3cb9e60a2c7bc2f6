"""How time and memory of generation grow: with the clip's length, clips at once, hidden units, the style clip's length.

    taskset -c 0 python experiments/bench_growth.py -o OUT [--figure FILE.png] [--axes length batch hidden style]

The paper's sizes and random weights but for what varies; every point runs in a process of its own, after one that
compiled for it. Time is that of the processors, which other work slows too where it shares their caches and memory: the
median of five runs, or the one where it takes longer than 2 s. Memory is the most that is resident during the runs, and
what was resident before all: Python, JAX and the weights. An hour at 60 Hz takes some minutes; stop it and run it again
to go on. Needs Linux, whose /proc tells the peak of a part of a process.
"""

import argparse
import ctypes
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import ledger
from zeggs_jax.data.scale import Scale, Scales
from zeggs_jax.motion import pose
from zeggs_jax.motion.features import Motion
from zeggs_jax.motion.pose import Pose, Root
from zeggs_jax.nn import compiled
from zeggs_jax.stage import plots
from zeggs_jax.zeroeggs import style_clip, synthesis
from zeggs_jax.zeroeggs.model import DecoderConfig, Model, ZeroEggsConfig, init

LONG_S, RUNS = 2.0, 5
CLIP_S, BATCHED_S = 10.0, 2.0  # of speech, where something else varies
RATE_HZ = 60


class Axis(NamedTuple):
    """What varies."""

    title: str
    label: str
    values: tuple[int, ...]


AXES = {
    "length": Axis("Length of the speech", "seconds", (1, 6, 60, 600, 3600)),
    "batch": Axis(f"Clips at once, {BATCHED_S:g} s each", "clips", (1, 2, 4, 8, 16, 32, 64, 128)),
    "hidden": Axis(f"Hidden units of the decoder, {CLIP_S:g} s", "units", (128, 256, 512, 1024, 2048)),
    "style": Axis("Length of the style clip", "seconds", (1, 5, 20, 60, 300)),
}


def paper(hidden: int = 1024) -> Model:
    """The paper's networks with a decoder of so many units, random weights, scales of a unit."""
    config = ZeroEggsConfig(decoder=DecoderConfig(hidden))
    sizes = (config.speech.features, config.vector_size + 3, config.vector_size)
    scales = Scales(*(Scale(np.zeros(n, np.float32), np.ones(n, np.float32)) for n in sizes))
    params = jax.tree.map(lambda a: 0.5 * np.asarray(a), init(jax.random.key(0), config))
    return Model(config, params, scales, None)  # pyright: ignore[reportArgumentType]


def still(frames: int) -> Motion:
    """A random pose, held."""
    numbers = 0.1 * np.random.default_rng(0).normal(size=ZeroEggsConfig().vector_size).astype(np.float32)
    place: Any = np.zeros((frames, 3), np.float32), np.tile(np.array([1, 0, 0, 0], np.float32), (frames, 1))
    gaze: Any = np.array([0, 100, 500], np.float32)
    return Motion(pose.from_vector(np.tile(numbers, (frames, 1)), Root(*place)), gaze)


def told(frames: int) -> synthesis.Told:
    """Speech and style of so many frames: noise of a second, over and over."""
    draw = np.random.default_rng(1)
    heard, style = (draw.normal(size=(RATE_HZ, size)).astype(np.float32) for size in (81, 64))
    return synthesis.Told(np.resize(heard, (frames, 81)), np.resize(style[:1], (frames, 64)), still(1))


def calls(model: Model, axis: str, value: int) -> tuple[Callable[[], Any], Callable[[], Any]]:
    """What compiles all that is needed, and what is measured."""
    if axis == "style":
        motion = still(value * RATE_HZ)
        run = lambda: jax.block_until_ready(style_clip.encode(model, motion))  # noqa: E731
        return run, run
    seconds = {"length": float(value), "batch": BATCHED_S, "hidden": CLIP_S}[axis]
    count = value if axis == "batch" else 1

    def make(frames: int) -> list[Pose]:
        return synthesis.synthesize_many(model, [told(frames)] * count)

    return partial(make, 2), partial(make, round(seconds * RATE_HZ))


def point(axis: str, value: int, only_compile: bool) -> ledger.Row:
    """One measurement, in this process, or only what has to be compiled for it."""
    compiled.keep()
    model = paper(value if axis == "hidden" else 1024)
    if axis != "style":
        synthesis.ready(model)
    warm, run = calls(model, axis, value)
    ctypes.CDLL(None).malloc_trim(0)  # what preparing took and nobody holds goes back
    before = _megabytes("VmRSS")
    warm()
    if only_compile:
        return {}
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    times, finite = [], True
    while len(times) < RUNS and sum(times) < LONG_S:
        start = time.process_time()
        made = run()
        times.append(time.process_time() - start)
        finite = finite and all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(made))
    if not finite:
        raise ValueError(f"{axis} {value}: numbers that are not finite came out; times of those mean nothing.")
    return {"axis": axis, "value": value, "s": statistics.median(times), "MB": _megabytes("VmHWM"), "before_MB": before}


def _megabytes(name: str) -> float:
    """A line of Linux's account of this process."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{name}:")) * 1024 / 1e6


def apart(axis: str, value: int) -> ledger.Row:
    """One measurement in a process of its own, after one whose compiled programs it finds."""
    words = [sys.executable, __file__, "--point", axis, str(value)]
    subprocess.run([*words, "--only-compile"], check=True, stdout=subprocess.DEVNULL)
    return json.loads(subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout)


def table(rows: Sequence[ledger.Row]) -> str:
    """A line for each point."""
    body = [
        [AXES[r["axis"]].title, f"{r['value']:,}", f"{r['s']:.3g}", f"{r['MB']:,.0f}", f"{r['before_MB']:,.0f}"]
        for r in rows
    ]
    return ledger.table(["what varies", "value", "processor s", "peak, MB", "before, MB"], body)


def draw(path: Path, rows: Sequence[ledger.Row]) -> None:
    """A panel for each axis: time to the left, memory to the right, all logarithmic."""
    of = ledger.grouped(rows, "axis")
    with plots.sheet(path, plots.PAGE, 0.66 * plots.PAGE) as figure:
        figure.get_layout_engine().set(wspace=0.06, hspace=0.06)  # pyright: ignore
        lines: list[Any] = []
        for number, (name, found) in enumerate(of.items()):
            lines += panel(figure.add_subplot(2, 2, number + 1), AXES[name], found, first=number % 2 == 0)
        named = {line.get_label(): line for line in lines}
        figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=4)


def panel(axes: Any, axis: Axis, rows: Sequence[ledger.Row], first: bool) -> list[Any]:
    """One panel; the `first` of a row names the left scale, the other one the right scale."""
    blue, red, values = *plots.COLOURS[:2], [row["value"] for row in rows]
    memory = axes.twinx()
    memory.spines["right"].set_visible(True)
    lines = axes.plot(values, [row["s"] for row in rows], "o-", color=blue, markersize=3.5, label="time")
    lines += memory.plot(values, [row["MB"] for row in rows], "^-", color=red, markersize=3.5, label="memory, at most")
    lines += memory.plot(values, [row["before_MB"] for row in rows], ":", color=red, label="memory before")
    if axis is AXES["length"]:
        lines += axes.plot(values, values, "--", color=plots.SOFT, linewidth=0.8, label="as long as the speech")
    axes.set(xscale="log", yscale="log", title=axis.title, xlabel=axis.label)
    memory.set(yscale="log", ylim=(200, 20_000))
    axes.set_xticks(values, [f"{value:g}" for value in values])
    axes.set_xticks([], minor=True)
    low, high = np.log10(axes.get_ylim())
    axes.set_ylim(10.0 ** np.floor(low), 10.0 ** np.ceil(high))
    for side, colour in ((axes, blue), (memory, red)):
        low, high = side.get_ylim()
        ticks = [10.0**power for power in range(-4, 6) if low <= 10.0**power <= high]
        side.set_yticks(ticks, [f"{tick:,g}" for tick in ticks], color=colour)
        side.tick_params(axis="y", which="minor", labelleft=False, labelright=False)
        side.set_ylim(low, high)
    axes.set_ylabel("processor seconds" if first else "", color=blue)
    memory.set_ylabel("" if first else "resident memory, MB", color=red)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path)
    parser.add_argument("--axes", nargs="+", choices=AXES, default=list(AXES))
    parser.add_argument("--figure", type=Path, help="where the plots go; OUT/growth.png when left out")
    parser.add_argument("--most", type=int, default=3600, help="seconds of the longest speech")
    parser.add_argument("--point", nargs=2, metavar=("AXIS", "VALUE"), help=argparse.SUPPRESS)
    parser.add_argument("--only-compile", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.point:
        print(json.dumps(point(args.point[0], int(args.point[1]), args.only_compile)))
        return
    if args.out is None:
        parser.error("-o OUT is needed")
    most = {"length": args.most}
    asked = [(n, v) for n in args.axes for v in AXES[n].values if v <= most.get(n, v)]
    rows = ledger.fill(args.out / "growth.jsonl", {f"{n} {v}": partial(apart, n, v) for n, v in asked}, "points")
    print(table(rows))
    ledger.save(args.out / "growth.json", {"jax": jax.__version__, "rows": rows})
    draw(args.figure or args.out / "growth.png", rows)


if __name__ == "__main__":
    main()
