"""How fast a stream answers: frame by frame, paced at the frame rate and as fast as it goes; memory over an hour.

    taskset -c 0 python experiments/bench_stream.py                     # the paper's sizes, random weights, 60 s
    taskset -c 0 python experiments/bench_stream.py --hour              # and an hour of audio, faster than real time
    python experiments/bench_stream.py --small --seconds 5              # the bundled model, shortly

Each frame's samples are pushed at once and the time until its pose is there is taken: resampling none, features,
running loudness, encoder, decoder, copy to numpy. A miss is a frame that is not there before the next one is due.
"""

import argparse
import resource
import time

import numpy as np

BORN = time.perf_counter()


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


def session_of(model):
    """A session in a style that is a random point."""
    from zeggs_jax.zeroeggs.examples import bundled
    from zeggs_jax.zeroeggs.stream import StreamSession

    point = np.random.default_rng(0).normal(size=model.config.style_size).astype(np.float32)
    return StreamSession(model, point, first_pose=str(bundled()["neutral"]))


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
    """An hour of audio in pushes of 0.1 s, faster than real time; memory every five minutes."""
    start, rng = time.perf_counter(), np.random.default_rng(2)
    for minute in range(60):
        wave = noise(60.0, rng)
        for at in range(0, len(wave), 1600):
            session.push(wave[at : at + 1600])
        if minute % 5 == 4:
            print(f"{minute + 1:3d} min of audio after {time.perf_counter() - start:6.1f} s: {megabytes():.0f} MB")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--small", action="store_true", help="the bundled model instead of the paper's sizes")
    parser.add_argument("--hour", action="store_true", help="also an hour of audio")
    asked = parser.parse_args()
    from zeggs_jax.nn import compiled
    from zeggs_jax.zeroeggs import generate as g

    compiled.keep()
    model = g.bundled_model() if asked.small else paper_model()
    session = session_of(model)
    while not len(session.push(np.zeros(round(16_000 / session.rate), np.float32)).root.pos):
        pass
    print(f"first frame {time.perf_counter() - BORN:.2f} s after the start (numpy's import not counted)")
    least, most = session.latency
    print(f"algorithmic latency {1e3 * least:.1f} to {1e3 * most:.1f} ms, {session.rate:g} frames a second")
    for paced in (False, True):
        took = 1e3 * latencies(session, asked.seconds, paced)
        misses = int((took > 1e3 / session.rate).sum())
        low, high = np.percentile(took, [50, 99])
        name = "paced" if paced else "as fast as it goes"
        print(f"{name}: p50 {low:.2f} ms, p99 {high:.2f} ms, most {took.max():.2f} ms, {misses} misses of {len(took)}")
    if asked.hour:
        hour(session)


if __name__ == "__main__":
    main()
