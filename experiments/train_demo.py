"""Train the bundled model on the synthetic corpus: small sizes, 30 frames a second, speech features of equal weight.

    python experiments/make_corpus.py corpus --minutes 80
    python experiments/train_demo.py corpus -o runs/demo       # stop and run again to go on
    python experiments/bundle_demo.py runs/demo                # puts it into the package, with styles and speech

The sizes are all that differs from the paper's model; the code is the same.
"""

import argparse
from pathlib import Path

from zeggs_jax.data.windows import WindowConfig
from zeggs_jax.zeroeggs.model import DecoderConfig, SpeechEncoderConfig, StyleEncoderConfig, ZeroEggsConfig
from zeggs_jax.zeroeggs.train import TrainConfig, prepared, train

DEMO = TrainConfig(
    model=ZeroEggsConfig(
        speech=SpeechEncoderConfig(hidden=64, size=64, dropout=0.1),
        style=StyleEncoderConfig(hidden=128, size=32),
        decoder=DecoderConfig(hidden=256, layers=2),
    ),
    speech_columns=True,
    windows=WindowConfig(batch=16, window=75, example=(90, 180)),
    steps=3_000,
    learning_rate=1e-3,
    decay=0.6,
    kl_middle=1500.0,
    log_every=20,
    checkpoint_every=250,
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("corpus", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args()
    train(prepared(args.corpus, args.out, DEMO.speech_columns), args.out, DEMO)


if __name__ == "__main__":
    main()
