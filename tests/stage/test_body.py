"""Bodies fit their skeletons: left is left, the nose in front, soles are on the ground; others get bones."""

from dataclasses import replace

import numpy as np
import pytest

from zeggs_jax.motion.skeleton import Roles
from zeggs_jax.stage import anatomy, body, shapes


@pytest.fixture(scope="module")
def sample(clip):
    return anatomy.world(clip, np.arange(0, 60, 5))


def test_world_rotations_are_rotations_and_carry_the_offsets(clip, sample):
    eye = np.broadcast_to(np.eye(3), sample.mat.shape)
    np.testing.assert_allclose(np.swapaxes(sample.mat, -1, -2) @ sample.mat, eye, atol=2e-5)
    parents = np.array(clip.skeleton.parents[1:])
    carried = np.einsum("fjab,jb->fja", sample.mat[:, parents], clip.skeleton.offsets[1:])
    np.testing.assert_allclose(sample.pos[:, 1:] - sample.pos[:, parents], carried, atol=2e-3)


def test_limbs_are_found_and_start_at_shoulder_and_hip(clip):
    names = clip.skeleton.names
    spine, limbs = anatomy.find_limbs(clip.skeleton)
    assert [names[j] for j in spine] == ["Hips", "Spine", "Chest", "Neck", "Head"]
    arm, leg = limbs["left_hand"], limbs["right_foot"]
    assert (names[arm.joints[arm.start]], names[arm.joints[arm.middle]]) == ("LeftArm", "LeftForeArm")
    assert (names[leg.joints[leg.start]], names[leg.joints[leg.middle]]) == ("RightUpLeg", "RightLeg")


def test_stature_does_not_depend_on_the_pose(clip, sample):
    sitting = anatomy.Sample(sample.pos[:1] * 1.0, sample.mat[:1])
    spine, limbs = anatomy.find_limbs(clip.skeleton)
    tall = anatomy.stature(sample, spine, limbs)
    assert tall == pytest.approx(anatomy.stature(sitting, spine, limbs), rel=1e-4)
    assert 160 < tall < 185


def test_turning_and_moving_the_whole_clip_changes_only_the_heading(clip, sample):
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # a quarter turn about y
    moved = anatomy.Sample(sample.pos @ turn.T + [500.0, 0.0, -90.0], turn @ sample.mat)
    one, other = body.dress(clip.skeleton, sample), body.dress(clip.skeleton, moved)
    assert np.angle(np.exp(1j * (other.facing - one.facing))) == pytest.approx(np.pi / 2, abs=1e-4)
    assert other.floor == pytest.approx(one.floor, abs=1e-3)
    for a, b in zip(one.parts, other.parts, strict=True):
        for s, t in zip(a.stations, b.stations, strict=True):
            np.testing.assert_allclose(s.centre, t.centre, atol=2e-3)


def test_the_nose_points_ahead_and_the_eyes_are_left_and_right(clip, sample):
    head = clip.skeleton.index("Head")
    dark = [p for p in body.dress(clip.skeleton, sample).parts if p.tone == shapes.DARK]
    assert [np.sign(p.stations[0].centre[0]) for p in dark] == [1.0, -1.0]
    assert all(p.stations[0].joint == head and p.stations[0].centre[2] > 5 for p in dark)


def test_no_shape_sinks_far_into_the_ground(clip, sample):
    dressed = body.dress(clip.skeleton, sample)
    low = shapes.lowest(dressed.parts, sample)
    assert np.mean(low < dressed.floor - 1e-6) <= 0.1
    assert low.min() < dressed.floor + 1.0


def test_mirrored_limbs_get_equal_sizes(clip, sample):
    names = clip.skeleton.names
    sizes = {}
    for part in body.dress(clip.skeleton, sample).parts:
        sizes.setdefault(names[part.stations[0].joint], []).append([(s.width, s.depth) for s in part.stations])
    for name in ("Arm", "ForeArm", "Hand", "HandIndex1", "UpLeg", "Leg"):
        for a, b in zip(sizes["Left" + name], sizes["Right" + name], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-5)


def test_every_measure_is_a_positive_number(clip, sample, foreign_clip):
    for skeleton, seen in (
        (clip.skeleton, sample),
        (foreign_clip.skeleton, anatomy.world(foreign_clip, [0, 10])),
    ):
        dressed = body.dress(skeleton, seen)
        numbers = [[*s.centre, *s.side, *s.along, s.slope] for part in dressed.parts for s in part.stations]
        assert np.isfinite(numbers).all()
        assert all(min(s.width, s.depth, s.cap) > 0 for part in dressed.parts for s in part.stations)
        assert len(dressed.parts) > 20


def test_a_role_that_names_no_joint_gives_plain_bones(clip, sample):
    nameless = replace(clip.skeleton, roles=Roles(hips="Hips"))
    assert anatomy.find_limbs(nameless) == ((), {})
    assert {part.tone for part in body.dress(nameless, sample).parts} == {shapes.TOP}


def test_hull_of_a_square_and_its_inside():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5], [0.5, 0.0]], float)
    assert sorted(map(tuple, shapes.hull(square))) == [(0, 0), (0, 1), (1, 0), (1, 1)]
