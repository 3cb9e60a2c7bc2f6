"""Eq. 2 against float64 arithmetic written joint by joint, its weights, its symmetries, its gradients at bad places."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.motion.pose import Pose, Root
from zeggs_jax.zeroeggs import losses
from zeggs_jax.zeroeggs.losses import WEIGHTS, Terms
from zeggs_jax.zeroeggs.style_encoder import StyleDistribution

PARENTS = (-1, 0, 1, 1)
FRAME_TIME = 0.016667
T, J = 6, len(PARENTS)


def make_pose(seed: int) -> Pose:
    random = np.random.default_rng(seed)
    yaw = random.uniform(-3, 3, T)
    rot = np.stack([np.cos(yaw / 2), 0 * yaw, np.sin(yaw / 2), 0 * yaw], axis=-1)
    shapes = ((T, 3), (T, 3), (T, J, 3), (T, J, 2, 3), (T, J, 3), (T, J, 3))
    fields = [random.normal(size=shape) for shape in shapes]
    root = Root(10 * random.normal(size=(T, 3)), rot)
    return jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), Pose(root, *fields))


GAZE = jnp.array([30.0, 0.0, 80.0])
loss = jax.jit(partial(losses.reconstruction, parents=PARENTS, frame_time=FRAME_TIME))


def matrix(q):
    """Rotation matrix of a quaternion, by turning the three axes."""
    w, u = q[0], q[1:]
    return np.stack([v + 2 * w * np.cross(u, v) + 2 * np.cross(u, np.cross(u, v)) for v in np.eye(3)], axis=-1)


def orthogonal(axes):
    x, z = axes[0], np.cross(axes[0], axes[1])
    return np.stack([a / np.linalg.norm(a) for a in (x, np.cross(z, x), z)], axis=-1)


def compared(pose: Pose) -> dict[str, np.ndarray]:
    """What the terms compare, frame by frame and joint by joint, from the text of the specification."""
    pose = jax.tree.map(lambda x: np.asarray(x, np.float64), pose)
    kept: dict[str, list] = {name: [] for name in Terms._fields if not name.endswith("step")}
    for t in range(T):
        turn, before = matrix(pose.root.rot[t]), matrix(pose.root.rot[max(t - 1, 0)])
        root_vel, root_ang = before @ pose.root_vel[t], before @ pose.root_ang[t]
        pos, vel, ang = (x[t].copy() for x in (pose.joint_pos, pose.joint_vel, pose.joint_ang))
        mat = np.stack([orthogonal(axes) for axes in pose.joint_axes[t]])
        arm = turn @ pos[0]
        pos[0], mat[0] = pose.root.pos[t] + arm, turn @ mat[0]
        vel[0], ang[0] = root_vel + turn @ vel[0] + np.cross(root_ang, arm), root_ang + turn @ ang[0]
        w_pos, w_mat, w_vel, w_ang = pos.copy(), mat.copy(), vel.copy(), ang.copy()
        for j in range(1, J):
            p = PARENTS[j]
            arm = w_mat[p] @ pos[j]
            w_pos[j], w_mat[j] = w_pos[p] + arm, w_mat[p] @ mat[j]
            w_vel[j] = w_vel[p] + w_mat[p] @ vel[j] + np.cross(w_ang[p], arm)
            w_ang[j] = w_ang[p] + w_mat[p] @ ang[j]
        ahead = np.asarray(GAZE, np.float64) - pose.root.pos[t]
        values = (pose.root.pos[t], turn, root_vel, root_ang, pos, pose.joint_axes[t], vel, ang)
        world = (w_pos, w_mat, w_vel, w_ang, turn.T @ (ahead / np.linalg.norm(ahead)))
        for name, value in zip(kept, (*values, *world), strict=True):
            kept[name].append(value)
    stacked = {name: np.stack(values) for name, values in kept.items()}
    for name in ("joint_pos", "joint_axes", "world_pos", "world_rot"):
        stacked[f"{name}_step"] = np.diff(stacked[name], axis=0) / FRAME_TIME
    return stacked


def test_every_term_is_the_specifications():
    ours = loss(make_pose(0), make_pose(1), GAZE)._asdict()
    a, b = compared(make_pose(0)), compared(make_pose(1))
    for name, weight in WEIGHTS._asdict().items():
        expected = np.mean(np.abs(weight * (a[name] - b[name])))
        assert float(ours[name]) == pytest.approx(expected, rel=2e-6), name


def test_the_weights_are_the_releases():
    release = [0.1, 10, 0.1, 5, 15, 15, 10, 7, 0.1, 3, 0.06, 1.25, 7, 8, 0.06, 1.25, 10]
    assert list(WEIGHTS) == release


def test_no_error_no_loss_and_no_gradient_trouble():
    pose = make_pose(0)
    assert all(float(term) < 1e-4 for term in loss(pose, pose, GAZE))  # XLA may round the two sides differently
    gradient = jax.grad(lambda p: losses.total(loss(p, pose, GAZE), 0.0))(pose)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))


def test_gradients_are_finite_where_axes_vanish_and_the_target_is_the_root():
    still = jax.tree.map(jnp.zeros_like, make_pose(0))
    still = still._replace(root=still.root._replace(rot=make_pose(0).root.rot))
    gradient = jax.grad(lambda p: losses.total(loss(p, make_pose(1), jnp.zeros(3)), 0.0))(still)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))


def test_a_shifted_scene_has_the_same_loss():
    """Moving both bodies and the target changes nothing."""
    shift = jnp.array([5.0, 0.0, -7.0])

    def moved(pose):
        return pose._replace(root=pose.root._replace(pos=pose.root.pos + shift[None]))

    here = loss(make_pose(0), make_pose(1), GAZE)
    there = loss(moved(make_pose(0)), moved(make_pose(1)), GAZE + shift)
    np.testing.assert_allclose(here, there, rtol=1e-4)


def test_an_error_in_one_place_shows_in_its_terms():
    pose = make_pose(0)
    wrong = pose._replace(joint_vel=pose.joint_vel.at[:, 2].add(1.0))
    shown = {name for name, term in loss(wrong, pose, GAZE)._asdict().items() if float(term) > 1e-3}
    assert shown == {"joint_vel", "world_vel"}
    wrong = pose._replace(root=pose.root._replace(pos=pose.root.pos + 1.0))
    shown = {name for name, term in loss(wrong, pose, GAZE)._asdict().items() if float(term) > 1e-3}
    assert shown == {"root_pos", "joint_pos", "world_pos", "gaze"}


def test_a_gaze_target_may_move():
    ours = loss(make_pose(0), make_pose(1), GAZE)
    same = loss(make_pose(0), make_pose(1), jnp.tile(GAZE, (T, 1)))
    np.testing.assert_array_equal(ours, same)


def test_batches_compile_under_grad():
    """grad of vmap of the tree's products once aborted jaxlib's CPU compiler."""
    batch = jax.tree.map(lambda *x: jnp.stack(x), *(make_pose(seed) for seed in range(2)))
    clips = jax.vmap(losses.reconstruction, in_axes=(0, 0, None, None, None))

    def total(predicted):
        return losses.total(jax.tree.map(jnp.mean, clips(predicted, batch, GAZE, PARENTS, FRAME_TIME)), 0.0)

    other = jax.tree.map(lambda x: x[::-1], batch)
    alone = [
        losses.total(loss(*pair, GAZE), 0.0) for pair in ((make_pose(1), make_pose(0)), (make_pose(0), make_pose(1)))
    ]
    value, gradient = jax.jit(jax.value_and_grad(total))(other)
    assert float(value) == pytest.approx(float(sum(alone)) / 2, rel=1e-5)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))


def test_divergence():
    """Zero for N(0, 1), the mean over dimensions of the closed form, zero without a variational part."""
    assert float(losses.kl(StyleDistribution(jnp.zeros(4), jnp.zeros(4)))) == 0.0
    mean, std = np.array([1.0, -2.0]), np.array([0.5, 3.0])
    expected = np.mean(np.log(1 / std) + (std**2 + mean**2) / 2 - 0.5)
    ours = losses.kl(StyleDistribution(jnp.asarray(mean, jnp.float32), jnp.asarray(2 * np.log(std), jnp.float32)))
    assert float(ours) == pytest.approx(expected, rel=1e-6)
    assert float(losses.kl(StyleDistribution(jnp.ones(4), None))) == 0.0


@pytest.mark.parametrize(
    ("step", "weight"), [(0, 5.2e-17), (6000, 5.5e-4), (7000, 0.0759), (7222, 0.1994), (7223, 0.2)]
)
def test_the_divergence_comes_in_slowly(step, weight):
    assert float(jax.jit(losses.kl_weight)(step)) == pytest.approx(weight, rel=0.01)
    assert float(losses.kl_weight(160_000)) == pytest.approx(0.2)


def test_the_total_counts_eighteen_terms():
    assert float(losses.total(Terms(*[1.0] * 17), 1.0)) == pytest.approx(1.0)
    assert float(losses.total(Terms(*[18.0] * 17), 0.0)) == pytest.approx(17.0)
