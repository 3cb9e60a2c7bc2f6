"""Does the right gesture come at its word: a recogniser of meanings from motion alone.

The recogniser is made from clips whose meanings are known (a synthetic corpus tells them) and tells how well it does
on clips that it was not made from: no share of made clips means anything beside a poor one.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .movement import Movement, checked

NOTHING = "nothing"  # the class of words without a gesture of their own
OFFSETS = np.arange(-0.3, 0.91, 0.1)  # s around the word at which the body is looked at
APART = 1.3  # s between a word and the nearest meaning for it to be an example of nothing
STEP = 0.1  # s between the times that `present` tries
SHRINK = 0.15  # share of the isotropic part in the spread within classes (Friedman 1989)


class Said(NamedTuple):
    """A word with a gesture of its own."""

    time: float  # s, of the word's stressed vowel
    meaning: str


class Detector(NamedTuple):
    """Linear discriminants: the class with the largest `weights @ features + bias` is recognised."""

    names: tuple[str, ...]  # `NOTHING` among them
    weights: Float[np.ndarray, "K F"]
    bias: Float[np.ndarray, " K"]


class Own(NamedTuple):
    """What a recogniser does with the truth, every clip by one that was made without it."""

    accuracy: float  # share of the words that are recognised as what they mean
    alarms: float  # share of the words of no meaning that are taken for some
    confusion: dict[str, dict[str, float]]  # meaning -> recognised as -> share


class Presence(NamedTuple):
    """How often the right gesture comes near its word."""

    share: float
    chance: float  # share of the words at which a gesture of another meaning would have counted, mean of all others
    of_meaning: dict[str, float]
    words: int


def features(movement: Movement, times: Float[np.ndarray, " N"]) -> Float[np.ndarray, "N F"]:
    """Wrists and head about each time (s), from the middle of the shoulders in the body's heading, in arm's lengths.

    Times before the beginning or after the end see the first or last frame.
    """
    seen = _seen(checked(movement))
    at = (np.asarray(times)[:, None] + OFFSETS[None]) * movement.rate_hz
    frames = np.arange(len(seen))
    columns = [np.interp(at, frames, column) for column in seen.T]
    return np.stack(columns, axis=-1).reshape(len(at), -1)


def _seen(movement: Movement) -> Float[np.ndarray, "T 9"]:
    """Left wrist, right wrist and top of the head: to the body's left, up and ahead."""
    skeleton, place = movement.skeleton, movement.positions
    left, right = (place[:, skeleton.parents[skeleton.parents[skeleton.role(f"{s}_hand")]]] for s in ("left", "right"))
    across, middle = left - right, 0.5 * (left + right)
    across[:, 1] = 0.0
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    up = np.broadcast_to(np.array([[0.0, 1.0, 0.0]]), across.shape)
    axes = np.stack([across, up, np.cross(across, up)], axis=1)
    head = skeleton.role("head")
    top = next((j for j, parent in enumerate(skeleton.parents) if parent == head), head)
    ends = [place[:, skeleton.role("left_hand")], place[:, skeleton.role("right_hand")], place[:, top]]
    arm = float(np.linalg.norm(_arm(movement)))
    turned = [np.einsum("tij,tj->ti", axes, end - middle) / arm for end in ends]
    return np.concatenate(turned, axis=1)


def _arm(movement: Movement) -> Float[np.ndarray, " 2"]:
    """Length of forearm and upper arm, cm; their norm stands for the arm's size."""
    skeleton, first = movement.skeleton, movement.positions[0]
    hand = skeleton.role("left_hand")
    elbow = skeleton.parents[hand]
    bones = [first[hand] - first[elbow], first[elbow] - first[skeleton.parents[elbow]]]
    return np.maximum(np.linalg.norm(np.stack(bones), axis=1), 1e-6)


def fit(movements: Sequence[Movement], said: Sequence[Sequence[Said]], seed: int = 0) -> Detector:
    """The recogniser of the meanings that are said in some clips, and of nothing, by linear discriminants.

    Raises:
        ValueError: other numbers of clips and lists of words, fewer than two meanings, one said only once.
    """
    _paired(movements, said)
    return _discriminants(*_examples(movements, said, seed))


def _paired(movements: Sequence[Movement], said: Sequence[Sequence[Said]]) -> None:
    if len(movements) != len(said) or not movements:
        raise ValueError(f"got {len(movements)} clips and {len(said)} lists of words; give one list for each clip.")


def _examples(
    movements: Sequence[Movement], said: Sequence[Sequence[Said]], seed: int
) -> tuple[Float[np.ndarray, "N F"], list[str]]:
    rows, labels = [], []
    for number, (movement, words) in enumerate(zip(movements, said, strict=True)):
        quiet = _quiet_times(movement, words, seed + number)
        rows.append(features(movement, np.array([*(one.time for one in words), *quiet])))
        labels += [*(one.meaning for one in words), *[NOTHING] * len(quiet)]
    return np.concatenate(rows), labels


def _quiet_times(movement: Movement, words: Sequence[Said], seed: int) -> list[float]:
    """Up to as many times as there are words, at random, away from all of them."""
    draw, seconds = np.random.default_rng([seed, 83]), len(movement.positions) / movement.rate_hz
    tried = draw.uniform(0.3, max(seconds - 0.9, 0.4), 8 * len(words) + 8).tolist()
    free = [t for t in tried if all(abs(t - one.time) > APART for one in words)]
    return free[: max(len(words), 2)]


