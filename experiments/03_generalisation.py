"""Unseen styles, unseen clips, new speakers, measured by known factors (ZeroEGGS Sec. 5.1 asks people instead).

    python experiments/03_generalisation.py runs/demo --corpus corpus -o runs/generalisation [--voices VOICE.wav ...]

The paper says that one example of a style never seen is enough, and that any voice will do; its user study rates that
by eye (Table 2). Here the truth is known: every style is 13 factors. From each generated motion they are recovered
(metrics/factors.py, fitted on synthetic truth of other seeds) and compared with those of the style clip. Beside them
stand the ruler's own error, on the truth performed to the same speech, and that of the mean of all training styles,
which a model that ignores its example would give. CORPUS is what make_corpus.py wrote with --hold-out-voices.
"""

import argparse
import csv
from collections.abc import Callable
from functools import partial
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

import ledger
import truth
import voices as recordings
from zeggs_jax.metrics.factors import Ruler
from zeggs_jax.synthetic import styles
from zeggs_jax.synthetic.styles import StyleFactors
from zeggs_jax.zeroeggs import generate as g

EXAMPLE_SECONDS = 8.0
SPEECHES = 4  # of each kind
POINTS = 12  # random styles of each kind


class Style(NamedTuple):
    """A style to show, by its true factors and an example clip."""

    name: str
    factors: StyleFactors
    clip: Path


class Case(NamedTuple):
    """What is asked of the model: these styles to these voices."""

    name: str
    shown: list[Style]
    voices: dict[str, np.ndarray]


def seen_clips(corpus: Path) -> list[Style]:
    """The first training clip of every named style."""
    with (corpus / "corpus.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["split"] == "train"]
    first = {row["style"]: corpus / f"{row['name']}.bvh" for row in reversed(rows)}
    return [Style(name, styles.STYLES[name], first[name]) for name in styles.TRAINING if name in first]


def made_clips(folder: Path, points: dict[str, StyleFactors]) -> list[Style]:
    """Fresh example clips of known factors."""
    return [
        Style(name, factors, truth.example(folder, name, factors, EXAMPLE_SECONDS, truth.EXAMPLE_SEED + k))
        for k, (name, factors) in enumerate(points.items())
    ]


def cases(corpus: Path, out: Path, voices: list[Path]) -> list[Case]:
    """Every row of the table."""
    examples, draw = out / "examples", np.random.default_rng(truth.POINT_SEED)
    known = recordings.of_corpus(corpus, "valid", SPEECHES)
    new = recordings.of_corpus(corpus / "new_speaker", "valid", SPEECHES)
    unseen = made_clips(examples, {name: styles.STYLES[name] for name in styles.TRAINING})
    between = {f"between{k}": styles.random_style(truth.POINT_SEED + k) for k in range(POINTS)}
    anywhere = {f"anywhere{k}": truth.anywhere(draw) for k in range(POINTS)}
    held_out = made_clips(examples, {name: styles.STYLES[name] for name in styles.HELD_OUT})
    listed = [
        Case("seen clip of a seen style", seen_clips(corpus), known),
        Case("unseen clip of a seen style", unseen, known),
        Case("the same, new TTS speakers", unseen, new),
        Case("unseen point between styles", made_clips(examples, between), dict(islice(known.items(), 2))),
        Case("unseen point anywhere", made_clips(examples, anywhere), dict(islice(known.items(), 2))),
        Case("unseen style (oration)", held_out, known | new),
    ]
    if voices:
        listed.insert(3, Case("the same, real voices", unseen, recordings.of_people(voices)))
    return listed


def ask(model: g.Model, ruler: Ruler, style: Style, wave: np.ndarray) -> ledger.Row:
    """Errors of the model's motion, and of the truth performed to the same speech."""
    frames = (0, round(EXAMPLE_SECONDS * truth.RATE_HZ))
    made = g.generate(wave, g.Request(styles=(str(style.clip),), frames=(frames,)), model=model).clip
    real = truth.performed(wave, style.factors, len(made.euler))
    found, own = (truth.recovered(ruler, clip) for clip in (made, real))
    return {
        "found": found._asdict(),
        "model": truth.errors(found, style.factors),
        "ruler": truth.errors(own, style.factors),
    }


def ask_mean(model: g.Model, ruler: Ruler, shown: list[Style], wave: np.ndarray) -> ledger.Row:
    """Factors of the motion that the mean of the training styles makes."""
    request = g.Request(
        styles=tuple(str(style.clip) for style in shown), first_pose=str(shown[0].clip), temperature=0.0
    )
    return {"found": truth.recovered(ruler, g.generate(wave, request, model=model).clip)._asdict()}


def report(rows: list[ledger.Row], listed: list[Case], out: Path) -> None:
    """The table: one line per case, its error per factor beside the ruler's and the mean style's."""
    means = [StyleFactors(**row["found"]) for row in rows if row["case"] == "mean style"]
    summary, body = {}, []
    for case in listed:
        of = [row for row in rows if row["case"] == case.name]
        baseline = [truth.errors(mean, style.factors) for mean in means for style in case.shown]
        lines = {"model": [r["model"] for r in of], "mean style": baseline, "ruler": [r["ruler"] for r in of]}
        summary[case.name] = {k: {c: ledger.mean(v, c) for c in (*truth.NAMES, "share")} for k, v in lines.items()}
        for who, values in summary[case.name].items():
            body.append([case.name if who == "model" else "", who, *(_number(values[c]) for c in truth.NAMES),
                         f"{values['share']:.1%}"])  # fmt: skip
    print(ledger.table(["case", "", *truth.NAMES, "mean share of span"], body))
    ledger.save(out / "results.json", {"error": summary, "speeches": {case.name: list(case.voices) for case in listed}})


def _number(value: float) -> str:
    return f"{value:.3f}" if value < 0.1 else f"{value:.2f}" if value < 10 else f"{value:.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="a model trained by 02_synthetic.py")
    parser.add_argument("--corpus", type=Path, required=True)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--voices", type=Path, nargs="+", default=[], help="recordings of people")
    parser.add_argument("--ruler-clips", type=int, default=truth.RULER_CLIPS)
    args = parser.parse_args()
    ruler, model = truth.ruler(args.out, args.ruler_clips), g.load_model(args.run)
    listed = cases(args.corpus, args.out, args.voices)
    jobs: dict[str, Callable[[], ledger.Row]] = {}
    for case in listed:
        for style in case.shown:
            for voice, wave in case.voices.items():
                jobs[f"{case.name}/{style.name}/{voice}"] = partial(ask, model, ruler, style, wave)
    known = listed[1]
    for voice, wave in known.voices.items():
        jobs[f"mean style/{voice}"] = partial(ask_mean, model, ruler, known.shown, wave)
    rows = ledger.fill(args.out / "rows.jsonl", jobs, "generating")
    for row in rows:
        row["case"] = row["job"].split("/")[0]
    report(rows, listed, args.out)


if __name__ == "__main__":
    main()
