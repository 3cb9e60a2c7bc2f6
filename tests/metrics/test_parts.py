"""Statistics of a half of the body: the other half, the place and the heading have no share in them."""

from functools import cache

import numpy as np
import pytest

from zeggs_jax.metrics import movement, parts, recognition
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.synthetic import gestures, prosody, styles


@cache
def performed(upper: str, lower: str, seed: int = 0) -> Movement:
    beats = np.arange(0.4, 7.5, 0.45)
    heard = prosody.Prosody(8.0, beats, 0.5 + 0.3 * np.sin(beats + seed) ** 2, np.array([[0.3, 7.6]]))
    return movement.of(gestures.perform(heard, styles.find(upper), 240, 30, seed, styles.find(lower)))


@pytest.mark.parametrize("half", ["upper", "lower"])
def test_neither_place_nor_heading_of_the_body_counts(half):
    motion = performed("happy", "old")
    cos, sin = np.cos(0.7), np.sin(0.7)
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    moved = motion._replace(positions=motion.positions @ turn.T + [40.0, 0.0, -25.0])
    np.testing.assert_allclose(parts.statistics(moved, half), parts.statistics(motion, half), atol=1e-6)


def test_a_half_reads_none_of_the_joints_of_the_other():
    motion, skeleton = performed("happy", "old"), performed("happy", "old").skeleton
    upper = {j for role in ("left_hand", "right_hand", "head") for j in skeleton.path(skeleton.role(role))}
    legs = {j for role in ("left_foot", "right_foot") for j in skeleton.path(skeleton.role(role))}
    shaken = np.random.default_rng(0).normal(size=motion.positions.shape)
    for half, other in (("upper", legs - upper), ("lower", upper - legs)):
        positions = motion.positions.copy()
        positions[:, sorted(other)] += shaken[:, sorted(other)]
        changed = parts.statistics(motion._replace(positions=positions), half)
        np.testing.assert_array_equal(changed, parts.statistics(motion, half))


@pytest.mark.parametrize("half", ["upper", "lower"])
def test_each_half_is_recognised_whatever_the_other_does(half):
    names = ("neutral", "old", "scared", "sneaky")
    rows = [(a if half == "upper" else b, performed(a, b)) for a in names for b in names]
    statistics = np.stack([parts.statistics(motion, half) for _, motion in rows])
    centroids = recognition.fit(statistics, [name for name, _ in rows])
    other = [
        (a if half == "upper" else b, performed(a, b, 5)) for a, b in zip(names, names[1:] + names[:1], strict=True)
    ]
    assert [recognition.nearest(centroids, parts.statistics(m, half)) for _, m in other] == [name for name, _ in other]


def test_another_half_is_refused():
    with pytest.raises(ValueError, match="upper or lower"):
        parts.statistics(performed("happy", "old"), "left")
