"""Kinematics: equal to the plain joint-by-joint recursion, consistent with finite differences, compilable."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.geometry import quaternion, rotation
from zeggs_jax.motion import features
from zeggs_jax.motion.kinematics import World, chain, forward, forward_positions
from zeggs_jax.motion.pose import Root, from_vector, size
from zeggs_jax.motion.skeleton import REFERENCE_PARENTS

PARENTS = (-1, 0, 1, 1, 3, 0, 5, 2)


def random_pose(joints, seed=0):
    rng = np.random.default_rng(seed)
    rot = rng.normal(size=4)
    root = Root(*(jnp.asarray(x, jnp.float32) for x in (rng.normal(size=3) * 20, rot / np.linalg.norm(rot))))
    return from_vector(jnp.asarray(rng.normal(size=size(joints)), jnp.float32), root)


def plain(pose, parents, vel_frame):
    """The recursion of the release, one joint at a time, in numpy float64."""
    turn, frame = (np.asarray(quaternion.to_matrix(q), np.float64) for q in (pose.root.rot, vel_frame))
    mats = np.asarray(rotation.axes_to_matrix(pose.joint_axes), np.float64)
    local_pos, local_vel, local_ang = (
        np.asarray(x, np.float64) for x in (pose.joint_pos, pose.joint_vel, pose.joint_ang)
    )
    above = (np.asarray(pose.root.pos, np.float64), turn, frame @ pose.root_vel, frame @ pose.root_ang)
    done = []
    for joint, parent in enumerate(parents):
        pos, mat, vel, ang = above if parent < 0 else done[parent]
        arm = mat @ local_pos[joint]
        done.append(
            (
                pos + arm,
                mat @ mats[joint],
                vel + mat @ local_vel[joint] + np.cross(ang, arm),
                ang + mat @ local_ang[joint],
            )
        )
    return World(*(np.stack(x) for x in zip(*done, strict=True)))


@pytest.mark.parametrize("parents", [PARENTS, REFERENCE_PARENTS, (-1,)])
@pytest.mark.parametrize("with_frame", [True, False])
def test_equal_to_one_joint_at_a_time(parents, with_frame):
    pose, other = random_pose(len(parents)), random_pose(len(parents), 1).root.rot
    ours = forward(pose, parents, other if with_frame else None)
    expected = plain(pose, parents, other if with_frame else pose.root.rot)
    for a, b in zip(ours, expected, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5 * np.abs(b).max())


def test_moving_the_root_moves_the_world_rigidly():
    pose, turn = random_pose(8), random_pose(8, 5).root.rot
    shift = jnp.array([3.0, -2.0, 7.0])
    moved_root = Root(quaternion.rotate(turn, pose.root.pos) + shift, quaternion.multiply(turn, pose.root.rot))
    a, b = forward(pose, PARENTS), forward(pose._replace(root=moved_root), PARENTS)
    m = np.asarray(quaternion.to_matrix(turn))
    np.testing.assert_allclose(b.pos, np.asarray(a.pos) @ m.T + np.asarray(shift), atol=1e-4)
    np.testing.assert_allclose(b.mat, m @ np.asarray(a.mat), atol=1e-5)
    np.testing.assert_allclose(b.vel, a.vel @ m.T, atol=1e-4)


def test_velocities_are_derivatives_of_positions(clip):
    """World velocities from the features agree with differences of world positions, to the frame time."""
    motion = features.encode(clip)
    rot = motion.pose.root.rot
    previous = jnp.concatenate([rot[:1], rot[:-1]])
    world = jax.vmap(lambda pose, frame: forward(pose, clip.skeleton.parents, frame))(motion.pose, previous)
    differences = np.diff(features.world_positions(clip), axis=0) / clip.frame_time
    between = np.asarray(world.vel)[1:]
    # one-sided differences and rotations of the later frame: an error of first order in the frame time
    assert np.abs(between - differences).max() < 0.1 * np.abs(differences).max()
    assert np.corrcoef(between.ravel(), differences.ravel())[0, 1] > 0.995


def test_positions_alone_agree():
    rng = np.random.default_rng(0)
    pos, rot = rng.normal(size=(8, 3)).astype(np.float32), rng.normal(size=(8, 4)).astype(np.float32)
    rot /= np.linalg.norm(rot, axis=-1, keepdims=True)
    world = chain(World(jnp.asarray(pos), quaternion.to_matrix(rot), jnp.zeros((8, 3)), jnp.zeros((8, 3))), PARENTS)
    np.testing.assert_allclose(forward_positions(pos, rot, PARENTS), world.pos, atol=1e-6)


def test_gradient_under_two_vmaps_compiles():
    """A form with scatters and 3x3 `@` aborted the CPU compiler of jaxlib 0.10.2 here."""
    poses = jax.tree.map(lambda x: jnp.broadcast_to(x, (2, 3, *x.shape)), random_pose(75))

    @jax.jit
    @jax.grad
    def slope(poses):
        world = jax.vmap(jax.vmap(lambda pose: forward(pose, REFERENCE_PARENTS)))(poses)
        return sum(jnp.mean(jnp.abs(x)) for x in world)

    assert all(np.isfinite(x).all() for x in jax.tree.leaves(slope(poses)))
