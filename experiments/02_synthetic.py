"""The bundled model: the paper's training (Sec. 4) on the synthetic corpus, at a size for two CPU cores.

    python experiments/make_corpus.py corpus --minutes 120 --hold-out-voices kal_diphone +m4 +f3
    python experiments/02_synthetic.py corpus -o runs/demo       # stop and run again to go on
    python experiments/measure_demo.py VOICE.wav ... --checkpoint runs/demo/freed
    python experiments/bundle_demo.py runs/demo/freed --corpus corpus    # puts it into the package

The same code as the paper's; what differs is the sizes, 30 frames a second, a standard deviation for every speech
feature, no mirroring (which blurs the hand that leads), and a divergence that weighs a quarter as much, so that the
latent space keeps more than three directions. A clip of this corpus keeps its posture from beginning to end, so that a
body learns to keep the one it begins in, whatever the style; a second, shorter training ("freed") begins four windows
of ten in the pose of another clip, which the style then has to lead away.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import trials
from zeggs_jax.data.windows import WindowConfig
from zeggs_jax.zeroeggs.checkpoints import load_model
from zeggs_jax.zeroeggs.model import DecoderConfig, SpeechEncoderConfig, StyleEncoderConfig, ZeroEggsConfig
from zeggs_jax.zeroeggs.train import TrainConfig, train

DEMO = TrainConfig(
    model=ZeroEggsConfig(
        speech=SpeechEncoderConfig(hidden=64, size=64, dropout=0.1),
        style=StyleEncoderConfig(hidden=128, size=32),
        decoder=DecoderConfig(hidden=256, layers=2),
    ),
    speech_columns=True,
    windows=WindowConfig(batch=12, window=120, example=(120, 240), mirror=0.0),
    steps=5_000,
    learning_rate=1e-3,
    decay=0.72,
    ema=0.998,
    kl_limit=0.05,
    kl_middle=1500.0,
    log_every=20,
    checkpoint_every=250,
    validate_every=1000,
    sample_every=0,
)
FREED = replace(
    DEMO,
    windows=replace(DEMO.windows, foreign_start=0.4),
    steps=1_000,
    learning_rate=4e-4,
    kl_middle=-5_000.0,  # the divergence has its full weight from the start
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("corpus", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=DEMO.steps)
    parser.add_argument("--freed-steps", type=int, default=FREED.steps)
    args = parser.parse_args()
    data = trials.arrays(args.corpus, args.out / "prepared", trials.COLUMNS)
    train(data, args.out, replace(DEMO, steps=args.steps))
    freed = args.out / "freed"
    train(data, freed, replace(FREED, steps=args.freed_steps), initial=load_model(args.out))
    print(f"trained {args.steps} + {args.freed_steps} updates; next: measure_demo.py VOICE.wav --checkpoint {freed}")


if __name__ == "__main__":
    main()
