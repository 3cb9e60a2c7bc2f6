"""Speech features of 60 s and BVH files of 8000 frames, beside plain versions of the same, in turns in one process.

    taskset -c 0 python experiments/bench_features.py
    taskset -c 0 python experiments/bench_features.py --seconds 10 --frames 1000 --repeats 3

The plain versions are written here from the specification: features as numpy computes them frame by frame in float64
(Hann window, FFT, mel amplitudes, level, energy, interpolation), BVH read and written line by line, by value. Both
sides must give the same numbers, or nothing is timed. Where loudness is levelled first, the plain side measures it with
pyloudnorm, as the release does. On a shared machine CPU seconds say more than seconds.
"""

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyloudnorm

from zeggs_jax.motion import bvh
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.speech import features, wav

RATE_HZ, WINDOW, HOP, FRAMES_HZ, FLOOR = 16000, 800, 200, 60, 1e-5


def plain_features(wave: np.ndarray) -> np.ndarray:
    """80 mel levels and an energy at 60 Hz, a spectrogram frame after the other."""
    basis, window = features.mel_basis(), np.hanning(WINDOW)
    padded = np.pad(wave.astype(np.float64), WINDOW // 2, mode="reflect")
    mels = []
    for start in range(0, len(wave), HOP):
        spectrum = np.fft.rfft(padded[start : start + WINDOW] * window)
        mels.append(basis @ (np.abs(spectrum) / WINDOW))
    floor = FLOOR / WINDOW
    span = -20.0 * np.log10(floor)
    level = (20.0 * np.log10(np.maximum(np.array(mels), floor)) + span) / span
    level *= np.log(10.0) / 20.0
    energy = np.linalg.norm(np.exp(level), axis=1)
    rows = np.concatenate([level, energy[:, None]], axis=1)
    times = np.minimum(RATE_HZ / HOP / FRAMES_HZ * np.arange(round(FRAMES_HZ * len(wave) / RATE_HZ)), len(rows) - 1)
    return np.stack([np.interp(times, np.arange(len(rows)), column) for column in rows.T], axis=1).astype(np.float32)


def plain_levelled(wave: np.ndarray) -> np.ndarray:
    """The wave at -20 LUFS."""
    gain = 10.0 ** ((wav.TARGET_LUFS - pyloudnorm.Meter(RATE_HZ).integrated_loudness(wave.astype(np.float64))) / 20.0)
    return (gain * wave).astype(np.float32)


def plain_read(path: Path) -> np.ndarray:
    """The channels of a BVH file, degrees to radians but for the first three: positions of the first joint."""
    rows, moving = [], False
    with path.open() as file:
        for line in file:
            words = line.split()
            if moving and words and words[0] not in ("Frames:", "Frame"):
                rows.append([float(word) for word in words])
            moving = moving or words == ["MOTION"]
    values = np.array(rows)
    values[:, 3:] = np.radians(values[:, 3:])
    return values


def plain_write(path: Path, header: str, values: np.ndarray) -> None:
    """The header, then a line per frame, six decimals."""
    with path.open("w") as file:
        file.write(header)
        for frame in values:
            file.write(" ".join(f"{value:f}" for value in frame) + " \n")


def body(frames: int) -> bvh.Clip:
    """75 joints, each the child of one drawn before it, and random angles."""
    rng = np.random.default_rng(0)
    parents = (-1, *(int(rng.integers(0, joint)) for joint in range(1, 75)))
    order = depth_first(parents)
    place = {joint: i for i, joint in enumerate(order)}
    parents = tuple(place.get(parents[joint], -1) for joint in order)
    skeleton = Skeleton(tuple(f"joint{i}" for i in range(75)), parents, rng.normal(size=(75, 3)) * 10)
    positions = np.repeat(skeleton.offsets[None], frames, axis=0)
    positions[:, 0] = rng.normal(size=(frames, 3)) * 100
    return bvh.Clip(skeleton, ("zyx",) * 75, rng.uniform(-3, 3, (frames, 75, 3)), positions, 1 / 60)


def depth_first(parents: tuple[int, ...]) -> list[int]:
    """The joints in the order in which a BVH file names them."""
    order, waiting = [], [0]
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting += [child for child, parent in enumerate(parents) if parent == joint][::-1]
    return order


def channels(clip: bvh.Clip) -> np.ndarray:
    """A clip's numbers as its file has them, angles in radians."""
    return np.concatenate([clip.positions[:, 0], clip.euler.reshape(len(clip.euler), -1)], axis=1)


def compare(title: str, plain: Callable[[], object], ours: Callable[[], object], repeats: int) -> None:
    """Times both in turns and prints a row: milliseconds, CPU milliseconds, ratios of the medians."""
    taken: dict[str, list[tuple[float, float]]] = {"plain": [], "ours": []}
    for _ in range(repeats + 1):
        for name, call in (("plain", plain), ("ours", ours)):
            start, cpu = time.perf_counter(), time.process_time()
            call()
            taken[name].append((1e3 * (time.perf_counter() - start), 1e3 * (time.process_time() - cpu)))
    wall, cpu = ({name: [pair[i] for pair in pairs[1:]] for name, pairs in taken.items()} for i in range(2))
    cells = [f"{statistics.median(t):.1f} ({min(t):.1f} .. {max(t):.1f})" for t in (*wall.values(), *cpu.values())]
    ratios = [statistics.median(t["plain"]) / statistics.median(t["ours"]) for t in (wall, cpu)]
    print(f"| {title} | {' | '.join(cells)} | {ratios[0]:.1f}x | {ratios[1]:.1f}x |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("seconds", 60), ("frames", 8000), ("repeats", 7)):
        parser.add_argument(f"--{name}", type=int, default=default)
    args = parser.parse_args()
    rng = np.random.default_rng(0)
    loudness = np.repeat(rng.uniform(0.01, 0.3, args.seconds * 4), RATE_HZ // 4)
    wave = (loudness * rng.normal(size=args.seconds * RATE_HZ)).astype(np.float32)
    levelled = features.SpeechFeatureConfig(normalize_loudness=False)
    clip = body(args.frames)
    print(f"{len(os.sched_getaffinity(0))} core(s), load {os.getloadavg()[0]:.1f}, {args.repeats} repeats in turns:\n")
    print("| what | plain, ms (min .. max) | ours, ms | plain, CPU ms | ours, CPU ms | ratio | of CPU time |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    np.testing.assert_allclose(features.extract(wave, config=levelled), plain_features(wave), atol=2e-6)
    compare(
        f"features of {args.seconds} s", lambda: plain_features(wave),
        lambda: features.extract(wave, config=levelled), args.repeats,
    )  # fmt: skip
    np.testing.assert_allclose(features.extract(wave), plain_features(plain_levelled(wave)), atol=2e-6)
    compare(
        f"features of {args.seconds} s, loudness levelled first", lambda: plain_features(plain_levelled(wave)),
        lambda: features.extract(wave), args.repeats,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        ours, plain = Path(folder, "ours.bvh"), Path(folder, "plain.bvh")
        bvh.write(ours, clip)
        header = ours.read_text().partition("Frame Time: ")
        header = "".join(header[:2]) + header[2].splitlines()[0] + "\n"
        values = np.concatenate([clip.positions[:, 0], np.degrees(clip.euler).reshape(args.frames, -1)], axis=1)
        plain_write(plain, header, values)
        assert plain.read_bytes() == ours.read_bytes()
        np.testing.assert_array_equal(plain_read(ours), channels(bvh.read(ours)))
        title = f"BVH, 75 joints x {args.frames} frames"
        compare(f"{title}: read", lambda: plain_read(ours), lambda: bvh.read(ours), args.repeats)
        compare(
            f"{title}: write", lambda: plain_write(plain, header, values), lambda: bvh.write(ours, clip), args.repeats
        )


if __name__ == "__main__":
    main()
