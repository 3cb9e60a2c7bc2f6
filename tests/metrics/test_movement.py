"""What every measure asks of a motion: joints, rate, numbers; headings, rates and major joints."""

import numpy as np
import pytest

from zeggs_jax.metrics import movement
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.motion.skeleton import Roles, Skeleton


def test_a_motion_that_cannot_be_measured_is_refused_in_one_sentence(gesture):
    motion = gesture(seconds=1.0)
    hole = motion.positions.copy()
    hole[7, 5, 1] = np.nan
    wrong = {
        "in frame 7 (NaN": motion._replace(positions=hole),
        "'LeftHand'": motion._replace(positions=hole),
        "has 0 frames": motion._replace(positions=motion.positions[:0]),
        "has 1 frames": motion._replace(positions=motion.positions[:1]),
        "shape (30, 15, 3)": motion._replace(positions=motion.positions[:, :15]),
        "at 0 Hz": motion._replace(rate_hz=0),
        "at nan Hz": motion._replace(rate_hz=float("nan")),
    }
    for words, motion in wrong.items():
        with pytest.raises(ValueError) as caught:  # noqa: PT011
            movement.checked(motion)
        assert words in str(caught.value)
        assert str(caught.value).count(". ") == 0


def test_motions_that_do_not_go_together_are_refused(gesture):
    one = gesture(seconds=1.0)
    other = Skeleton(("Root", *one.skeleton.names[1:]), one.skeleton.parents, one.skeleton.offsets, Roles(hips="Root"))
    small = Skeleton(one.skeleton.names[:-1], one.skeleton.parents[:-1], one.skeleton.offsets[:-1])
    with pytest.raises(ValueError, match="first different joint: 'Hips'"):
        movement.pair(one, one._replace(skeleton=other))
    with pytest.raises(ValueError, match="16 joints and the truth another of 15"):
        movement.pair(one, Movement(one.positions[:, :-1], 30.0, small))
    with pytest.raises(ValueError, match="30 Hz and the truth at 60 Hz"):
        movement.pair(one, one._replace(rate_hz=60.0))
    with pytest.raises(ValueError, match="30 frames and the truth 29"):
        movement.pair(one, one._replace(positions=one.positions[:29]))
    with pytest.raises(ValueError, match="no motion"):
        movement.alike([])
    assert movement.alike([one, one._replace(rate_hz=30.001)])[1].rate_hz == 30.001


def test_major_joints_are_without_fingers_and_what_is_above_the_hips(gesture):
    skeleton = gesture(seconds=1.0).skeleton
    names = [skeleton.names[j] for j in movement.major(skeleton)]
    assert "LeftHandIndex" not in names
    assert "LeftToe" not in names
    assert set(names) >= {"Hips", "Spine2", "Head", "RightForeArm", "LeftFoot"}
    above = Skeleton(("World", *skeleton.names), (-1, *(p + 1 for p in skeleton.parents)), np.zeros((17, 3)))
    assert [above.names[j] for j in movement.major(above)] == names


def test_in_its_heading_neither_place_nor_direction_counts(gesture):
    motion = gesture()
    turn = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
    moved = motion._replace(positions=motion.positions @ turn.T + np.array([50.0, 0.0, -300.0]))
    np.testing.assert_allclose(movement.in_heading(moved).positions, movement.in_heading(motion).positions, atol=1e-9)
    left = movement.in_heading(moved).positions[:, motion.skeleton.role("left_hand"), 0]
    assert left.mean() > 10.0


@pytest.mark.parametrize("rate_hz", [10.0, 16.0, 30.0, 60.0])
def test_smooth_motion_is_the_same_at_any_rate(gesture, rate_hz):
    motion = movement.sampled(gesture(rate_hz=120.0), rate_hz)
    assert motion.rate_hz == rate_hz
    wanted = gesture(rate_hz=rate_hz).positions
    np.testing.assert_allclose(motion.positions[: len(wanted)], wanted[: len(motion.positions)], atol=0.05)
    assert abs(len(motion.positions) - len(wanted)) <= 1


def test_its_own_rate_changes_nothing(gesture):
    np.testing.assert_array_equal(movement.sampled(gesture(), 30.0).positions, gesture().positions)
    one = gesture()._replace(positions=gesture().positions[:1])
    assert len(movement.sampled(one, 10.0).positions) == 1
