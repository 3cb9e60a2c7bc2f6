"""How fast a stream answers: from the start, frame by frame, paced at the frame rate and not; memory over an hour.

    taskset -c 0 python experiments/bench_stream.py                     # the paper's sizes, random weights, 60 s
    taskset -c 0 python experiments/bench_stream.py --precision int8    # and of weights of fewer bytes
    taskset -c 0 python experiments/bench_stream.py --start             # only the first frame, of both sizes
    taskset -c 0 python experiments/bench_stream.py --small --hour      # the bundled model, and an hour of audio

Each frame's samples are pushed at once and the time until its pose is there is taken: resampling none, features,
running loudness, encoder, decoder, copy to numpy. A miss is a frame that is not there before the next one is due. The
first frame is that of the command, `zeggs stream`, in processes of its own: seconds from their start to the line of
frame 0 on their standard output, with as much speech piped in as it waits for and what was compiled kept from a run
before; a style of an .npz library for the paper's sizes, a bundled one for the bundled model. On a core that others
share, the CPU seconds beside them tell more.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

COMMAND = (sys.executable, "-m", "zeggs_jax.cli")


def paper_model():
    """The paper's sizes with random weights, and scales of a unit."""
    import jax

    from zeggs_jax.data.scale import Scale, Scales
    from zeggs_jax.zeroeggs import generate as g
    from zeggs_jax.zeroeggs import model as m

    config = m.ZeroEggsConfig()
    sizes = (config.speech.features, config.vector_size + 3, config.vector_size)
    scales = Scales(*(Scale(np.zeros(n, np.float32), np.ones(n, np.float32)) for n in sizes))
    params = jax.tree.map(lambda a: 0.5 * np.asarray(a), m.init(jax.random.key(0), config))
    return m.Model(config, params, scales, g.bundled_model().skeleton)


def session_of(model, precision: Any = "float32"):
    """A session in a style that is a random point."""
    from zeggs_jax.zeroeggs.examples import bundled
    from zeggs_jax.zeroeggs.stream import StreamSession

    return StreamSession(model, point(model), first_pose=str(bundled()["neutral"]), precision=precision)


def point(model) -> Any:
    return np.random.default_rng(0).normal(size=model.config.style_size).astype(np.float32)


def save_paper(folder: Path) -> list[str]:
    """The model of the paper's sizes and a style of it, written to a folder; the options that name them."""
    from zeggs_jax.zeroeggs import examples, library
    from zeggs_jax.zeroeggs.checkpoints import save_model
    from zeggs_jax.zeroeggs.model import StyleDistribution
    from zeggs_jax.zeroeggs.style_clip import first

    model = paper_model()
    start = first(examples.read_motion(examples.bundled()["neutral"], model))
    style = library.Entry(
        "some", "some", "a random point", None, StyleDistribution(point(model), np.full_like(point(model), -4.0)), start
    )
    save_model(folder / "model", model)
    library.save(folder / "style.npz", library.Library(library.digest(model), (style,)))
    return ["--checkpoint", str(folder / "model"), "--style", str(folder / "style.npz")]


