"""A study's conditions by every metric: truth, mismatched, ours, mean pose, previous frame (cf. ZeroEGGS Table 2).

    python experiments/11_study.py -o runs/study [--clips 24]
    python experiments/11_study.py -o runs/study --checkpoint RUN --corpus CORPUS [--split valid]

The paper asks people (Sec. 4.3); here stand the measures of metrics/report.py, each with its interval. Truth: synthetic
takes of seeds that no training has seen, two of every named style; or the clips of a corpus' split. `mismatched`: each
speech beside the motion of another take of its style, as studies of appropriateness have it. `ours`: each speech in the
style of another clip. `mean pose`: the mean of all postures of the truth, held. `previous frame`: the truth one frame
late, which is what predicting each frame as the one before gives when it is always told the true one: near-perfect
wherever a measure compares positions, hence the least that such measures must be trusted with.
"""

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

import ledger
from zeggs_jax.data import corpus as corpora
from zeggs_jax.metrics import beats, feature_net, movement
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.metrics.report import report
from zeggs_jax.metrics.rows import ReportConfig
from zeggs_jax.metrics.scores import MEASURES, Sample
from zeggs_jax.motion import bvh, edit
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import wav
from zeggs_jax.stage import plots
from zeggs_jax.synthetic import corpus, recording, styles
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs import style_clip

NAME = "11_study"
SECONDS, RATE_HZ = 12.0, 30
SEED, NET_SEED = 970_000, 980_000  # training corpora use seeds far below
NET = feature_net.FeatureNetConfig(steps=800)
CONDITIONS = ("truth", "mismatched", "ours", "mean pose", "previous frame")
PLOTTED = {
    "fgd": "Frechet gesture distance", "frechet_velocities": "Frechet, velocities",
    "hellinger_speed": "Hellinger, speeds", "recognised": "style recognised",
    "canonical": "canonical correlation", "energy": "energy of speech",
    "beat_consistency": "beat consistency", "stress": "stressed words", "ape": "position error", "jerk": "jerk",
    "l1": "extent (L1)", "skate": "foot skate",
}  # fmt: skip


class Take(NamedTuple):
    """One recorded clip, what was said, and a clip to take its style from."""

    name: str
    style: str
    wave: np.ndarray
    clip: Clip
    stresses: np.ndarray | None
    example: Path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--checkpoint", type=Path, help="a run or converted checkpoint; the bundled model when left out"
    )
    parser.add_argument("--corpus", type=Path, help="a corpus folder as the truth; synthetic takes when left out")
    parser.add_argument("--split", default="valid", choices=("train", "valid"))
    parser.add_argument("--clips", type=int, default=24, help="takes of truth at most")
    ledger.add_docs(parser)
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    model = g.load_model(args.checkpoint) if args.checkpoint else g.bundled_model()
    if args.corpus:
        takes, others = of_corpus(args.corpus, args.split, args.clips), of_corpus(args.corpus, "train", args.clips)
        net_clips = [movement.of(take.clip) for take in others]
    else:
        takes = synthetic(args.clips, SEED)
        net_clips = [movement.of(take.clip) for take in synthetic(args.clips, NET_SEED)]
    print(f"training the feature net on {len(net_clips)} other clips", flush=True)
    net = feature_net.train(net_clips, NET)
    groups = conditions(takes, model)
    print(f"scoring {len(groups) + 1} conditions", flush=True)
    found = report(groups, [sample(take, movement.of(take.clip)) for take in takes], net, ReportConfig(draws=200))
    ledger.tell(f"{table(found)}\n\n{left_out(found)}", NAME, args.docs)
    ledger.save(args.out / "study.json", found)
    draw(args.out / "study.png", found)


def synthetic(count: int, seed: int) -> list[Take]:
    """Takes of the named styles in turn, of seeds that no training has seen."""
    takes = []
    for k in tqdm(range(count), desc="truth", unit="clip"):
        style = list(styles.STYLES)[k % len(styles.STYLES)]
        plan = corpus.Take(f"{style}_{k}", style, styles.STYLES[style], "valid", SECONDS, seed + k)
        spoken, heard, clip = corpus.perform(plan, recording.speak(SECONDS, seed + k), RATE_HZ)
        strong = np.asarray(heard.time)[np.asarray(heard.strength) > np.median(heard.strength)]
        takes.append(Take(plan.name, style, spoken.wave, clip, strong, style_clip.bundled_clips()[style]))
    return takes


def of_corpus(folder: Path, split: str, count: int) -> list[Take]:
    """The first seconds of a split's clips; each takes its style from another clip of its label where there is one."""
    entries = corpora.find(folder)
    chosen = [entry for entry in entries if entry.split == split][:count]
    takes = []
    for entry in tqdm(chosen, desc=f"clips of '{split}'", unit="clip"):
        other = next((e for e in entries if e.style == entry.style and e.name != entry.name), entry)
        clip = bvh.read(entry.bvh)
        clip = edit.trim(clip, 0, min(len(clip.euler), round(SECONDS * bvh.rate_hz(clip.frame_time))))
        wave = wav.read(entry.wav)[: round(SECONDS * wav.RATE_HZ)]
        takes.append(Take(entry.name, entry.style, wave, clip, None, other.bvh))
    return takes


