"""From folders to a report: what `zeggs evaluate` reads, measures and writes."""

import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..data import made as made_clips
from ..data import recorded as recorded_clips
from ..data import spoken
from ..data.made import Made
from ..data.recorded import Recorded
from ..data.spoken import Spoken
from ..metrics import beats, feature_net, movement, net_file, report
from ..metrics.feature_net import FeatureNet, FeatureNetConfig
from ..metrics.rows import ReportConfig
from ..metrics.scores import Sample
from ..stage import legend, player
from ..stage import report as stage

FEW = 10  # clips: intervals of fewer are plainly too narrow
FASTEST_HZ = 1000.0  # that motion is resampled to
LONGER_S = 0.5  # by which a made clip may miss its recorded one's length before it is told
SHOWN = {"ape": "APE {:.1f} cm", "jerk": "jerk {:.0f} cm/s³", "skate": "skate {:.1f} cm/s"}
HEADLINE = ("fgd", "recognised", "ape", "jerk", "beat_consistency", "skate")


class Case(NamedTuple):
    """All that is judged."""

    truth: list[Sample]
    groups: dict[str, list[Sample]]
    recorded: dict[str, Recorded]
    made: dict[str, list[Made]]
    notes: list[str]


def read(
    generated: Sequence[str], truth: Path, speech: Path | None, split: str | None, rate: float | None, unpaired: bool
) -> Case:
    """Files into samples; ValueError or OSError for what cannot be judged."""
    found = recorded_clips.read_truth(truth, speech, split, rate)
    made = made_clips.read_groups(generated, found, rate)
    recorded = {clip.name: clip for clip in found.clips}
    if not unpaired and not any(clip.truth for group in made.values() for clip in group):
        group, first = next((name, clips[0].name) for name, clips in made.items())
        raise ValueError(
            f"none of the generated clips goes with a recorded one: the first of '{group}' is '{first}', the first of "
            f"'{truth}' is '{found.clips[0].name}'; name them alike (NAME.bvh or NAME__STYLE.bvh), or say --unpaired."
        )
    heard = {name: _heard(clip) for name, clip in recorded.items()}
    samples = [_sample(clip.name, clip, clip, clip.style, heard) for clip in found.clips]
    groups = {
        name: [_sample(clip.name, clip, clip.truth, clip.style, heard) for clip in clips]
        for name, clips in made.items()
    }
    report.check(groups, samples)
    return Case(samples, groups, recorded, made, [*found.problems, *_notes(made, recorded)])


def _heard(clip: Recorded) -> tuple[Spoken, np.ndarray] | None:
    speech = spoken.hear(clip)
    return None if speech is None else (speech, beats.onsets(speech.wave))


def _sample(
    name: str,
    clip: Recorded | Made,
    goes: Recorded | None,
    style: str | None,
    heard: Mapping[str, tuple[Spoken, np.ndarray] | None],
) -> Sample:
    motion = movement.of(clip.clip)
    voice = None if goes is None else heard[goes.name]
    if goes is None or voice is None:
        return Sample(name, motion, name if goes is None else goes.name, style)
    speech, onsets = voice
    frames = len(motion.positions)
    energy = spoken.loudness(speech.wave, frames, motion.rate_hz)

    def within(times: np.ndarray) -> np.ndarray:
        return times[(times >= 0.0) & (times <= frames / motion.rate_hz)]

    stresses = None if speech.stresses is None else within(speech.stresses)
    return Sample(name, motion, goes.name, style, within(onsets), stresses, energy)


def _notes(made: Mapping[str, Sequence[Made]], recorded: Mapping[str, Recorded]) -> Iterator[str]:
    """What a reader should know before believing the figures."""
    digests = {made_clips.digest(clip.path): clip.name for clip in recorded.values()}
    styles = {clip.style for clip in recorded.values() if clip.style}
    for group, clips in made.items():
        if 1 < len(clips) < FEW:
            yield f"'{group}' has {len(clips)} clips: intervals of so few are narrower than they should be."
        if alone := [clip.name for clip in clips if clip.truth is None]:
            yield f"{len(alone)} of the {len(clips)} clips of '{group}' go with no recorded clip (first: '{alone[0]}')."
        if lost := sorted(set(recorded) - {clip.truth.name for clip in clips if clip.truth}):
            told = f"'{group}' has no clip for {len(lost)} of the {len(recorded)} recorded ones (first: '{lost[0]}'); "
            yield f"{told}to compare like with like, give a truth of the same clips."
        if absent := sorted(styles - {str(clip.style) for clip in clips}):
            told = f"shows {len(styles) - len(absent)} of the truth's {len(styles)} styles; distances count that"
            yield f"'{group}' {told}."
        for clip in clips:
            seconds = [len(c.clip.euler) * c.clip.frame_time for c in (clip, clip.truth or clip)]
            if abs(seconds[0] - seconds[1]) > LONGER_S:
                yield f"'{clip.name}' of '{group}' lasts {seconds[0]:.1f} s and its recorded clip {seconds[1]:.1f} s."
        used = {sum_ for clip in clips for sum_ in (clip.provenance.get("inputs_sha256") or {}).values()}
        if leaked := sorted(digests[sum_] for sum_ in used & set(digests)):
            yield (
                f"'{group}' was made with '{leaked[0]}' as its style example, which is among the recorded clips"
                f"{f', as are {len(leaked) - 1} others' if len(leaked) > 1 else ''}: its figures are flattered."
            )
        if any(made_clips.digest(clip.path) in digests for clip in clips):
            yield f"'{group}' holds a file that is a recorded clip itself."


