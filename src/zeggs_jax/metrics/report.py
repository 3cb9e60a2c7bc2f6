"""Every measure of groups of made clips beside the recorded ones, with confidence intervals, as plain data for JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from . import distances, feet, movement, profiles, scores
from .feature_net import FeatureNet
from .rows import ReportConfig, Row
from .scores import MEASURES, Sample

__all__ = ["FORMAT", "TRUTH", "ReportConfig", "report"]

FORMAT = 2
TRUTH = "truth"  # the name of the row of the recorded clips


def report(
    groups: Mapping[str, Sequence[Sample]],
    truth: Sequence[Sample],
    net: FeatureNet | None = None,
    config: ReportConfig | None = None,
    pictures: bool = False,
) -> dict[str, Any]:
    """A table of all measures of `groups`, and of the truth itself as the first row, called "truth".

    The truth's distances are those between its own halves, its recognition its own accuracy; what compares a clip with
    the recorded one of the same speech is empty there. A measure that cannot be taken is not in the table but, with its
    reason, under "left_out". Intervals are over clips, drawn within their styles: a single clip has none (null). Under
    "each" stand the values of every clip; with `pictures` also "histograms" and "maps" (see `profiles`).

    Raises:
        ValueError: no truth or a group without clips, two clips of one name in a group, a group called "truth", or
            clips that differ in skeleton or rate or hold NaN.
    """
    config = ReportConfig() if config is None else config
    check(groups, truth)
    everything = {TRUTH: truth, **groups}
    left_out: list[dict[str, str]] = []
    rows = {name: Row(name, samples, config, left_out) for name, samples in everything.items()}
    for name, row in rows.items():
        made = name != TRUTH
        _clips(row, truth, made)
        distances.styles(row, truth, made)
        distances.distributions(row, truth, net, made)
        if made:
            distances.correlation(row, truth)
            row.beside(rows[TRUTH])
    found = {
        "format": FORMAT,
        "settings": {
            **asdict(config),
            "rate_hz": truth[0].motion.rate_hz,
            "joints": len(truth[0].motion.skeleton),
            "feature_net": None if net is None else _net(net),
        },
        "measures": {name: measure._asdict() for name, measure in MEASURES.items()},
        "groups": {name: row.summary() for name, row in rows.items()},
        "best": best({name: row.values for name, row in rows.items()}),
        "left_out": left_out,
    }
    if pictures:
        motions = {name: [sample.motion for sample in samples] for name, samples in everything.items()}
        found |= {"histograms": profiles.histograms(motions, TRUTH), "maps": profiles.maps(motions)}
    return found


def best(values: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> dict[str, list[str]]:
    """Of every measure that knows good from bad the made groups that are best, those of one value all.

    Where a measure should be as the truth's, that is the nearest to the recorded clips of the same speech
    ("recorded"), or to the truth's row where it is not a mean over clips; what has a chance beside it counts from
    there, or trembling would win. Of a single group none is best. Where intervals overlap, other clips may choose
    another one.
    """

    def above(row: Mapping[str, Mapping[str, Any]], name: str) -> float:
        return row[name]["value"] - row.get(f"{name}_chance", {"value": 0.0})["value"]

    def wanted(row: Mapping[str, Mapping[str, Any]], name: str) -> float | None:
        if "recorded" in row[name]:
            return row[name]["recorded"] - row.get(f"{name}_chance", {}).get("recorded", 0.0)
        return above(values[TRUTH], name) if name in values[TRUTH] else MEASURES[name].ideal

    found: dict[str, list[str]] = {}
    for name, measure in MEASURES.items():
        made = {g: above(row, name) for g, row in values.items() if g != TRUTH and name in row}
        own = {g: wanted(values[g], name) for g in made}
        if len(made) < 2 or measure.better == "beside" or (measure.better == "as the truth" and None in own.values()):
            continue
        away = {"low": lambda x, _: x, "high": lambda x, _: -x, "as the truth": lambda x, own: abs(x - own)}
        cost = {group: away[measure.better](value, own[group]) for group, value in made.items()}
        least = min(cost.values())
        found[name] = [group for group, value in cost.items() if np.isclose(value, least, rtol=1e-9, atol=1e-9)]
    return found


def check(groups: Mapping[str, Sequence[Sample]], truth: Sequence[Sample]) -> None:
    """Refuses, before any work is done, what `report` refuses."""
    if TRUTH in groups:
        raise ValueError("a group of made clips is called 'truth'; give it another name.")
    for name, samples in {TRUTH: truth, **groups}.items():
        names = [sample.name for sample in samples]
        if not names:
            raise ValueError(f"the group '{name}' has no clips; give one or more.")
        if len(set(names)) < len(names):
            twice = next(n for n in names if names.count(n) > 1)
            raise ValueError(f"two clips of the group '{name}' are called '{twice}'; give each its own name.")
    every = [(name, sample) for name, samples in {TRUTH: truth, **groups}.items() for sample in samples]
    movement.alike([s.motion for _, s in every], 4, [f"'{s.name}' of '{name}'" for name, s in every])


def _clips(row: Row, truth: Sequence[Sample], made: bool) -> None:
    """What is measured clip by clip."""
    ground = None
    try:
        ground = feet.ground([sample.motion for sample in truth])
    except ValueError as error:
        row.refuse("skate", error)
    recorded = {sample.name: sample.motion for sample in truth}
    found: dict[int, dict[str, float]] = {}
    for number, sample in enumerate(row.samples):
        calls = scores.of_clip(sample, ground)
        if made and sample.speech in recorded:
            calls |= scores.of_pair(sample.motion, recorded[sample.speech])
        elif made:
            row.refuse("ape", f"there is no recorded clip '{sample.speech}' to compare it with.", sample.name)
        values: dict[str, float] = {}
        for measure, call in calls.items():
            try:
                values |= call()
            except ValueError as error:
                row.refuse(measure, error, sample.name)
        found[number] = values
    row.means(found)


def _net(net: FeatureNet) -> dict[str, Any]:
    return {
        **asdict(net.config),
        "data_hash": net.data_hash,
        "fingerprint": net.fingerprint,
        "error_cm": net.error,
    }