def sample(take: Take, motion: Movement, name: str | None = None) -> Sample:
    """A motion as a sample beside what a take says."""
    energy = np.asarray(speech_features.frame_energy(take.wave, len(motion.positions), motion.rate_hz), np.float64)
    return Sample(name or take.name, motion, take.name, take.style, beats.onsets(take.wave), take.stresses, energy)


def conditions(takes: list[Take], model: g.Model) -> dict[str, list[Sample]]:
    """The groups to be scored beside the truth."""
    motions = [movement.of(take.clip) for take in takes]
    bodies = [movement.in_heading(motion).positions for motion in motions]
    posture = np.mean([body.mean(axis=0) for body in bodies], axis=0)
    groups: dict[str, list[Sample]] = {name: [] for name in CONDITIONS[1:]}
    for take, motion in zip(tqdm(takes, desc="ours", unit="clip"), motions, strict=True):
        frames = len(motion.positions)
        swapped = motions[other(takes, take)].positions
        groups["mismatched"].append(sample(take, motion._replace(positions=np.resize(swapped, motion.positions.shape))))
        made = movement.of(g.generate(take.wave, str(take.example), model=model).clip)
        if made.rate_hz != motion.rate_hz:
            made = movement.sampled(made, motion.rate_hz)
        groups["ours"].append(sample(take, made))
        groups["mean pose"].append(sample(take, motion._replace(positions=np.repeat(posture[None], frames, axis=0))))
        late = np.concatenate([motion.positions[:1], motion.positions[:-1]])
        groups["previous frame"].append(sample(take, motion._replace(positions=late)))
    return groups


def other(takes: list[Take], take: Take) -> int:
    """The next take of the same style, else the next take."""
    here = takes.index(take)
    order = [*range(here + 1, len(takes)), *range(here)]
    return next((k for k in order if takes[k].style == take.style), order[0] if order else here)


def table(found: dict[str, Any]) -> str:
    """A line for each measure, a column for each condition."""
    body = []
    for measure, about in MEASURES.items():
        cells = [_cell(found["groups"][name]["values"].get(measure)) for name in CONDITIONS]
        body.append([measure.replace("_", " "), about.unit, about.better, *cells])
    return ledger.table(["measure", "unit", "better", *CONDITIONS], body)


def left_out(found: dict[str, Any]) -> str:
    """A line for each measure that could not be taken of a condition, and why."""
    return "\n".join(
        sorted({f"- left out: {row['measure']} of {row['group']}: {row['reason']}" for row in found["left_out"]})
    )


def _cell(value: dict[str, Any] | None) -> str:
    if value is None or value["value"] is None:
        return ""
    middle, low, high = (_number(value[name]) for name in ("value", "low", "high"))
    return middle if not low else f"{middle} ({low} .. {high})"


def _number(value: float | None) -> str:
    """Three digits, without an exponent; what rounding leaves of nothing is 0."""
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{0.0 if abs(value) < 1e-6 else value:.3g}"


def draw(path: Path, found: dict[str, Any]) -> None:
    """A small plot for each measure, a line for each condition with its interval, the truth as a grey line through."""
    colours = dict(
        zip(CONDITIONS, (plots.INK, plots.COLOURS[2], plots.COLOURS[1], plots.COLOURS[0], plots.SOFT), strict=True)
    )
    with plots.sheet(path, plots.PAGE, 4.4) as figure:
        every = figure.subplots(3, 4)
        for axes, (measure, title) in zip(every.flat, PLOTTED.items(), strict=True):
            for row, name in enumerate(reversed(CONDITIONS)):
                value = found["groups"][name]["values"].get(measure)
                if value is None or value["value"] is None:
                    why = "the reference" if name == "truth" else "cannot be taken"
                    axes.text(0.03, row, why, va="center", fontsize=5.5, color=plots.SOFT,
                              transform=axes.get_yaxis_transform())  # fmt: skip
                    continue
                if value["low"] is not None:
                    axes.plot([value["low"], value["high"]], [row, row], color=colours[name], linewidth=2.0, alpha=0.45)
                axes.plot(value["value"], row, "o", color=colours[name], markersize=3.6)
                if name == "truth":
                    axes.axvline(value["value"], color=plots.PALE, linewidth=1.0, zorder=0)
            about = MEASURES[measure]
            axes.set_yticks(range(len(CONDITIONS)), reversed(CONDITIONS) if axes in every[:, 0] else [])
            axes.set(ylim=(-0.6, len(CONDITIONS) - 0.4), title=title)
            better = {"low": "\u2190 better", "high": "better \u2192"}.get(about.better, "as the truth")
            unit = about.unit.replace("^2", "\u00b2").replace("^3", "\u00b3")
            axes.set_xlabel(f"{unit}  {better}".strip(), fontsize=6)
            axes.margins(x=0.08)
            axes.tick_params(axis="y", length=0)


if __name__ == "__main__":
    main()