def first_frames(options: list[str], heard: float, repeats: int) -> tuple[list[float], list[float]]:
    """Seconds and CPU seconds from the start of `zeggs stream` to its first frame; one more run goes before."""
    speech = (32_000 * noise(heard, np.random.default_rng(1))).astype("<i2").tobytes()
    wall, cpu = [], []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        with subprocess.Popen([*COMMAND, "stream", *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as run:
            assert run.stdin
            assert run.stdout
            run.stdin.write(speech)
            run.stdin.flush()
            for line in run.stdout:
                if line.startswith(b'{"frame"'):
                    break
            wall.append(time.perf_counter() - start)
            used = Path(f"/proc/{run.pid}/stat").read_text().rpartition(")")[2].split()
            cpu.append((int(used[11]) + int(used[12])) / os.sysconf("SC_CLK_TCK"))
            run.stdin.close()
            run.stdout.read()
    return wall[1:], cpu[1:]


def start(repeats: int) -> None:
    """The row of the first frame, for the bundled model and the paper's sizes."""
    with tempfile.TemporaryDirectory() as folder:
        sizes = (("bundled model", [], 0.55), ("paper's sizes", save_paper(Path(folder)), 0.3))
        for name, options, heard in sizes:
            wall, cpu = first_frames(options, heard, repeats)
            print(
                f"first frame of 'zeggs stream', {name}: {statistics.median(wall):.2f} s ({min(wall):.2f} .. "
                f"{max(wall):.2f}) after the start, of which CPU {statistics.median(cpu):.2f} ({min(cpu):.2f})",
                flush=True,
            )


def noise(seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Syllables of noise at 16 kHz."""
    level = np.repeat(rng.uniform(0.0, 0.2, round(5 * seconds) + 1), 3200)[: round(16_000 * seconds)]
    return (level * rng.normal(size=len(level))).astype(np.float32)


def latencies(session, seconds: float, paced: bool) -> np.ndarray:
    """Seconds from a push to its pose, of each frame; paced ones are pushed when they are due."""
    wave, count = noise(seconds, np.random.default_rng(1)), round(session.rate * seconds)
    edges = np.round(np.arange(count + 1) / session.rate * 16_000).astype(int)
    took, start = [], time.perf_counter()
    for k in range(count):
        if paced:
            time.sleep(max(start + k / session.rate - time.perf_counter(), 0.0))
        due = start + k / session.rate if paced else time.perf_counter()
        made = session.push(wave[edges[k] : edges[k + 1]])
        if len(made.root.pos):
            took.append(time.perf_counter() - due)
    return np.array(took)


def megabytes() -> float:
    """Memory that the process holds now."""
    with open("/proc/self/statm") as pages:
        return int(pages.read().split()[1]) * resource.getpagesize() / 1e6


def hour(session) -> None:
    """An hour of audio in pushes of 0.1 s, faster than real time; memory after each minute of it."""
    start, rng, held = time.perf_counter(), np.random.default_rng(2), []
    for _ in range(60):
        wave = noise(60.0, rng)
        for at in range(0, len(wave), 1600):
            session.push(wave[at : at + 1600])
        held.append(megabytes())
    print(
        f"an hour of audio in {time.perf_counter() - start:.0f} s: {held[0]:.1f} MB after the first minute, "
        f"{held[29]:.1f} in the middle, {held[-1]:.1f} at the end, {max(held):.1f} at most"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--repeats", type=int, default=5, help="starts of the command")
    parser.add_argument("--precision", nargs="+", default=["float32", "bfloat16", "int8"])
    parser.add_argument("--small", action="store_true", help="the bundled model instead of the paper's sizes")
    parser.add_argument("--hour", action="store_true", help="also an hour of audio")
    parser.add_argument("--start", action="store_true", help="only the first frame")
    asked = parser.parse_args()
    print(f"{len(os.sched_getaffinity(0))} core(s), load {os.getloadavg()[0]:.1f}")
    start(asked.repeats)
    if asked.start:
        return
    from zeggs_jax.nn import compiled
    from zeggs_jax.zeroeggs import generate as g

    compiled.keep()
    model = g.bundled_model() if asked.small else paper_model()
    for precision in asked.precision:
        session = session_of(model, precision)
        least, most = session.latency
        print(f"{precision}: latency {1e3 * least:.1f} to {1e3 * most:.1f} ms, {session.rate:g} frames a second")
        latencies(session, 1.0, False)
        for paced in (False, True):
            took = 1e3 * latencies(session, asked.seconds, paced)
            misses = int((took > 1e3 / session.rate).sum())
            low, high = np.percentile(took, [50, 99])
            name = "paced" if paced else "as fast as it goes"
            print(
                f"{name}: p50 {low:.2f} ms, p99 {high:.2f} ms, most {took.max():.2f} ms, {misses} of {len(took)} late",
                flush=True,
            )
    if asked.hour:
        hour(session_of(model))


if __name__ == "__main__":
    main()
