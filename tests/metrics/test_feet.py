"""Feet: planted ones are without fault, and each fault is measured as what it is."""

import numpy as np
import pytest

from zeggs_jax.metrics import feet
from zeggs_jax.motion.skeleton import Roles, Skeleton

FEET = ("LeftFoot", "LeftToe", "RightFoot", "RightToe")


@pytest.fixture(scope="module")
def truth(gesture):
    return gesture()


@pytest.fixture(scope="module")
def ground(truth):
    return feet.ground([truth])


def lifted(motion, height, names=FEET, at=slice(None)):
    positions = motion.positions.copy()
    for name in names:
        positions[at, motion.skeleton.index(name), 1] += height
    return motion._replace(positions=positions)


def sliding(motion, speed):
    positions = motion.positions.copy()
    positions[..., 2] += (np.arange(len(positions)) / motion.rate_hz * speed)[:, None]
    return motion._replace(positions=positions)


def test_planted_feet_stand_without_fault(truth, ground):
    found = feet.measure(truth, ground)
    assert found == (0.0, 1.0, 0.0, 0.0)
    np.testing.assert_allclose(ground.heights, [8.0, 2.0, 8.0, 2.0])


@pytest.mark.parametrize("speed", [1.0, 10.0, 80.0])
def test_skating_is_the_speed_of_feet_that_slide_however_fast(truth, ground, speed):
    assert feet.measure(sliding(truth, speed), ground).skate == pytest.approx(speed)


def test_skating_does_not_depend_on_the_frame_rate(gesture, ground):
    slow, fast = (feet.measure(sliding(gesture(rate_hz=r), 12.0), ground).skate for r in (30.0, 120.0))
    assert slow == pytest.approx(fast)


def test_a_walk_does_not_skate_while_the_foot_is_in_the_air(truth, ground):
    """Both feet rest for a second, then fly 20 cm forward."""
    step = np.arange(len(truth.positions)) % 60
    air = (step >= 30) & (step < 40)
    positions = truth.positions.copy()
    forward = np.cumsum(air) * 2.0
    for name in FEET:
        joint = truth.skeleton.index(name)
        positions[:, joint, 2] += forward
        positions[:, joint, 1] += 15.0 * air
    found = feet.measure(truth._replace(positions=positions), ground)
    assert found.skate == pytest.approx(0.0, abs=0.1)
    assert found.floating == pytest.approx(air[1:].mean(), abs=0.02)


def test_floating_needs_both_feet_in_the_air(truth, ground):
    assert feet.measure(lifted(truth, 10.0), ground).floating == 1.0
    assert feet.measure(lifted(truth, 10.0, FEET[:2]), ground).floating == 0.0
    assert feet.measure(lifted(truth, 1.0), ground).floating == 0.0
    half = feet.measure(lifted(truth, 10.0, at=slice(0, 120)), ground)
    assert half.floating == pytest.approx(0.5, abs=0.01)


def test_sinking_is_the_depth_beyond_half_a_centimetre(truth, ground):
    assert feet.measure(lifted(truth, -4.5), ground).sunk == pytest.approx(4.0)
    assert feet.measure(lifted(truth, -4.5, FEET[:1]), ground).sunk == pytest.approx(1.0)
    assert feet.measure(lifted(truth, -4.5), ground).floating == 0.0
    assert feet.measure(lifted(truth, -0.4), ground).sunk == 0.0


def test_without_a_ground_a_sunken_body_is_not_seen_as_such(truth):
    assert feet.measure(lifted(truth, -4.5)).sunk == 0.0


def test_trembling_skates_more_the_more_it_trembles(truth, ground, damage):
    found = [feet.measure(damage["trembling"](truth, size), ground).skate for size in (0.0, 0.05, 0.1, 0.2)]
    assert found == sorted(found)
    assert found[-1] > 3.0


def test_a_clip_given_twice_is_the_same_ground(truth, ground):
    np.testing.assert_array_equal(feet.ground([truth, truth]).heights, ground.heights)


def test_a_ground_of_another_body_and_a_body_without_feet_are_refused(truth, ground):
    with pytest.raises(ValueError, match="another skeleton"):
        feet.measure(truth, ground._replace(joints=(3, 4, 5, 6)))
    old = truth.skeleton
    legless = Skeleton(old.names, old.parents, old.offsets, Roles(hips="Hips"))
    with pytest.raises(ValueError, match="left foot"):
        feet.measure(truth._replace(skeleton=legless))
