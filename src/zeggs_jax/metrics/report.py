"""Every measure of groups of made clips beside the recorded ones, with confidence intervals, as plain data for JSON."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from . import bootstrap, canonical, diversity, feature_net, feet, frechet, kinematic, movement, recognition, scores
from .bootstrap import Interval
from .feature_net import FeatureNet
from .scores import MEASURES, Sample

FORMAT = 1
TRUTH = "truth"  # the name of the row of the recorded clips

Pick = Int[np.ndarray, " N"]  # numbers of clips, drawn again


@dataclass(frozen=True)
class ReportConfig:
    """How sure the intervals are, and what the drawing begins with."""

    level: float = bootstrap.LEVEL
    draws: int = 500
    seed: int = 0


class _Row:
    """What is found of one group, and what could not be and why."""

    def __init__(self, name: str, config: ReportConfig, left_out: list[dict[str, str]]) -> None:
        self.name, self.config, self.left_out = name, config, left_out
        self.values: dict[str, dict[str, float | int | None]] = {}

    def add(self, measure: str, found: Interval, clips: int) -> None:
        value, low, high = (None if np.isnan(x) else float(x) for x in found)
        self.values[measure] = {"value": value, "low": low, "high": high, "clips": clips}

    def refuse(self, measure: str, error: ValueError | str, clip: str = "") -> None:
        self.left_out.append({"group": self.name, "clip": clip, "measure": measure, "reason": str(error)})

    def means(self, found: Sequence[dict[str, float]], strata: Sequence[str | None]) -> None:
        """The mean of every measure over the clips that have it."""
        config = self.config
        for measure in MEASURES:
            if has := [k for k, clip in enumerate(found) if measure in clip]:
                values, styles = np.array([found[k][measure] for k in has]), [strata[k] for k in has]
                self.add(measure, bootstrap.of_mean(values, config.seed, config.level, config.draws, styles), len(has))

    def statistic(
        self, measure: str, make: Callable[[], Callable[[Pick], float]], strata: Sequence[str | None]
    ) -> None:
        """A measure of the whole group that is never below zero; `make` prepares what every drawing of clips needs."""
        config, clips = self.config, len(strata)
        try:
            found = bootstrap.of_statistic(make(), clips, config.seed, config.level, config.draws, "centred", strata)
        except ValueError as error:
            self.refuse(measure, error)
        else:
            self.add(measure, found._replace(low=max(found.low, 0.0) if clips > 1 else found.low), clips)


def report(
    groups: Mapping[str, Sequence[Sample]],
    truth: Sequence[Sample],
    net: FeatureNet | None = None,
    config: ReportConfig | None = None,
) -> dict[str, Any]:
    """A table of all measures of `groups`, and of the truth itself as the first row, called "truth".

    The truth's distances are those between its own halves, its recognition its own accuracy; what compares a clip with
    the recorded one of the same speech is empty there. A measure that cannot be taken is not in the table but, with its
    reason, under "left_out". Intervals are over clips, drawn within their styles: a single clip has none (null).

    Raises:
        ValueError: no truth or a group without clips, two clips of one name in a group, a group called "truth", or
            clips that differ in skeleton or rate or hold NaN.
    """
    config = ReportConfig() if config is None else config
    _check(groups, truth)
    left_out: list[dict[str, str]] = []
    rows = {name: _Row(name, config, left_out) for name in (TRUTH, *groups)}
    for name, samples in {TRUTH: truth, **groups}.items():
        _clips(rows[name], samples, truth, made=name != TRUTH)
        _styles(rows[name], samples, truth, made=name != TRUTH)
        _distances(rows[name], samples, truth, net, made=name != TRUTH)
    return {
        "format": FORMAT,
        "settings": {
            **asdict(config),
            "rate_hz": truth[0].motion.rate_hz,
            "joints": len(truth[0].motion.skeleton),
            "feature_net": None if net is None else _net(net),
        },
        "measures": {name: measure._asdict() for name, measure in MEASURES.items()},
        "groups": {name: _summary(rows[name], samples) for name, samples in {TRUTH: truth, **groups}.items()},
        "left_out": left_out,
    }


def _check(groups: Mapping[str, Sequence[Sample]], truth: Sequence[Sample]) -> None:
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


def _clips(row: _Row, samples: Sequence[Sample], truth: Sequence[Sample], made: bool) -> None:
    """What is measured clip by clip."""
    ground = None
    try:
        ground = feet.ground([sample.motion for sample in truth])
    except ValueError as error:
        row.refuse("skate", error)
    recorded = {sample.name: sample.motion for sample in truth}
    found: list[dict[str, float]] = []
    for sample in samples:
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
        found.append(values)
    row.means(found, _strata(samples))


def _styles(row: _Row, samples: Sequence[Sample], truth: Sequence[Sample], made: bool) -> None:
    """Recognition, diversity, multimodality: measures of the style statistics of clips."""
    try:
        ours, theirs = (np.stack([kinematic.statistics_of(s.motion) for s in group]) for group in (samples, truth))
    except ValueError as error:
        row.refuse("recognised", error)
        return
    scale = theirs.std(axis=0).mean() + 1e-9
    if len(samples) > 1:
        row.statistic("diversity", lambda: lambda pick: diversity.diversity(ours[pick] / scale), _strata(samples))
    if groups := scores.shared(samples):
        features = np.stack([ours[group] / scale for group in groups])
        row.statistic(
            "multimodality", lambda: lambda pick: diversity.multimodality(features[pick]), [None] * len(groups)
        )
    if not any(sample.style for sample in samples):
        return
    try:
        right = _recognised(ours, samples, theirs, truth) if made else _own(theirs, truth)
    except ValueError as error:
        row.refuse("recognised", error)
    else:
        config = row.config
        named = [sample.style for sample in samples if sample.style]
        row.add("recognised", bootstrap.of_mean(right, config.seed, config.level, config.draws, named), len(right))


def _recognised(
    ours: Float[np.ndarray, "N S"], samples: Sequence[Sample], theirs: Float[np.ndarray, "M S"], truth: Sequence[Sample]
) -> Float[np.ndarray, " K"]:
    known, named = ([k for k, s in enumerate(group) if s.style] for group in (truth, samples))
    styles = [str(truth[k].style) for k in known]
    found = recognition.judge(theirs[known], styles, ours[named], [str(samples[k].style) for k in named])
    return np.array(found.right, np.float64)


def _own(theirs: Float[np.ndarray, "M S"], truth: Sequence[Sample]) -> Float[np.ndarray, " K"]:
    known = [k for k, sample in enumerate(truth) if sample.style]
    return np.array(recognition.own_hits(theirs[known], [str(truth[k].style) for k in known]), np.float64)


def _distances(
    row: _Row, samples: Sequence[Sample], truth: Sequence[Sample], net: FeatureNet | None, made: bool
) -> None:
    """Distances between the distributions of two groups; canonical correlation with the recorded clips."""
    readers = {"frechet_postures": frechet.postures, "frechet_velocities": frechet.velocities}
    if net is not None:
        readers["fgd"] = lambda clip: feature_net.embed(net, clip)
    for measure, read in readers.items():
        _frechet(row, measure, read, samples, truth, made)
    if not made:
        return
    orders: dict[str, kinematic.Order] = {"hellinger_speed": 1, "hellinger_acceleration": 2, "hellinger_jerk": 3}
    for measure, order in orders.items():
        row.statistic(measure, lambda order=order: _hellinger(samples, truth, order), _strata(samples))
    recorded = {sample.name: sample.motion for sample in truth}
    paired = [sample for sample in samples if sample.speech in recorded]
    pairs = [(scores.hands(sample.motion), scores.hands(recorded[sample.speech])) for sample in paired]
    if len(pairs) > 1:
        cut = [[side[: min(map(len, pair))] for side in pair] for pair in pairs]
        try:
            found = canonical.held_out(*map(list, zip(*cut, strict=True))).tolist()
            row.means([{"canonical": r} for r in found], _strata(paired))
        except ValueError as error:
            row.refuse("canonical", error)


def _frechet(
    row: _Row,
    measure: str,
    read: Callable[[movement.Movement], frechet.Samples],
    samples: Sequence[Sample],
    truth: Sequence[Sample],
    made: bool,
) -> None:
    try:
        theirs = [read(sample.motion) for sample in truth]
        if not made:
            halves = frechet.between_halves(theirs, row.config.seed, _strata(truth))
            row.add(measure, Interval(halves, float("nan"), float("nan")), len(truth))
            return
        ours, whole = [read(sample.motion) for sample in samples], np.concatenate(theirs)
    except ValueError as error:
        row.refuse(measure, error)
        return
    row.statistic(
        measure,
        lambda: lambda pick: frechet.distance(np.concatenate([ours[k] for k in pick]), whole),
        _strata(samples),
    )


def _hellinger(samples: Sequence[Sample], truth: Sequence[Sample], order: kinematic.Order) -> Callable[[Pick], float]:
    joints = movement.major(truth[0].motion.skeleton)
    edges = kinematic.edges_of([sample.motion for sample in truth], order, joints)
    ours, theirs = (
        np.stack([kinematic.histogram(sample.motion, order, edges, joints) for sample in group])
        for group in (samples, truth)
    )
    return lambda pick: kinematic.hellinger(ours[pick].sum(axis=0), theirs.sum(axis=0))


def _strata(samples: Sequence[Sample]) -> list[str | None]:
    """The styles that clips are drawn within."""
    return [sample.style for sample in samples]


def _summary(row: _Row, samples: Sequence[Sample]) -> dict[str, Any]:
    seconds = sum(len(sample.motion.positions) / sample.motion.rate_hz for sample in samples)
    return {"clips": len(samples), "seconds": round(seconds, 3), "values": row.values}


def _net(net: FeatureNet) -> dict[str, Any]:
    return {
        **asdict(net.config),
        "data_hash": net.data_hash,
        "fingerprint": net.fingerprint,
        "error_cm": net.error,
    }
