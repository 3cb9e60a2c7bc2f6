"""Edits: exact mirrors, times that are kept, rigid moves, and clips that fit or are refused by name."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.motion import edit
from zeggs_jax.motion.features import encode, local_quaternions, world_positions
from zeggs_jax.motion.skeleton import Skeleton


def asymmetric(clip):
    """The same motion on a body whose left arm is longer and whose head is tilted to a side."""
    offsets = clip.skeleton.offsets + np.random.default_rng(3).normal(size=clip.skeleton.offsets.shape)
    body = Skeleton(clip.skeleton.names, clip.skeleton.parents, offsets)
    positions = np.concatenate([clip.positions[:, :1], np.tile(offsets[1:], (len(clip.euler), 1, 1))], axis=1)
    return clip._replace(skeleton=body, positions=positions)


def test_trim_takes_the_frames_asked_for(clip):
    part = edit.trim(clip, 10, 20)
    np.testing.assert_array_equal(part.euler, clip.euler[10:20])
    np.testing.assert_array_equal(part.positions, clip.positions[10:20])
    assert len(edit.trim(clip, 10).euler) == 50


@pytest.mark.parametrize(("start", "stop"), [(-1, 5), (5, 5), (6, 5), (0, 61), (60, None)])
def test_trim_outside_the_clip_is_refused(clip, start, stop):
    with pytest.raises(ValueError, match=r"are not in the clip, which has frames 0:60\."):
        edit.trim(clip, start, stop)


def test_mirroring_twice_changes_nothing(clip):
    body = asymmetric(clip)
    twice = edit.mirror(edit.mirror(body))
    np.testing.assert_array_equal(twice.euler, body.euler)
    np.testing.assert_array_equal(twice.positions, body.positions)
    np.testing.assert_array_equal(twice.skeleton.offsets, body.skeleton.offsets)
    assert twice.orders == body.orders
    assert not np.allclose(edit.mirror(body).euler, body.euler)


@pytest.mark.parametrize("keep_offsets", [False, True])
def test_the_mirror_image_is_where_a_mirror_would_show_it(clip, keep_offsets):
    """Exact on any body; with the body kept, exact where its sides are alike."""
    body = clip if keep_offsets else asymmetric(clip)
    image = edit.mirror(body, keep_offsets)
    across = np.asarray(body.skeleton.mirror_map())
    np.testing.assert_allclose(world_positions(image), world_positions(body)[:, across] * [-1, 1, 1], atol=1e-9)


def test_the_mirror_keeps_the_body_where_asked(clip):
    body = asymmetric(clip)
    image = edit.mirror(body, keep_offsets=True)
    np.testing.assert_array_equal(image.skeleton.offsets, body.skeleton.offsets)
    np.testing.assert_allclose(image.positions[:, 1:], body.positions[:, 1:], atol=1e-12)


def test_features_of_the_image_are_the_image_of_the_features(clip):
    a, b = encode(clip), encode(edit.mirror(clip))
    across = np.asarray(clip.skeleton.mirror_map())
    polar, axial = jnp.array([[-1.0, 1.0, 1.0]]), jnp.array([[1.0, -1.0, -1.0]])
    np.testing.assert_allclose(b.pose.root_vel, a.pose.root_vel * polar, atol=1e-3)
    np.testing.assert_allclose(b.pose.root_ang, a.pose.root_ang * axial, atol=1e-3)
    np.testing.assert_allclose(b.pose.joint_pos, a.pose.joint_pos[:, across] * polar[None], atol=1e-4)
    np.testing.assert_allclose(b.pose.joint_ang, a.pose.joint_ang[:, across] * axial[None], atol=1e-3)
    np.testing.assert_allclose(b.gaze, a.gaze * polar[0], atol=1e-3)


def test_retiming_by_one_changes_nothing(clip):
    same = edit.retime(clip, 1.0)
    np.testing.assert_allclose(world_positions(same), world_positions(clip), atol=1e-9)


@pytest.mark.parametrize("factor", [0.9, 1.1, 2.0])
def test_retiming_keeps_the_path_and_the_frame_time(clip, factor):
    other = edit.retime(clip, factor)
    assert len(other.euler) == int(factor * 60)
    assert other.frame_time == clip.frame_time
    ours, given = world_positions(other), world_positions(clip)
    np.testing.assert_allclose(ours[[0, -1]], given[[0, -1]], atol=1e-9)
    speed = [np.linalg.norm(np.diff(x, axis=0), axis=-1).sum(axis=0) for x in (ours, given)]
    np.testing.assert_allclose(*speed, rtol=0.02)  # every joint's path is as long as it was


def test_retiming_to_nothing_is_refused(clip):
    with pytest.raises(ValueError, match=r"A clip of 60 frames cannot be retimed by 0\.001"):
        edit.retime(clip, 0.001)


def test_resampling_to_the_same_rate_changes_nothing(clip):
    assert edit.resample(clip, 60.0) is clip


@pytest.mark.parametrize("rate", [120.0, 25.0, 30.0, 61.7])
def test_resampling_keeps_the_time(clip, rate):
    """Frame k is the motion at k / rate, and no frame lies beyond the last one given."""
    other = edit.resample(clip, rate)
    assert other.frame_time == pytest.approx(1 / rate)
    assert 59 / 60 - 1 / rate < (len(other.euler) - 1) / rate <= 59 / 60 + 1e-9
    given, ours = world_positions(clip), world_positions(other)
    at = np.arange(len(ours)) * 60 / rate
    before = np.minimum(at.astype(int), 58)
    expected = given[before] + (at - before)[:, None, None] * (given[before + 1] - given[before])
    assert np.abs(ours - expected).max() < 0.3  # cm, against a straight line between frames


def test_resampling_up_and_down_again_gives_the_clip_back(clip):
    back = edit.resample(edit.resample(clip, 180.0), 60.0)
    np.testing.assert_allclose(world_positions(back), world_positions(clip), atol=1e-9)


def test_resampling_a_single_frame_and_a_senseless_rate(clip):
    assert len(edit.resample(edit.trim(clip, 0, 1), 120.0).euler) == 1
    with pytest.raises(ValueError, match="give a rate above 0"):
        edit.resample(clip, 0.0)


def test_centring_is_a_rigid_move_to_the_origin(clip):
    moved = edit.centre(clip)
    ours, given = world_positions(moved), world_positions(clip)
    np.testing.assert_allclose(moved.positions[0, 0] * [1, 0, 1], 0, atol=1e-12)
    np.testing.assert_allclose(ours[..., 1], given[..., 1], atol=1e-9)  # height stays
    for a in (ours, given):
        a -= a[:1, :1]  # distances between all joints and frames
    np.testing.assert_allclose(np.linalg.norm(ours, axis=-1), np.linalg.norm(given, axis=-1), atol=1e-9)
    first = local_quaternions(moved)[0, 0]
    np.testing.assert_allclose(first[2], 0, atol=1e-9)  # no turn about y is left


def test_centring_as_released_is_not_rigid(clip):
    leaning = clip._replace(euler=clip.euler + np.array([0.0, 0.3, 0.3]))
    released, ours = edit.centre(leaning, as_released=True), edit.centre(leaning)
    difference = np.abs(world_positions(released) - world_positions(ours)).max()
    assert 0.01 < difference < 30


def test_joints_in_another_order_are_put_in_order(clip):
    names = clip.skeleton.names
    shuffled = ("Hips", "LeftFoot", "RightFoot", *names[1:8])
    order = [names.index(name) for name in shuffled]
    parent = {name: names[p] for name, p in zip(names, clip.skeleton.parents, strict=True) if p >= 0}
    parents = tuple(shuffled.index(parent[name]) if name in parent else -1 for name in shuffled)
    other = clip._replace(
        skeleton=Skeleton(shuffled, parents, clip.skeleton.offsets[order]),
        orders=tuple(clip.orders[joint] for joint in order),
        euler=clip.euler[:, order],
        positions=clip.positions[:, order],
    )
    back = edit.fit(other, clip.skeleton, "clip 'x.bvh'")
    np.testing.assert_array_equal(back.euler, clip.euler)
    assert (back.skeleton.names, back.skeleton.parents, back.orders) == (
        names,
        clip.skeleton.parents,
        clip.orders,
    )
    assert edit.fit(clip, clip.skeleton, "clip 'x.bvh'") is clip
    jax.tree.map(np.testing.assert_array_equal, encode(back), encode(clip))


def test_another_body_is_refused_by_name(clip):
    body = clip.skeleton
    less = Skeleton(body.names[:-1], body.parents[:-1], body.offsets[:-1])
    more = Skeleton((*body.names, "Tail"), (*body.parents, 0), np.zeros((11, 3)))
    other = Skeleton(body.names, (*body.parents[:-1], 1), body.offsets)
    with pytest.raises(
        ValueError,
        match=r"^style example 'old\.bvh' has 10 joints, the model .* 11; first missing: 'Tail'\.$",
    ):
        edit.fit(clip, more, "style example 'old.bvh'")
    with pytest.raises(ValueError, match="has 10 joints, the model was trained on 9; first unknown: 'RightFoot'"):
        edit.fit(clip, less, "style example 'old.bvh'")
    with pytest.raises(ValueError, match="has joint 'RightFoot' under another parent than 'Spine'"):
        edit.fit(clip, other, "style example 'old.bvh'")


def below_a_root(clip):
    """The clip under one more joint, which is turned half round and lies elsewhere."""
    own = clip.skeleton
    names, parents = ("Root", *own.names), (-1, *(parent + 1 for parent in own.parents))
    frames = len(clip.euler)
    skeleton = Skeleton(names, parents, np.concatenate([np.zeros((1, 3)), own.offsets]))
    euler = np.concatenate([np.tile([0.0, np.pi, 0.0], (frames, 1, 1)), clip.euler], axis=1)
    positions = np.concatenate([np.tile([300.0, 0.0, 50.0], (frames, 1, 1)), clip.positions], axis=1)
    return clip._replace(skeleton=skeleton, orders=("zyx", *clip.orders), euler=euler, positions=positions)


def test_centring_goes_by_the_hips_wherever_they_are_in_the_hierarchy(clip):
    expected, found = edit.centre(clip), edit.centre(below_a_root(clip))
    np.testing.assert_allclose(world_positions(found)[:, 1:], world_positions(expected), atol=1e-9)


def test_a_helper_on_one_side_keeps_its_place_in_a_mirror(clip):
    own = clip.skeleton
    names, parents = (*own.names, "p_l_delt"), (*own.parents, own.index("LeftArm"))
    offsets = np.concatenate([own.offsets, [[3.0, 1.0, 0.0]]])
    frames = len(clip.euler)
    positions = np.concatenate([clip.positions, np.tile(offsets[-1], (frames, 1, 1))], axis=1)
    euler = np.concatenate([clip.euler, np.zeros((frames, 1, 3))], axis=1)
    helped = clip._replace(
        skeleton=Skeleton(names, parents, offsets), orders=(*clip.orders, "zyx"), euler=euler, positions=positions
    )
    image = edit.mirror(helped)
    np.testing.assert_array_equal(image.skeleton.offsets[-1], offsets[-1])
    np.testing.assert_array_equal(image.positions[:, :-1], edit.mirror(clip).positions)
