"""The paper's training (Ghorbani et al. 2023, Sec. 4), ready for the ZEGGS download: prepare and train in one command.

    python experiments/01_paper.py ZEGGS -o runs/paper                 # the paper: 120,000 updates
    python experiments/01_paper.py ZEGGS -o runs/release --release     # the release: 160,000 updates, its pipeline
    zeggs generate speech.wav --style ZEGGS/clean/067_Speech_2_x_1_0.bvh --checkpoint runs/paper -o out.bvh

It is the model behind all of the paper's figures (Fig. 5 to 8, Table 2). ZEGGS is the folder as it unpacks (`info.csv`
and `original/`, or `clean/`). Ctrl-C saves, the same command goes on. `paper` follows the paper where the release
differs: mended data, mirroring, a pace of +-10 % drawn for every batch, the divergence annealed to its full weight;
`--release` follows the release: its data pipeline with the copy at pace 0.9, its windows, the divergence capped at 0.2.
The networks are the same. docs/TRAINING.md says what to expect of time, memory and disk; the other options make it
small enough to try out.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import trials
from zeggs_jax.data import prepared
from zeggs_jax.data.prepare import PrepareConfig
from zeggs_jax.data.windows import WindowConfig
from zeggs_jax.zeroeggs.model import ZeroEggsConfig
from zeggs_jax.zeroeggs.train import TrainConfig, train

PAPER = TrainConfig(steps=120_000, kl_limit=1.0)
RELEASE = TrainConfig(steps=160_000, windows=WindowConfig(as_released=True))


def sized(config: TrainConfig, args: argparse.Namespace) -> TrainConfig:
    """The config with the sizes of the command line, where it gives any."""
    windows, model = config.windows, config.model
    if args.window:
        windows = replace(windows, window=args.window, example=(args.window, 2 * args.window))
    if args.batch:
        windows = replace(windows, batch=args.batch)
    if args.hidden:
        model = tiny(model, args.hidden)
    return replace(config, windows=windows, model=model, steps=config.steps if args.steps is None else args.steps)


def tiny(model: ZeroEggsConfig, hidden: int) -> ZeroEggsConfig:
    """The networks with `hidden` units and embeddings of 16."""
    return replace(
        model,
        speech=replace(model.speech, hidden=16, size=16),
        style=replace(model.style, hidden=hidden, size=16),
        decoder=replace(model.decoder, hidden=hidden),
    )


def describe(folder: Path, config: TrainConfig) -> str:
    """How much there is to train on, and how often training will see it."""
    found = prepared.load(folder)
    training = found.ranges[found.clips("train")]
    windows = int(np.maximum(np.diff(training) - config.windows.window + 1, 0).sum())
    size = sum(path.stat().st_size for path in folder.rglob("*.npy"))
    minutes = float(np.diff(training).sum()) * found.frame_time / 60.0
    rounds = config.steps * config.windows.batch / max(windows, 1)
    return (
        f"{minutes:.1f} minutes of training clips in {size / 1e9:.2f} GB, {windows:,} windows; "
        f"{config.steps:,} updates of {config.windows.batch} see each {rounds:.2f} times"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("corpus", type=Path, help="the ZEGGS download")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--release", action="store_true", help="the release's settings instead of the paper's")
    parser.add_argument("--steps", type=int)
    parser.add_argument("--batch", type=int)
    parser.add_argument("--window", type=int, help="frames; examples then have one to two windows")
    parser.add_argument("--hidden", type=int, help="units of the decoder and the style encoder")
    args = parser.parse_args()
    config = sized(RELEASE if args.release else PAPER, args)
    data = trials.arrays(args.corpus, args.out / "prepared", PrepareConfig(as_released=args.release))
    print(describe(data, config))
    train(data, args.out, config)
    print(f"trained {config.steps:,} updates; use it: zeggs generate SPEECH --style CLIP.bvh --checkpoint {args.out}")


if __name__ == "__main__":
    main()
