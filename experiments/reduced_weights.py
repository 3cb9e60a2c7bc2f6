"""What weights of fewer bytes cost in accuracy: joint positions in cm, and the style that the motion is taken for.

    python experiments/reduced_weights.py [SPEECH.wav ...] [--seconds 12] [--checkpoint RUN]
        [--golden FOLDER --reference FOLDER]

Every bundled style to every speech, in float32 and in each precision; the deviation is that of the world positions of
all joints, and of the same from the hips (a body that has walked on is not wrong in its gesture). Styles are recognised
as in measure_demo.py. With --golden the networks of the PyTorch release's size and random weights, whose rollouts of 60
and 600 frames are recorded there, are measured against the recording. Speed is measured by bench_decoder.py.
"""

import argparse
from pathlib import Path

import jax
import numpy as np
from tqdm import tqdm

import truth
from measure_demo import TRUTH_SECONDS, TRUTH_SEEDS
from parity import decoder as recorded
from parity.golden import read_arrays, read_case
from parity.networks import parameters, state_dict
from zeggs_jax.data.scale import Scales
from zeggs_jax.metrics import kinematic, recognition
from zeggs_jax.motion import bvh, features
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.nn import native, reduced
from zeggs_jax.speech import wav
from zeggs_jax.zeroeggs import examples, folded
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs.config import ZeroEggsConfig
from zeggs_jax.zeroeggs.torch_weights import read_scales

PRECISIONS: tuple[reduced.Precision, ...] = ("float32", "bfloat16", "int8")


def deviations(ours: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances in cm of joints [T, J, 3] in world and, the hips brought together, from the hips."""
    apart = ours - expected
    return np.linalg.norm(apart, axis=-1), np.linalg.norm(apart - apart[:, :1], axis=-1)


def bundled(args: argparse.Namespace) -> None:
    """All bundled styles, by a model in all precisions."""
    model = g.load_model(args.checkpoint) if args.checkpoint else g.bundled_model()
    styles = args.styles or list(examples.bundled())
    real = truth.clips(styles, TRUTH_SEEDS, TRUTH_SECONDS)
    statistics = [kinematic.style_statistics(clip) for clips in real.values() for clip in clips]
    centroids = recognition.fit(np.stack(statistics), [style for style, clips in real.items() for _ in clips])
    made: dict[str, list[np.ndarray]] = {name: [] for name in PRECISIONS}
    seen: dict[str, list[str]] = {name: [] for name in PRECISIONS}
    asked = [(path, style) for path in args.speech or g.bundled_speech().values() for style in styles]
    for path, style in tqdm(asked, desc="gestures", unit="gesture"):
        wave = wav.read(path)[: round(args.seconds * wav.RATE_HZ)]
        for precision in PRECISIONS:
            clip = g.generate(wave, style, model=model, precision=precision).clip
            made[precision].append(np.asarray(features.world_positions(clip), np.float64))
            seen[precision].append(recognition.nearest(centroids, kinematic.style_statistics(clip)))
    print(f"{len(asked)} gestures of {args.seconds:g} s at most, against float32")
    header("recognised", "as float32")
    for precision in PRECISIONS:
        pairs = [deviations(*each) for each in zip(made[precision], made["float32"], strict=True)]
        right = np.mean([name == style for name, (_, style) in zip(seen[precision], asked, strict=True)])
        same = np.mean([a == b for a, b in zip(seen[precision], seen["float32"], strict=True)])
        row(precision, pairs, f"{right:10.0%} {same:10.0%}")


def golden(folder: Path, reference: Path) -> None:
    """The recorded rollouts of the release's size, in all precisions; smaller networks would not be reduced."""
    case = read_case(folder / recorded.STAGE)
    for name in ("v1_normal.npz", "v1_normal_long.npz"):
        rollouts(name, case, folder, read_scales(read_arrays(reference / "v1" / "stats.npz"), ZeroEggsConfig()))


def rollouts(name: str, case: dict, folder: Path, scales: Scales) -> None:
    """The rollouts of one file; of the long one some frames are recorded."""
    skeleton = bvh.read(folder / "bvh" / "clip.bvh").skeleton
    spec, arrays = case["configs"]["v1_normal"], read_arrays(folder / recorded.STAGE / name)
    sizes = recorded.d.DecoderConfig(spec["hidden_size"], spec["num_rnn_layers"], spec["rnn_cond"])
    config = ZeroEggsConfig(frame_time=case["dt"], decoder=sizes)
    params = parameters(recorded.STAGE, state_dict(case, name, arrays, spec), config, np.float32)
    if "speech" not in arrays:
        arrays["speech"] = recorded._long_speech(case[name.removesuffix(".npz")], spec["speech_encoding_size"])
    kept = arrays.get("frames", slice(None))
    first, frames = recorded._first(arrays, np.float32), recorded._frames(arrays, np.float32)
    exact = folded.fold(params, sizes, scales, config.frame_time)
    rollout = jax.jit(folded.rollout, static_argnums=2)
    print(f"{name}: {len(arrays['speech'])} rollouts of {arrays['speech'].shape[1]} frames, against the recording")
    header()
    for precision in PRECISIONS:
        form, pairs = reduced.with_precision(exact, precision), []
        for clip in range(len(arrays["speech"])):
            one, given = jax.tree.map(lambda a, clip=clip: a[clip], (first, frames))
            poses = recorded._released(rollout(params, form, sizes, scales, one, given))
            made = {key: np.asarray(part)[kept] for key, part in poses.items()}
            expected = {key: arrays[f"out_{key}"][clip] for key in made}
            pairs.append(deviations(*(world(part, skeleton, config) for part in (made, expected))))
        row(precision, pairs)


def world(arrays: dict[str, np.ndarray], skeleton: Skeleton, config: ZeroEggsConfig) -> np.ndarray:
    """World positions, in cm, of a rollout under the release's names."""
    poses = recorded._first({f"in_{key}": value for key, value in arrays.items()}, np.float32)
    clip = features.decode(poses, skeleton, config.frame_time)
    return np.asarray(features.world_positions(clip), np.float64)


def header(*more: str) -> None:
    columns = ("mean cm", "99 % cm", "max cm", "hips mean", "hips max", *more)
    print(f"{'weights':10s}", *(f"{name:>10s}" for name in columns))


def row(name: str, pairs: list[tuple[np.ndarray, np.ndarray]], more: str = "") -> None:
    all_, hips = (np.concatenate([part.ravel() for part in parts]) for parts in zip(*pairs, strict=True))
    figures = (all_.mean(), np.quantile(all_, 0.99), all_.max(), hips.mean(), hips.max())
    print(f"{name:10s}", *(f"{figure:10.4f}" for figure in figures), more)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("speech", type=Path, nargs="*", help="recordings; the bundled ones when left out")
    parser.add_argument("--styles", nargs="+", help="bundled styles; all when left out")
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--checkpoint", type=Path, help="a model of your own; the bundled one when left out")
    parser.add_argument("--golden", type=Path, help="the folder of recorded vectors (see CONTRIBUTING.md)")
    parser.add_argument("--reference", type=Path, help="the folder with the release's statistics")
    args = parser.parse_args()
    if told := native.problem():
        print(f"note: {told} The numbers are the same.")
    if (args.golden is None) != (args.reference is None):
        parser.error("--golden and --reference belong together")
    bundled(args)
    if args.golden:
        golden(args.golden, args.reference)


if __name__ == "__main__":
    main()
