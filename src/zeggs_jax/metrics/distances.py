"""What a report measures of whole groups: styles recognised, diversity, distances between distributions of motion."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from . import bootstrap, canonical, diversity, feature_net, frechet, kinematic, movement, recognition, scores
from .bootstrap import Interval
from .feature_net import FeatureNet
from .movement import Movement
from .rows import Pick, Row
from .scores import Sample

ALIKE = 1e-6  # mean spread of style statistics below which clips are one and the same
ORDERS: dict[str, kinematic.Order] = {"hellinger_speed": 1, "hellinger_acceleration": 2, "hellinger_jerk": 3}


def styles(row: Row, truth: Sequence[Sample], made: bool) -> None:
    """Recognition, diversity, multimodality: measures of the style statistics of clips."""
    samples = row.samples
    try:
        ours, theirs = (np.stack([kinematic.statistics_of(s.motion) for s in group]) for group in (samples, truth))
    except ValueError as error:
        row.refuse("recognised", error)
        return
    _variety(row, ours, float(theirs.std(axis=0).mean()))
    if not any(sample.style for sample in samples):
        row.refuse("recognised", "no style of its clips is known; name them NAME__STYLE.bvh or give corpus.csv.")
        return
    try:
        _recognition(row, ours, theirs, truth, made)
    except ValueError as error:
        row.refuse("recognised", error)


def _variety(row: Row, ours: Float[np.ndarray, "N S"], scale: float) -> None:
    """Diversity and multimodality, in the truth's mean spread `scale`."""
    if not scale > ALIKE:
        row.refuse("diversity", "the recorded clips are one clip or all alike, so nothing says how much is much.")
        return
    if len(row.samples) > 1:
        row.statistic("diversity", lambda: lambda pick: diversity.diversity(ours[pick] / scale))
    if groups := scores.shared(row.samples):
        features = np.stack([ours[group] / scale for group in groups])
        row.statistic(
            "multimodality", lambda: lambda pick: diversity.multimodality(features[pick]), [None] * len(groups)
        )


def _recognition(
    row: Row, ours: Float[np.ndarray, "N S"], theirs: Float[np.ndarray, "M S"], truth: Sequence[Sample], made: bool
) -> None:
    """Share of clips recognised, by the styles that two recorded clips or more show; what was seen, for each clip."""
    shown = [sample.style for sample in truth]
    usable = {style for style in shown if style and shown.count(style) > 1}
    known = [k for k, style in enumerate(shown) if style in usable]
    named = [k for k, sample in enumerate(row.samples) if sample.style in usable]
    unusable = sorted({str(s.style) for s in row.samples if s.style} - usable)
    for reason, count in (("only one recorded clip shows the style", 1), ("no recorded clip shows", 0)):
        if few := [style for style in unusable if shown.count(style) == count]:
            others = f" (likewise {len(few) - 1} others)" if len(few) > 1 else ""
            row.refuse("recognised", f"{reason} '{few[0]}'{others}; give two or more of each style.")
    if not named:
        return
    labels = [str(shown[k]) for k in known]
    if made:
        wanted = [str(row.samples[k].style) for k in named]
        seen = recognition.judge(theirs[known], labels, ours[named], wanted).recognised
    else:
        seen = recognition.own(theirs[known], labels)
        wanted = labels
    right = np.array([found == style for found, style in zip(seen, wanted, strict=True)], np.float64)
    for k, found in zip(named, seen, strict=True):
        row.each[k]["recognised_as"] = found
    config = row.config
    row.add("recognised", bootstrap.of_mean(right, config.seed, config.level, config.draws, wanted), len(right))


def distributions(row: Row, truth: Sequence[Sample], net: FeatureNet | None, made: bool) -> None:
    """Frechet distances of features, postures and velocities; Hellinger distances of how fast joints move."""
    readers = {"frechet_postures": frechet.postures, "frechet_velocities": frechet.velocities}
    if net is not None:
        readers["fgd"] = lambda clip: feature_net.embed(net, clip)
    for measure, read in readers.items():
        _frechet(row, measure, read, truth, made)
    if made:
        for measure, order in ORDERS.items():
            row.statistic(measure, lambda order=order: _hellinger(row.samples, truth, order))


def _frechet(
    row: Row, measure: str, read: Callable[[Movement], frechet.Samples], truth: Sequence[Sample], made: bool
) -> None:
    try:
        theirs = [frechet.moments(read(sample.motion)) for sample in truth]
        if not made:
            halves = frechet.between_halves(theirs, row.config.seed, row.strata)
            row.add(measure, Interval(halves, float("nan"), float("nan")), len(truth))
            return
        ours, whole = [frechet.moments(read(sample.motion)) for sample in row.samples], frechet.normal(theirs)
    except ValueError as error:
        row.refuse(measure, error)
        return
    row.statistic(measure, lambda: lambda pick: frechet.between(frechet.normal([ours[k] for k in pick]), whole))


def _hellinger(samples: Sequence[Sample], truth: Sequence[Sample], order: kinematic.Order) -> Callable[[Pick], float]:
    joints = movement.major(truth[0].motion.skeleton)
    edges = kinematic.edges_of([sample.motion for sample in truth], order, joints)
    ours, theirs = (
        np.stack([kinematic.histogram(sample.motion, order, edges, joints) for sample in group])
        for group in (samples, truth)
    )
    return lambda pick: kinematic.hellinger(ours[pick].sum(axis=0), theirs.sum(axis=0))


def correlation(row: Row, truth: Sequence[Sample]) -> None:
    """Canonical correlation of made and recorded hands; each clip's by directions fitted on the others."""
    recorded = {sample.name: sample.motion for sample in truth}
    paired = [k for k, sample in enumerate(row.samples) if sample.speech in recorded]
    if len(paired) < 2:
        row.refuse("canonical", f"{len(paired)} clips with a recorded one are too few; give two or more.")
        return
    both = [(row.samples[k].motion, recorded[row.samples[k].speech]) for k in paired]
    pairs = [[scores.hands(motion) for motion in pair] for pair in both]
    cut = [[side[: min(map(len, pair))] for side in pair] for pair in pairs]
    try:
        found = canonical.held_out(*map(list, zip(*cut, strict=True))).tolist()
    except ValueError as error:
        row.refuse("canonical", error)
    else:
        row.means({k: {"canonical": r} for k, r in zip(paired, found, strict=True)})
