"""Motion features: there and back, independent of the world, consistent with integration, no NaN anywhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.geometry import quaternion
from zeggs_jax.motion import edit, features
from zeggs_jax.motion.features import decode, encode, local_quaternions, world_positions
from zeggs_jax.motion.pose import Root, gaze_direction, integrate
from zeggs_jax.motion.skeleton import Skeleton


def yawed(clip, turn: float, shift=(0.0, 0.0, 0.0)):
    """The clip turned about y by `turn` radians, then shifted."""
    half = turn / 2
    spin = np.array([np.cos(half), 0, np.sin(half), 0])
    rotations, positions = local_quaternions(clip), clip.positions.copy()
    every = np.broadcast_to(spin, rotations[:, 0].shape)
    with jax.enable_x64(True):
        rotations[:, 0] = quaternion.multiply(every, rotations[:, 0])
        positions[:, 0] = quaternion.rotate(every, positions[:, 0]) + np.broadcast_to(shift, positions[:, 0].shape)
    return features.with_quaternions(clip, rotations, positions)


def test_there_and_back(clip):
    motion = encode(clip)
    assert all(x.dtype == jnp.float32 and np.isfinite(x).all() for x in jax.tree.leaves(motion))
    back = decode(motion.pose, clip.skeleton, clip.frame_time, rebase=False, offsets="per_frame")
    np.testing.assert_allclose(world_positions(back), world_positions(clip), atol=1e-3)
    assert back.frame_time == clip.frame_time
    # joints that turn about their own bone move nothing: compare rotations too
    with jax.enable_x64(True):
        same = np.abs(np.sum(local_quaternions(back) * local_quaternions(clip), axis=-1))
    np.testing.assert_allclose(same, 1, atol=1e-6)


def test_features_do_not_depend_on_the_world(clip):
    motion, moved = encode(clip), encode(yawed(clip, 2.0, (30.0, 0.0, -70.0)))
    for field in ("root_vel", "root_ang", "joint_pos", "joint_axes", "joint_vel", "joint_ang"):
        np.testing.assert_allclose(getattr(moved.pose, field), getattr(motion.pose, field), atol=2e-4, err_msg=field)


def test_root_velocities_integrate_to_the_root(clip):
    pose = encode(clip).pose
    for frame in range(1, len(clip.euler)):
        before = Root(pose.root.pos[frame - 1], pose.root.rot[frame - 1])
        after = integrate(before, pose.root_vel[frame], pose.root_ang[frame], clip.frame_time)
        np.testing.assert_allclose(after.pos, pose.root.pos[frame], atol=1e-4)
        assert abs(float(after.rot @ pose.root.rot[frame])) > 1 - 1e-6


def test_root_is_a_yaw_under_the_spine(clip):
    """The clip turns through 5 radians: w stays positive, and the root stays below the spine."""
    root = encode(clip).pose.root
    assert (root.rot[:, 0] >= 0).all()
    np.testing.assert_array_equal(root.rot[:, jnp.array([1, 3])], 0)
    spine = world_positions(clip)[:, clip.skeleton.role("spine")]
    np.testing.assert_allclose(root.pos, spine * [1, 0, 1], atol=1e-4)


def test_velocities_are_backward_differences_and_the_first_extrapolated(clip):
    pose = encode(clip).pose
    dt = clip.frame_time
    np.testing.assert_allclose(pose.joint_vel[1:], np.diff(pose.joint_pos, axis=0) / dt, atol=0.01)
    vel = np.asarray(pose.joint_vel)
    np.testing.assert_allclose(vel[0], vel[1] - (vel[3] - vel[2]), atol=1e-3)
    ang = np.asarray(pose.joint_ang)
    np.testing.assert_allclose(ang[0], ang[1] - (ang[3] - ang[2]), atol=1e-4)


def test_gaze_is_100_cm_ahead_of_a_body_that_stands_still(clip):
    still = clip._replace(euler=clip.euler * 0, positions=np.tile(clip.skeleton.offsets, (len(clip.euler), 1, 1)))
    motion = encode(still)
    np.testing.assert_allclose(motion.gaze, [0, 0, 99], atol=1e-4)  # the spine stands 1 cm back
    np.testing.assert_allclose(
        gaze_direction(jax.tree.map(lambda x: x[0], motion.pose.root), motion.gaze), [0, 0, 100], atol=1e-4
    )


@pytest.mark.parametrize("turn", [np.pi, -np.pi])
def test_facing_backwards_is_a_half_turn(clip, turn):
    """The release divides zero by zero here."""
    still = clip._replace(euler=clip.euler * 0, positions=np.tile(clip.skeleton.offsets, (len(clip.euler), 1, 1)))
    still.euler[:, 0, 1] = turn  # order zyx: about y
    motion = encode(still)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(motion))
    np.testing.assert_allclose(np.abs(motion.pose.root.rot), np.tile([0, 0, 1, 0], (len(still.euler), 1)), atol=1e-6)
    np.testing.assert_allclose(motion.pose.root_ang, 0, atol=1e-3)
    np.testing.assert_allclose(motion.pose.joint_axes[:, 0], encode(yawed(still, 0.5)).pose.joint_axes[:, 0], atol=1e-6)


@pytest.mark.parametrize("frames", [4, 5, 59])
def test_length_does_not_change_a_frame(clip, frames):
    """Nothing comes from the padding, and nothing from the future (but the gaze, a median of the clip)."""
    long = clip._replace(euler=np.tile(clip.euler, (5, 1, 1)), positions=np.tile(clip.positions, (5, 1, 1)))
    short, all_of_it = encode(edit.trim(clip, 0, frames)).pose, encode(long).pose
    for a, b in zip(jax.tree.leaves(short), jax.tree.leaves(all_of_it), strict=True):
        np.testing.assert_allclose(a, b[:frames], atol=1e-5)


@pytest.mark.parametrize("frames", [1, 3])
def test_too_short_a_clip_is_refused(clip, frames):
    with pytest.raises(ValueError, match=f"A clip of {frames} frames is too short"):
        encode(edit.trim(clip, 0, frames))


def test_a_body_without_a_head_is_refused(clip):
    names = tuple("Top" if name == "Head" else name for name in clip.skeleton.names)
    headless = clip._replace(skeleton=Skeleton(names, clip.skeleton.parents, clip.skeleton.offsets))
    with pytest.raises(ValueError, match="No joint of this skeleton looks like the head"):
        encode(headless)


def test_hips_need_not_be_the_first_joint(clip):
    """A body under one more joint that stays at the origin has the same root and gaze."""
    body = clip.skeleton
    parents = (-1, *(parent + 1 for parent in body.parents))
    names = ("World", *body.names)
    under = Skeleton(names, parents, np.concatenate([np.zeros((1, 3)), body.offsets]))
    still = np.zeros((len(clip.euler), 1, 3))
    more = clip._replace(
        skeleton=under,
        orders=("zyx", *clip.orders),
        euler=np.concatenate([still, clip.euler], axis=1),
        positions=np.concatenate([still, clip.positions], axis=1),
    )
    a, b = encode(clip), encode(more)
    for x, y in zip(a.pose.root, b.pose.root, strict=True):
        np.testing.assert_allclose(x, y, atol=1e-5)
    np.testing.assert_allclose(a.gaze, b.gaze, atol=1e-4)


def test_decoding_moves_the_first_frame_to_the_origin(clip):
    pose = encode(clip).pose
    rebased = encode(decode(pose, clip.skeleton, clip.frame_time)).pose.root
    np.testing.assert_allclose(rebased.pos[0], [0, 0, 0], atol=1e-3)
    np.testing.assert_allclose(rebased.rot[0], [1, 0, 0, 0], atol=1e-5)


def test_offsets_come_from_where_they_are_asked(clip):
    pose = encode(clip).pose
    pose = pose._replace(joint_pos=pose.joint_pos.at[1:, 1].add(5.0).at[0, 1].add(2.0))
    own = clip.skeleton.offsets[1]
    for offsets, first, later in (("first_frame", 2.0, 2.0), ("skeleton", 0.0, 0.0), ("per_frame", 2.0, 5.0)):
        back = decode(pose, clip.skeleton, clip.frame_time, offsets=offsets)
        np.testing.assert_allclose(back.skeleton.offsets[1], own + first, atol=1e-5)
        np.testing.assert_allclose(back.positions[-1, 1], own + later, atol=1e-5)


def test_a_root_that_lost_length_is_decoded_as_a_rotation(clip):
    """`integrate` does not renormalise; Euler angles of a short quaternion would be wrong."""
    pose = encode(clip).pose
    short = pose._replace(root=pose.root._replace(rot=pose.root.rot * 0.95))
    a, b = (decode(p, clip.skeleton, clip.frame_time) for p in (pose, short))
    np.testing.assert_allclose(world_positions(a), world_positions(b), atol=1e-3)
