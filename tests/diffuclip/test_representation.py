"""Frames of motion: round trip, heading, no drift over ten minutes, positions, what the scale weighs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data.scale import apply
from zeggs_jax.diffuclip import representation
from zeggs_jax.motion import edit, features


def angles(a, b):
    """Degrees between local rotations given as two axes."""
    whole = [np.concatenate([x, np.cross(x[..., :1, :], x[..., 1:, :])], axis=-2) for x in (a, b)]
    trace = (whole[0] * whole[1]).sum(axis=(-1, -2))
    return np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1)))


def turned(clip, angle):
    """The clip in a world turned about the vertical and moved."""
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    still = np.tile(np.eye(3), (len(clip.skeleton), 1, 1))
    moved = edit.reframe(clip, turn, still)
    positions = moved.positions.copy()
    positions[:, 0] += [50.0, 0.0, -20.0]
    return moved._replace(positions=positions)


def test_a_clip_comes_back(clip):
    motion = representation.encode(clip)
    assert motion.shape == (len(clip.euler), 3 + 6 * len(clip.skeleton))
    assert motion.dtype == np.float32
    again, centred = representation.decode(motion, clip.skeleton, clip.frame_time), edit.centre(clip)
    true, made = features.world_positions(centred), features.world_positions(again)
    assert np.abs(true - made).max() < 0.05
    assert angles(features.local_axes(centred), features.local_axes(again)).max() < 0.1
    assert again.frame_time == clip.frame_time


def test_bones_are_where_the_files_positions_say(clip):
    """A file that places its joints elsewhere than its OFFSETs comes back as it stood."""
    longer = clip._replace(positions=clip.positions * np.where(np.arange(len(clip.skeleton)) > 0, 1.2, 1.0)[:, None])
    again = representation.decode(representation.encode(longer), representation.bones(longer), clip.frame_time)
    apart = features.world_positions(again) - features.world_positions(edit.centre(longer))
    assert np.abs(apart).max() < 0.05
    np.testing.assert_array_equal(representation.bones(clip).offsets, clip.skeleton.offsets)


def test_where_the_clip_stands_and_faces_does_not_matter(clip):
    np.testing.assert_allclose(representation.encode(turned(clip, 2.0)), representation.encode(clip), rtol=0, atol=2e-5)


def test_the_way_is_told_in_the_bodys_own_directions(clip):
    """A body that walks along its heading goes ahead by its speed, whatever the heading."""
    ahead = 2.0
    for angle in (0.0, 1.0, 3.0):
        euler, positions = np.zeros_like(clip.euler), clip.positions.copy()
        euler[:, 0, 1] = angle
        positions[:, 0] = [0, 90, 0] + ahead * np.arange(len(euler))[:, None] * [np.sin(angle), 0, np.cos(angle)]
        motion = representation.encode(clip._replace(euler=euler, positions=positions))
        np.testing.assert_allclose(motion[:, :3], np.tile([0, ahead, 90], (len(euler), 1)), atol=1e-5)


def test_the_height_is_not_summed(clip):
    motion = representation.encode(clip)
    np.testing.assert_allclose(motion[:, 2], clip.positions[:, 0, 1], rtol=1e-6)


def test_no_drift_over_ten_minutes(clip, body):
    """Rounds in a circle of 2 m for 10 minutes: the last place is the true one within half a millimetre."""
    frames = 10 * 60 * 30
    angle = 0.5 * np.arange(frames) / 30
    euler = np.zeros((frames, len(body), 3))
    euler[:, 0, 1] = angle
    positions = np.broadcast_to(np.asarray(body.offsets, float), (frames, len(body), 3)).copy()
    positions[:, 0] = np.stack([200 * (1 - np.cos(angle)), 90 + np.sin(angle), 200 * np.sin(angle)], axis=-1)
    long = clip._replace(euler=euler, positions=positions, orders=("zyx",) * len(body))
    again = representation.decode(representation.encode(long), body, long.frame_time)
    apart = np.linalg.norm(again.positions[:, 0] - edit.centre(long).positions[:, 0], axis=-1)
    assert apart.max() < 0.05


def test_positions_are_those_of_the_decoded_clip(clip, body):
    """Also of axes that are no rotations, as a network makes them."""
    noise = np.random.default_rng(0).normal(size=(len(clip.euler), 3 + 6 * len(body))).astype(np.float32)
    motion = representation.encode(clip) + 0.1 * noise
    made = representation.positions(motion, np.asarray(body.offsets, np.float32), body.parents)
    true = features.world_positions(representation.decode(motion, body, clip.frame_time))
    np.testing.assert_allclose(made, true, atol=5e-3)


def test_positions_have_a_finite_gradient_where_the_body_lies(clip, body):
    motion = jnp.asarray(representation.encode(clip))
    lying = motion.at[0, 3:9].set(jnp.array([1.0, 0, 0, 0, 0, 1.0]))  # its z axis points down: no heading
    slope = jax.grad(lambda x: representation.positions(x, jnp.asarray(body.offsets, jnp.float32), body.parents).sum())
    assert np.isfinite(slope(lying)).all()


def test_a_frame_of_another_body_is_refused(clip, body):
    with pytest.raises(ValueError, match="of 15 numbers is not of a body of 13 joints, which has 81"):
        representation.decode(np.zeros((4, 15)), body, clip.frame_time)


def test_the_scale_weighs_an_error_by_how_far_it_moves_the_body(clip, body):
    motion = representation.encode(clip)
    motion[:, 3 + 6 * body.index("Head") :][:, :6] = [1, 0, 0, 0, 1, 0]  # a joint that never turns
    fitted = representation.scale([motion[:50], motion[50:]], body)
    scaled = apply(fitted, motion)
    np.testing.assert_allclose(np.square(scaled).mean(), 1.0, rtol=1e-4)
    np.testing.assert_allclose(scaled.mean(axis=0), 0.0, atol=1e-4)

    def error(joint, degrees):
        """Square of the scaled change by a turn of one joint."""
        other = clip.euler.copy()
        other[:, body.index(joint), 0] += np.radians(degrees)
        changed = representation.encode(clip._replace(euler=other)) - representation.encode(clip)
        return np.square(changed / fitted.std).sum()

    assert error("LeftHandIndex1", 10) < 0.1 * error("LeftArm", 10)
    noise = 1e-4 * np.random.default_rng(0).normal(size=motion.shape)
    assert np.abs(noise / fitted.std).max() < 0.05  # also in the columns that never change
