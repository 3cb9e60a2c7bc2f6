"""A trial: one training at a small size with one thing changed, measured once; shared by 04, 05 and 06.

The size is for two CPU cores: a decoder of 128 units, windows of 2 s at 30 frames a second, neither mirrored nor paced,
batches of 8, 700 updates, some minutes a run. Differences at this size say which way a choice points, no more; that is
why every trial runs with more than one seed.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import ledger
import rollouts
import truth
from zeggs_jax.data import prepared
from zeggs_jax.data.prepare import PrepareConfig, prepare
from zeggs_jax.data.windows import WindowConfig
from zeggs_jax.metrics.factors import Ruler
from zeggs_jax.synthetic import styles
from zeggs_jax.zeroeggs.checkpoints import load_model
from zeggs_jax.zeroeggs.model import DecoderConfig, SpeechEncoderConfig, StyleEncoderConfig, ZeroEggsConfig
from zeggs_jax.zeroeggs.train import TrainConfig, train

SMALL = TrainConfig(
    model=ZeroEggsConfig(
        speech=SpeechEncoderConfig(hidden=32, size=32, dropout=0.1),
        style=StyleEncoderConfig(hidden=64, size=16),
        decoder=DecoderConfig(hidden=128, layers=2),
    ),
    windows=WindowConfig(batch=8, window=60, example=(60, 90), mirror=0.0, pace=0.0),
    steps=700,
    learning_rate=1.5e-3,
    ema=0.99,
    kl_middle=300.0,
    kl_slope=0.02,
    log_every=20,
    checkpoint_every=200,
    keep=1,
    keep_best=False,
    speech_columns=True,
    validate_every=0,
    sample_every=0,
)
COLUMNS = PrepareConfig(speech_columns=True)
SEEDS = (1, 2)
EXAMPLE_SECONDS = 6.0


def arrays(corpus: Path, folder: Path, config: PrepareConfig = COLUMNS) -> Path:
    """The prepared corpus in `folder`, made if it is not there; all trials of an experiment share it."""
    if not (folder / prepared.MANIFEST).exists():
        prepare(corpus, folder, config)
    return folder


def trial(
    name: str, config: TrainConfig, data: Path, out: Path, ruler: Ruler, voices: Mapping[str, np.ndarray]
) -> ledger.Row:
    """Train (or go on with) one run and measure it: reconstruction, factors, rhythm, variety, a minute of drift."""
    run = out / "runs" / f"{name}_{config.seed}"
    train(data, run, config)
    model, found = load_model(run), prepared.load(data)
    row = {"name": name, "seed": config.seed, **rollouts.reconstruction(model, found)}
    row |= manners(model, ruler, out / "examples", voices)
    some = truth.example(out / "examples", "happy", styles.STYLES["happy"], EXAMPLE_SECONDS, truth.EXAMPLE_SEED)
    wave = next(iter(voices.values()))
    row |= {"variety_cm": rollouts.variety(model, some, wave)}
    return row | rollouts.minute(model, some, list(voices.values()))


def manners(model, ruler: Ruler, folder: Path, voices: Mapping[str, np.ndarray]) -> ledger.Row:
    """Mean error of the factors for unseen clips of seen styles and of held-out ones, and rhythm over all of them."""
    frames = (0, round(EXAMPLE_SECONDS * truth.RATE_HZ))
    rows = []
    for k, (name, factors) in enumerate(styles.STYLES.items()):
        clip = truth.example(folder, name, factors, EXAMPLE_SECONDS, truth.EXAMPLE_SEED + k)
        for voice, wave in voices.items():
            row = rollouts.shown(model, ruler, factors, clip, wave, frames)
            rows.append({"name": name, "real": voice.startswith("real"), **row})
    seen = [row for row in rows if row["name"] not in styles.HELD_OUT]
    heard = {"synthetic": [row for row in seen if not row["real"]], "real": [row for row in seen if row["real"]]}
    return {
        "seen_share": ledger.mean(seen, "share"),
        "held_out_share": ledger.mean([row for row in rows if row["name"] in styles.HELD_OUT], "share"),
        **{f"{c}_{kind}": ledger.mean(of, c) for kind, of in heard.items() if of for c in ("matched", "shifted")},
    }


def jobs(
    variants: Mapping[str, tuple[TrainConfig, Path]],
    seeds: tuple[int, ...],
    out: Path,
    ruler: Ruler,
    voices: Mapping[str, np.ndarray],
) -> dict[str, Callable[[], ledger.Row]]:
    """One job for each variant and seed, seed by seed, so that a stopped experiment has a whole round of each."""
    return {
        f"{name}/{seed}": partial(trial, name, replace(config, seed=seed), data, out, ruler, voices)
        for seed in seeds
        for name, (config, data) in variants.items()
    }
