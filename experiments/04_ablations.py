"""Ablations that the paper implies: variational style, facing target, first hidden state, encoder, example length.

    python experiments/04_ablations.py corpus -o runs/ablations [--demo runs/demo] [--only NAME ...] [--seeds 1 2]

The paper argues for each by words: the VAE for a smooth space and variety (Sec. 3.4), the facing target against
turning away and the initialiser for the first frames (Sec. 3.5), attention against a recurrent encoder, examples of
256 to 512 frames (Sec. 4.2). Each is a training of its own (trials.py says how small), with the same data, seeds and
steps; the length of the example is asked of one trained model, the bundled one unless --demo names another. Two
processes may share the work (--only); one without --only prints the table of all that is done.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import ledger
import rollouts
import trials
import truth
import voices as recordings
from zeggs_jax.metrics.factors import Ruler
from zeggs_jax.synthetic import styles
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs.train import TrainConfig

LENGTHS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0)  # s
LENGTH_START = 3.0  # s into the clip, when it speaks
COLUMNS = (
    ("loss", "validation loss", "{:.4f}"),
    ("joint_cm", "joints, cm", "{:.2f}"),
    ("first_cm", "first second, cm", "{:.2f}"),
    ("seen_share", "factors, seen styles", "{:.1%}"),
    ("held_out_share", "factors, oration", "{:.1%}"),
    ("matched_synthetic", "r", "{:.2f}"),
    ("variety_cm", "variety, cm", "{:.2f}"),
    ("drift_cm", "drift, cm", "{:.1f}"),
    ("turned_deg", "turned, degrees", "{:.1f}"),
)


def variants() -> dict[str, TrainConfig]:
    """The full model and what is taken from it, one thing at a time."""
    full, model = trials.SMALL, trials.SMALL.model
    return {
        "full": full,
        "without VAE": replace(full, model=replace(model, style=replace(model.style, variational=False))),
        "without facing": replace(full, model=replace(model, decoder=replace(model.decoder, facing=False))),
        "without initialiser": replace(full, model=replace(model, decoder=replace(model.decoder, initialiser=False))),
        "GRU style encoder": replace(full, model=replace(model, style=replace(model.style, kind="gru"))),
    }


def length_jobs(
    model: g.Model, ruler: Ruler, out: Path, waves: dict[str, np.ndarray], seeds: tuple[int, ...]
) -> dict[str, Callable[[], ledger.Row]]:
    """Factor errors of every style by the length of its example."""
    found: dict[str, Callable[[], ledger.Row]] = {}
    for name, factors in styles.STYLES.items():
        for seed in seeds:
            seconds = LENGTH_START + max(LENGTHS)
            clip = truth.example(out / "examples", name, factors, seconds, truth.EXAMPLE_SEED + 100 * seed)
            for length in LENGTHS:
                frames = round(LENGTH_START * truth.RATE_HZ), round((LENGTH_START + length) * truth.RATE_HZ)
                for voice, wave in waves.items():
                    job = f"length {length:g}/{name}/{seed}/{voice}"
                    found[job] = partial(rollouts.shown, model, ruler, factors, clip, wave, frames)
    return found


def report(rows: list[ledger.Row], lengths: list[ledger.Row], out: Path) -> None:
    """Both tables, each figure with half the range over seeds."""
    print(ledger.by_seeds("model", rows, COLUMNS))
    summary = {}
    for row in lengths:
        _, row["style"], *_ = row["job"].split("/")
    for length in LENGTHS:
        of = [row for row in lengths if row["job"].startswith(f"length {length:g}/")]
        kept = {"seen": [r for r in of if r["style"] not in styles.HELD_OUT]}
        kept["oration"] = [r for r in of if r["style"] in styles.HELD_OUT]
        summary[f"{length:g}"] = {k: {c: ledger.mean(v, c) for c in (*truth.NAMES, "share")} for k, v in kept.items()}
    shown = ("hand_height", "amplitude", "tempo", "share")
    print(ledger.table(
        ["example, s", *shown, *(f"{c} (oration)" for c in shown)],
        [[k, *(f"{v[who][c]:.3f}" for who in ("seen", "oration") for c in shown)] for k, v in summary.items()],
    ))  # fmt: skip
    ledger.save(out / "results.json", {"trials": rows, "length": summary})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("corpus", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--demo", type=Path, help="the model whose examples are cut; the bundled one when left out")
    parser.add_argument("--only", nargs="+", choices=[*variants(), "length"], help="do no more than these")
    parser.add_argument("--seeds", type=int, nargs="+", default=trials.SEEDS)
    parser.add_argument("--steps", type=int, default=trials.SMALL.steps)
    parser.add_argument("--ruler-clips", type=int, default=truth.RULER_CLIPS)
    args = parser.parse_args()
    chosen = args.only or [*variants(), "length"]
    data = trials.arrays(args.corpus, args.out / "prepared")
    ruler, waves = truth.ruler(args.out, args.ruler_clips), recordings.of_corpus(args.corpus, "valid", 2)
    runs = {name: (replace(config, steps=args.steps), data) for name, config in variants().items() if name in chosen}
    jobs = trials.jobs(runs, tuple(args.seeds), args.out, ruler, waves)
    rows = ledger.fill(args.out / "trials.jsonl", jobs, "trials")
    lengths: list[ledger.Row] = []
    if "length" in chosen:
        model = g.load_model(args.demo) if args.demo else g.bundled_model()
        lengths = ledger.fill(
            args.out / "lengths.jsonl", length_jobs(model, ruler, args.out, waves, tuple(args.seeds)), "lengths"
        )
    if not args.only:
        report(rows, lengths, args.out)


if __name__ == "__main__":
    main()
