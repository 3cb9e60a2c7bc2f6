"""Style recognition: nearest centroids, and the truth's own accuracy beside every figure."""

import numpy as np
import pytest

from zeggs_jax.metrics import kinematic, recognition
from zeggs_jax.synthetic import corpus


def clouds(spread, count=6, seed=4):
    """`count` points around each of three centres, and the name of each one's centre."""
    draw = np.random.default_rng(seed)
    centres = {"a": np.zeros(2), "b": np.array([5.0, 0.0]), "c": np.array([0.0, 5.0])}
    names = [name for name in centres for _ in range(count)]
    return np.stack([centres[name] + spread * draw.normal(size=2) for name in names]), names


def test_recognition_finds_the_nearest_and_needs_two_styles():
    points, names = clouds(0.1)
    centroids = recognition.fit(points, names)
    assert recognition.nearest(centroids, np.array([4.8, 0.3])) == "b"
    assert recognition.nearest(centroids, np.array([0.2, 4.0])) == "c"
    with pytest.raises(ValueError, match="two styles"):
        recognition.fit(points[:3], ["a", "a", "a"])


def test_named_styles_are_told_apart():
    clips = {(s, k): corpus.style_clip(s, 5.0, 30, 50 + k) for s in ("old", "happy", "still") for k in range(3)}
    statistics = np.stack([kinematic.style_statistics(clip) for clip in clips.values()])
    styles = [style for style, _ in clips]
    assert recognition.own_accuracy(statistics, styles) == 1.0
    held = [k for k, (_, seed) in enumerate(clips) if seed == 2]
    kept = [k for k in range(9) if k not in held]
    found = recognition.judge(statistics[kept], [styles[k] for k in kept], statistics[held], [styles[k] for k in held])
    assert found.recognised == ("old", "happy", "still")
    assert found.accuracy == found.truth == 1.0
    assert found.chance == pytest.approx(1 / 3)


def test_the_truths_own_accuracy_falls_to_chance_as_styles_run_together():
    found = [recognition.own_accuracy(*clouds(spread, 40)) for spread in (0.5, 3.0, 50.0)]
    assert found == sorted(found, reverse=True)
    assert found[0] == 1.0
    assert found[-1] < 0.5


def test_the_truth_is_never_judged_by_centroids_that_hold_it():
    """Two clips of pure noise per style: by their own centroids they would all be right."""
    points = np.random.default_rng(0).normal(size=(40, 60))
    styles = [f"s{k // 2}" for k in range(40)]
    centroids = recognition.fit(points, styles)
    itself = np.mean([recognition.nearest(centroids, p) == s for p, s in zip(points, styles, strict=True)])
    assert itself > 0.9
    assert recognition.own_accuracy(points, styles) < 0.3


def test_made_clips_of_another_style_or_of_none_are_not_recognised():
    points, names = clouds(0.3)
    other = [{"a": "b", "b": "c", "c": "a"}[name] for name in names]
    assert recognition.judge(points, names, points, other).accuracy == 0.0
    mean_pose = np.repeat(points[:1], len(points), axis=0)
    found = recognition.judge(points, names, mean_pose, names)
    assert found.accuracy == pytest.approx(found.chance) == pytest.approx(1 / 3)
    assert sum(found.right) == 6


def test_units_and_clips_given_twice_change_nothing():
    points, names = clouds(1.5)
    value = recognition.judge(points, names, points[::-1], names[::-1])
    assert recognition.judge(10.0 * points, names, 10.0 * points[::-1], names[::-1]) == value
    twice = recognition.judge(points, names, np.concatenate([points, points]), names + names)
    assert twice.accuracy == recognition.judge(points, names, points, names).accuracy


def test_what_cannot_be_recognised_is_refused():
    points, names = clouds(0.1)
    with pytest.raises(ValueError, match="no recorded clip shows the style 'd'"):
        recognition.judge(points, names, points[:1], ["d"])
    with pytest.raises(ValueError, match="only one recorded clip shows the style 'c'"):
        recognition.own_accuracy(points[:13], names[:13])
    with pytest.raises(ValueError, match="give some, one style each"):
        recognition.judge(points, names, points[:0], [])
    with pytest.raises(ValueError, match="row of numbers"):
        recognition.own_accuracy(np.full_like(points, np.nan), names)