def train_net(case: Case, seed: int) -> tuple[FeatureNet | None, str]:
    """A feature net of the recorded clips and what to tell of it; None and why there is none."""
    try:
        net = feature_net.train([sample.motion for sample in case.truth], FeatureNetConfig(seed=seed))
    except ValueError as error:
        return None, f"no feature net: {error}"
    return net, f"the feature net was trained on the {len(case.truth)} recorded clips"


def read_net(path: Path, case: Case) -> FeatureNet:
    """The feature net of a file; FileNotFoundError or ValueError where there is none in it, or one of other joints."""
    if not path.is_file():
        raise FileNotFoundError(f"the feature net '{path}' does not exist; leave --feature-net out to train one.")
    try:
        with np.load(path) as arrays:
            net = net_file.unpack(dict(arrays))
    except Exception as error:
        told = str(error) if isinstance(error, ValueError) and "feature net" in str(error) else "it does not read"
        raise ValueError(f"'{path}' is no feature net of 'zeggs evaluate' ({told.rstrip('.')}).") from error
    feature_net.check(net, case.truth[0].motion.skeleton)
    return net


def measure(case: Case, net: FeatureNet | None, told: str, config: ReportConfig) -> dict[str, Any]:
    """All measures, with notes and provenance."""
    found = report.report(case.groups, case.truth, net, config, pictures=True)
    if net is None:
        found["left_out"].insert(0, {"group": report.TRUTH, "clip": "", "measure": "fgd", "reason": told})
    found["notes"] = case.notes
    found["provenance"] = {
        "zeggs_jax": version("zeggs-jax"),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "jax": version("jax"),
        "feature_net": told,
        "models": _models(case),
        "recorded_sha256": {clip.name: made_clips.digest(clip.path) for clip in case.recorded.values()},
        "generated_sha256": {
            f"{group}/{clip.name}": made_clips.digest(clip.path) for group, clips in case.made.items() for clip in clips
        },
    }
    return found


def _models(case: Case) -> dict[str, str]:
    """What the clips' own provenance says of the models and seeds that made them."""
    found: dict[str, str] = {}
    for group, clips in case.made.items():
        known = {
            (clip.provenance.get("model_sha256"), clip.provenance.get("zeggs_jax")) for clip in clips if clip.provenance
        }
        seeds = sorted({str(clip.provenance.get("seed")) for clip in clips if clip.provenance})
        models = ", ".join(sorted(f"{model} (zeggs-jax {release})" for model, release in known))
        found[group] = f"{models}; seeds {', '.join(seeds[:8])}" if known else "no provenance beside its clips"
    return found


def scenes(case: Case, found: Mapping[str, Any], count: int) -> list[stage.Scene]:
    """Recorded clips that most groups have a made one for, styles in turn, each beside those."""
    worn = legend.colours(list(found["groups"]))
    goes = {group: _first(clips) for group, clips in case.made.items()}
    shown = [name for name in case.recorded if any(name in first for first in goes.values())]
    turn: dict[str | None, int] = {}
    order = []
    for name in shown:
        style = case.recorded[name].style
        turn[style] = turn.get(style, -1) + 1
        order.append((-sum(name in first for first in goes.values()), turn[style], str(style), name))
    made = []
    for *_, name in sorted(order)[:count]:
        recorded = case.recorded[name]
        figures = [player.Figure("truth", recorded.clip, recorded.speech, worn[report.TRUTH])]
        lines = [_line(report.TRUTH, name, found)]
        for group, first in goes.items():
            if clip := first.get(name):
                figures.append(player.Figure(group, clip.clip, recorded.speech, worn[group]))
                lines.append(_line(group, clip.name, found))
        label = f"{name} · {recorded.style}" if recorded.style else name
        made.append(stage.Scene(label, player.scene(figures, 30.0), lines))
    return made


def _first(clips: Sequence[Made]) -> dict[str, Made]:
    """The first made clip for every recorded one."""
    return {clip.truth.name: clip for clip in reversed(clips) if clip.truth}


def _line(group: str, name: str, found: Mapping[str, Any]) -> str:
    clip = next(clip for clip in found["groups"][group]["each"] if clip["name"] == name)
    seen = [f"style {clip['style']}, taken for {clip['recognised_as']}"] if "recognised_as" in clip else []
    figures = [text.format(clip["values"][measure]) for measure, text in SHOWN.items() if measure in clip["values"]]
    return f"{group}: " + ", ".join([*seen, *figures])


def write(out: Path, found: Mapping[str, Any], case: Case, net: FeatureNet | None, players: int, title: str) -> None:
    """report.html, report.json and the feature net, each whole or not at all."""
    if net is not None:
        partial = out / f".feature_net.{os.getpid()}.npz"
        arrays: dict[str, Any] = net_file.pack(net)
        np.savez(partial, **arrays)
        os.replace(partial, out / "feature_net.npz")
    player.save(out / "report.json", json.dumps(found, indent=1, allow_nan=False) + "\n")
    stage.write(out / "report.html", found, scenes(case, found, players), title)


def summary(found: Mapping[str, Any]) -> list[str]:
    """A few measures as a table of text."""
    shown = [m for m in HEADLINE if any(m in group["values"] for group in found["groups"].values())]
    rows = [["", *shown]]
    for name, group in found["groups"].items():
        values = [group["values"].get(measure, {}).get("value") for measure in shown]
        rows.append([name, *("-" if value is None else f"{value:.3g}" for value in values)])
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  ".join(
            text.ljust(w) if k == 0 else text.rjust(w) for k, (text, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]
