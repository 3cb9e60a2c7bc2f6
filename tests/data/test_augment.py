"""Mirrors and paces: images of images, encoded mirrors, velocities that lead from pose to pose."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data import augment
from zeggs_jax.data.rows import played_ranges, played_times
from zeggs_jax.data.statistics import moments
from zeggs_jax.data.windows import Piece, Times
from zeggs_jax.geometry import quaternion, rotation
from zeggs_jax.motion import edit, features
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.pose import Root, from_vector, integrate, to_vector
from zeggs_jax.motion.skeleton import Skeleton

NAMES = ("Hips", "Spine", "Spine2", "Head", "LeftArm", "LeftHand", "RightArm", "RightHand")
PARENTS = (-1, 0, 1, 2, 2, 4, 2, 6)
OFFSETS = np.array(
    [*([0, 90, 0], [0, 10, -2], [0, 20, 1], [0, 25, 2]), *([15, 12, 0], [28, -3, 1], [-15, 12, 0], [-28, -3, 1])], float
)
FRAME_TIME = 1 / 60
play = jax.jit(partial(augment.play, frame_time=FRAME_TIME))


def make_clip(offsets=OFFSETS, frames: int = 90) -> Clip:
    """Walking in a curve, past facing -Z, with moving joints."""
    random = np.random.default_rng(1)
    time = np.arange(frames)[:, None, None] * FRAME_TIME
    phase, speed = random.uniform(0, 6, (2, 1, len(NAMES), 3))
    euler = 0.5 * np.sin(speed * time + phase)
    euler[:, 0, 1] = np.linspace(1, 5, frames)  # zyx: turns about y
    positions = np.repeat(offsets[None], frames, axis=0)
    positions[:, 0, 0] = 80 * time[:, 0, 0]
    positions[:, 0, 2] = 50 * np.sin(3 * time[:, 0, 0])
    return Clip(Skeleton(NAMES, PARENTS, offsets), ("zyx",) * len(NAMES), euler, positions, FRAME_TIME)


def piece_of(clip: Clip) -> Piece:
    pose = features.encode(clip).pose
    speech = np.cumsum(np.random.default_rng(0).normal(size=(len(clip.euler), 5)), axis=0).astype(np.float32)
    return Piece(speech, *(np.asarray(x) for x in (to_vector(pose), *pose.root)))


def poses_of(piece: Piece):
    return from_vector(jnp.asarray(piece.pose), Root(jnp.asarray(piece.root_pos), jnp.asarray(piece.root_rot)))


def mirror_of(clip: Clip) -> augment.Mirror:
    return augment.mirror_of(clip.skeleton, clip.skeleton.mirror_map())


def played(clip: Clip, pace: float, first: int = 0) -> Piece:
    """A whole clip at a pace."""
    piece = piece_of(clip)
    ((_, frames),) = played_ranges(np.array([[0, len(piece.pose)]], np.int32), pace)
    count = int(frames) - first
    at = played_times(first, count, count, pace)
    return play(piece, Times(np.float32(pace), at.astype(np.int32), (at % 1).astype(np.float32)))


@pytest.fixture(scope="module")
def clip() -> Clip:
    return make_clip()


@pytest.fixture(scope="module")
def asymmetric() -> Clip:
    return make_clip(OFFSETS + np.random.default_rng(3).normal(size=OFFSETS.shape))


def test_the_image_of_the_image_is_the_piece(clip, asymmetric):
    for body in (clip, asymmetric):
        piece, by = piece_of(body), mirror_of(body)
        image = augment.mirror(piece, by)
        assert not np.allclose(image.pose, piece.pose, atol=0.1)
        twice = augment.mirror(image, by)
        for ours, expected in zip(twice, piece, strict=True):
            np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-5 if body is asymmetric else 0)


def test_the_mirrored_features_are_the_features_of_the_mirrored_clip(clip):
    ours, expected = augment.mirror(piece_of(clip), mirror_of(clip)), piece_of(edit.mirror(clip))
    for x, y in zip(ours, expected, strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-4, atol=2e-4)


def test_the_mirror_keeps_the_body(asymmetric):
    """Offsets stay on their sides; turns and velocities of joints are those of the mirrored clip."""
    ours = poses_of(augment.mirror(piece_of(asymmetric), mirror_of(asymmetric)))
    expected = features.encode(edit.mirror(asymmetric, keep_offsets=True)).pose
    np.testing.assert_allclose(ours.joint_pos[:, 1:], np.tile(asymmetric.skeleton.offsets[1:], (90, 1, 1)), atol=1e-4)
    np.testing.assert_allclose(ours.joint_axes, expected.joint_axes, atol=1e-4)
    np.testing.assert_allclose(ours.joint_ang, expected.joint_ang, atol=2e-3)


@pytest.mark.parametrize("pace", [0.9, 1.0, 1.07, 1.5])
def test_velocities_lead_from_pose_to_pose(clip, pace):
    pose = poses_of(played(clip, pace))
    steps = np.diff(pose.joint_pos, axis=0) / FRAME_TIME
    np.testing.assert_allclose(pose.joint_vel[1:], steps, atol=2e-3)
    turns = quaternion.unroll(rotation.axes_to_quaternion(pose.joint_axes))
    step = quaternion.positive(quaternion.multiply(turns[1:], quaternion.inverse(turns[:-1])))
    np.testing.assert_allclose(pose.joint_ang[1:], quaternion.to_scaled_axis(step) / FRAME_TIME, atol=2e-2)


@pytest.mark.parametrize("pace", [0.9, 1.0, 1.07])
def test_the_root_is_led_by_its_velocities(clip, pace):
    """Integrated from the first frame alone it stays on the played path, also past facing -Z."""
    pose = poses_of(played(clip, pace))
    root = jax.tree.map(lambda x: x[0], pose.root)
    for t in range(1, len(pose.root_vel)):
        root = integrate(root, pose.root_vel[t], pose.root_ang[t], FRAME_TIME)
        np.testing.assert_allclose(root.pos, pose.root.pos[t], atol=5e-3)
        assert abs(np.dot(root.rot, pose.root.rot[t])) > 1 - 1e-5


@pytest.mark.parametrize("pace", [0.9, 1.07])
def test_a_played_clip_is_the_clip_at_other_times(clip, pace):
    height = features.encode(clip).pose.joint_pos[:, 0, 1]
    ours = poses_of(played(clip, pace)).joint_pos[:, 0, 1]
    np.testing.assert_allclose(ours, np.interp(np.arange(len(ours)) * pace, np.arange(90), height), atol=1e-3)


def test_at_half_the_pace_every_other_frame_is_the_clips(clip):
    half, whole = poses_of(played(clip, 0.5)), features.encode(clip).pose
    np.testing.assert_allclose(half.root.pos[::2], whole.root.pos, atol=1e-5)
    np.testing.assert_allclose(half.joint_axes[::2], whole.joint_axes, atol=1e-5)
    np.testing.assert_allclose(half.joint_vel[2::2], whole.joint_vel[1:] / 2, atol=1e-3)


def test_played_as_it_is_a_clip_stays(clip):
    ours, expected = played(clip, 1.0), piece_of(clip)
    for x, y in zip(ours, expected, strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-4, atol=2e-3)


def test_speech_keeps_in_step(clip):
    ours, expected = played(clip, 1.07).speech, piece_of(clip).speech
    at = np.arange(len(ours)) * 1.07
    for column in range(5):
        np.testing.assert_allclose(ours[:, column], np.interp(at, np.arange(90), expected[:, column]), atol=1e-4)


@pytest.mark.parametrize("pace", [0.9, 0.97, 1.0, 1.1])
@pytest.mark.parametrize("frames", [4, 29, 256])
def test_played_frames_lie_in_the_clip(pace, frames):
    ((start, stop),) = played_ranges(np.array([[7, 7 + frames]], np.int32), pace)
    assert start == 7
    assert (stop - start - 1) * pace <= frames - 1 + 1e-6 < (stop - start) * pace + 1e-3


def test_from_a_later_frame_on_the_clip_plays_the_same(clip):
    whole, later = played(clip, 1.07), played(clip, 1.07, first=20)
    for x, y in zip(whole, later, strict=True):
        np.testing.assert_allclose(y, x[20:], rtol=1e-4, atol=5e-3)


def test_statistics_with_the_images(clip):
    """From the moments alone; and what moves on one side only is seen to move on both."""
    piece, by = piece_of(clip), mirror_of(clip)
    pose = np.array(piece.pose)
    piece, turns = piece._replace(pose=pose), pose.shape[1] - 3 * len(NAMES)
    left, right = (slice(turns + 3 * joint, turns + 3 * joint + 3) for joint in (5, 7))  # how the hands turn
    pose[:, right] = 0.0
    ours = augment.with_images(moments(piece.pose), by)
    expected = moments(np.concatenate([piece.pose, augment.mirror(piece, by).pose]))
    for x, y in zip(ours, expected, strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(ours.squares[right], ours.squares[left], rtol=1e-6)
    assert (ours.squares[right] > 1).all()