def _discriminants(rows: Float[np.ndarray, "N F"], labels: Sequence[str]) -> Detector:
    names = tuple(sorted(set(labels)))
    label = np.array([names.index(one) for one in labels])
    counts = np.bincount(label)
    if len(names) < 3 or counts.min() < 2:
        few = names[int(counts.argmin())]
        raise ValueError(
            f"a recogniser needs two meanings or more, each said twice or more, got {len(names)} kinds of words and "
            f"'{few}' {counts.min()} time(s); give more clips."
        )
    centres = np.stack([rows[label == k].mean(axis=0) for k in range(len(names))])
    apart = rows - centres[label]
    within = apart.T @ apart / max(len(rows) - len(names), 1)
    within = (1.0 - SHRINK) * within + SHRINK * np.eye(len(within)) * np.trace(within) / len(within)
    weights = np.linalg.solve(within + 1e-9 * np.eye(len(within)), centres.T).T
    return Detector(names, weights, -0.5 * np.sum(weights * centres, axis=1))


def scores(detector: Detector, movement: Movement, times: Float[np.ndarray, " N"]) -> Float[np.ndarray, "N K"]:
    """Probability of each of the detector's classes at each time (s)."""
    logits = features(movement, times) @ detector.weights.T + detector.bias[None]
    odds = np.exp(logits - logits.max(axis=1, keepdims=True))
    return odds / odds.sum(axis=1, keepdims=True)


def detect(detector: Detector, movement: Movement, time: float) -> tuple[str, float]:
    """(what is gestured at `time` (s), or `NOTHING`; its probability)."""
    found = scores(detector, movement, np.array([time]))[0]
    return detector.names[int(found.argmax())], float(found.max())


def present(detector: Detector, movement: Movement, time: float, meaning: str, within: float = 0.5) -> bool:
    """Whether the gesture of `meaning` is recognised at some time within `within` s of the word at `time`.

    Raises:
        ValueError: the detector does not know the meaning.
    """
    if meaning not in detector.names:
        raise ValueError(f"the recogniser knows no {meaning!r}; it knows {', '.join(detector.names)}.")
    return meaning in _recognised(detector, movement, time, within)


def _recognised(detector: Detector, movement: Movement, time: float, within: float) -> set[str]:
    times = time + np.arange(-within, within + 1e-6, STEP)
    found = scores(detector, movement, times).argmax(axis=1)
    return {detector.names[k] for k in found}


def presence(
    detector: Detector, movements: Sequence[Movement], said: Sequence[Sequence[Said]], within: float = 0.5
) -> Presence:
    """How often the right gesture comes within `within` s of its word, and how often another one would have counted.

    Raises:
        ValueError: no words, other numbers of clips and lists of words, a meaning that the detector does not know.
    """
    _paired(movements, said)
    hits: list[tuple[str, bool, float]] = []
    meanings = [name for name in detector.names if name != NOTHING]
    for movement, words in zip(movements, said, strict=True):
        for one in words:
            right = present(detector, movement, one.time, one.meaning, within)
            others = _recognised(detector, movement, one.time, within) - {one.meaning, NOTHING}
            hits.append((one.meaning, right, len(others) / max(len(meanings) - 1, 1)))
    if not hits:
        raise ValueError("no word of these clips has a gesture of its own; give clips whose words do.")
    of_meaning = {
        name: float(np.mean([right for meaning, right, _ in hits if meaning == name]))
        for name in sorted({meaning for meaning, *_ in hits})
    }
    share, chance = float(np.mean([right for _, right, _ in hits])), float(np.mean([other for *_, other in hits]))
    return Presence(share, chance, of_meaning, len(hits))


def own_accuracy(movements: Sequence[Movement], said: Sequence[Sequence[Said]], folds: int = 5, seed: int = 0) -> Own:
    """What recognisers made from some of the clips do with the others, in `folds` parts.

    Raises:
        ValueError: fewer clips than folds, or what `fit` refuses.
    """
    _paired(movements, said)
    if len(movements) < folds or folds < 2:
        raise ValueError(f"{len(movements)} clips are too few for {folds} parts; give more clips.")
    pairs: list[tuple[str, str]] = []
    for fold in range(folds):
        rest = [k for k in range(len(movements)) if k % folds != fold]
        detector = fit([movements[k] for k in rest], [said[k] for k in rest], seed)
        for k in range(fold, len(movements), folds):
            rows, labels = _examples([movements[k]], [said[k]], seed + 1000)
            found = (rows @ detector.weights.T + detector.bias[None]).argmax(axis=1)
            pairs += [(label, detector.names[i]) for label, i in zip(labels, found, strict=True)]
    meant = [(label, found) for label, found in pairs if label != NOTHING]
    quiet = [found != NOTHING for label, found in pairs if label == NOTHING]
    accuracy = float(np.mean([label == found for label, found in meant]))
    return Own(accuracy, float(np.mean(quiet)) if quiet else 0.0, _confusion(pairs))


def _confusion(pairs: Sequence[tuple[str, str]]) -> dict[str, dict[str, float]]:
    table: dict[str, dict[str, float]] = {}
    for name in sorted({label for label, _ in pairs}):
        found = [f for label, f in pairs if label == name]
        table[name] = {other: found.count(other) / len(found) for other in sorted(set(found))}
    return table
