"""An improvement of ours: speech features that are really normalised, against the released ones (ZeroEGGS Sec. 3.1).

    python experiments/05_speech_features.py corpus -o runs/features --voices VOICE.wav ... [--only NAME ...]

The paper says log mel amplitudes, normalised; the release takes decibels mapped to [0, 1] for decibels, so that the
mels span a tenth, and divides all 81 columns by one standard deviation, which the offset of the energy dominates: its
networks see mels of about +-0.06. Three trainings at the size of trials.py, the same but for the features: as released;
the same with a standard deviation for every column; true log mels, also with one for every column. Asked of each:
reconstruction of unseen clips, and whether hands move with the voice, on synthetic speech that training never saw and
on real voices.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import ledger
import trials
import truth
import voices as recordings
from zeggs_jax.data.prepare import PrepareConfig
from zeggs_jax.speech.features import SpeechFeatureConfig

COLUMNS = (
    ("loss", "validation loss", "{:.4f}"),
    ("joint_cm", "joints, cm", "{:.2f}"),
    ("hands_cm", "hands, cm", "{:.2f}"),
    ("matched_synthetic", "r, unseen clips", "{:.3f}"),
    ("shifted_synthetic", "moved in time", "{:.3f}"),
    ("matched_real", "r, real voices", "{:.3f}"),
    ("shifted_real", "moved in time", "{:.3f}"),
    ("seen_share", "factors", "{:.1%}"),
)


def variants() -> dict[str, PrepareConfig]:
    """How speech is made into numbers."""
    return {
        "released": PrepareConfig(),
        "released, std per column": PrepareConfig(speech_columns=True),
        "log mel, std per column": PrepareConfig(speech_columns=True, speech=SpeechFeatureConfig(log_mel=True)),
    }


def report(rows: list[ledger.Row], out: Path) -> None:
    """The table, each figure with half the range over seeds."""
    print(ledger.by_seeds("speech features", rows, COLUMNS))
    ledger.save(out / "results.json", {"trials": rows})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("corpus", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--voices", type=Path, nargs="+", default=[], help="recordings of people")
    parser.add_argument("--only", nargs="+", choices=[*variants()], help="do no more than these")
    parser.add_argument("--seeds", type=int, nargs="+", default=trials.SEEDS)
    parser.add_argument("--steps", type=int, default=trials.SMALL.steps)
    parser.add_argument("--ruler-clips", type=int, default=truth.RULER_CLIPS)
    args = parser.parse_args()
    runs = {}
    for number, (name, config) in enumerate(variants().items()):
        if not args.only or name in args.only:
            data = trials.arrays(args.corpus, args.out / f"prepared{number}", config)
            runs[name] = (replace(trials.SMALL, steps=args.steps, speech_columns=config.speech_columns), data)
    ruler = truth.ruler(args.out, args.ruler_clips)
    waves = recordings.of_corpus(args.corpus, "valid", 2) | recordings.of_people(args.voices)
    rows = ledger.fill(
        args.out / "trials.jsonl", trials.jobs(runs, tuple(args.seeds), args.out, ruler, waves), "trials"
    )
    if not args.only:
        report(rows, args.out)


if __name__ == "__main__":
    main()
