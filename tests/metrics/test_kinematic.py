"""Kinematics: derivatives of known paths, their distributions, and the right response to planted damage."""

import numpy as np
import pytest

from zeggs_jax.metrics import kinematic
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.motion import edit
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.synthetic import corpus

RATE = 30.0
POINT = Skeleton(("Hips",), (-1,), np.zeros((1, 3)))


@pytest.fixture(scope="module")
def clip():
    return corpus.style_clip("happy", 4.0, 30, 3)


def test_jerk_of_a_cubic_is_its_third_derivative(monkeypatch, clip):
    time = np.arange(60) / RATE
    path = np.zeros((60, 1, 3))
    path[:, 0, 0] = 2.0 * time**3
    monkeypatch.setattr(kinematic, "world_positions", lambda clip: path)
    assert kinematic.mean_jerk(clip) == pytest.approx(12.0, rel=1e-6)


def test_jitter_raises_jerk_and_a_frozen_clip_has_none(clip):
    jerk = kinematic.mean_jerk(clip)
    jitter = np.random.default_rng(3).normal(scale=0.02, size=clip.euler.shape)
    assert kinematic.mean_jerk(clip._replace(euler=clip.euler + jitter)) > 2.0 * jerk
    frozen = clip._replace(euler=np.repeat(clip.euler[:1], 120, 0), positions=np.repeat(clip.positions[:1], 120, 0))
    assert kinematic.mean_jerk(frozen) == pytest.approx(0.0, abs=1e-3)
    assert kinematic.hand_speed(frozen).max() == pytest.approx(0.0, abs=1e-6)


def test_drift_is_how_far_the_hips_went(clip):
    walked = clip.positions.copy()
    walked[:, 0, 0] += np.linspace(0.0, 300.0, len(walked))
    assert kinematic.root_drift(clip._replace(positions=walked)) == pytest.approx(300.0, abs=15.0)
    assert kinematic.root_drift(clip) < 20.0


def test_hand_speed_does_not_count_where_the_body_goes(clip):
    walked = clip.positions.copy()
    walked[:, 0, 0] += np.linspace(0.0, 300.0, len(walked))
    np.testing.assert_allclose(
        kinematic.hand_speed(clip._replace(positions=walked)), kinematic.hand_speed(clip), atol=1e-6
    )


def test_hand_speed_does_not_depend_on_the_frame_rate(clip):
    fast = edit.resample(clip, 60.0)
    assert kinematic.hand_speed(fast).mean() == pytest.approx(kinematic.hand_speed(clip).mean(), rel=0.1)


def test_statistics_do_not_depend_on_where_the_body_stands(clip):
    moved = clip.positions.copy()
    moved[:, 0] += [100.0, 0.0, -50.0]
    np.testing.assert_allclose(
        kinematic.style_statistics(clip._replace(positions=moved)), kinematic.style_statistics(clip), atol=1e-4
    )


@pytest.mark.parametrize("rate_hz", [25.0, 30.0, 120.0])
def test_derivatives_of_a_cubic_path_are_known_at_any_rate(rate_hz):
    """x = 2 t^3 over 2 s: jerk 12, acceleration on average 12, speed on average 8."""
    time = np.arange(round(2.0 * rate_hz) + 1) / rate_hz
    path = np.zeros((len(time), 1, 3))
    path[:, 0, 2] = 2.0 * time**3
    found = kinematic.dynamics(Movement(path, rate_hz, POINT))
    assert found.jerk.mean == pytest.approx(12.0)
    assert found.jerk.std == pytest.approx(0.0, abs=1e-4)
    assert found.acceleration.mean == pytest.approx(12.0, rel=1e-6)
    assert found.speed.mean == pytest.approx(8.0, rel=1e-6)
    assert found.acceleration.median == pytest.approx(12.0, rel=1e-2)
    assert found.speed.p95 == pytest.approx(6.0 * 1.9**2, rel=0.03)


def test_units_scale_all_and_joints_can_be_chosen(gesture):
    motion = gesture()
    found = kinematic.dynamics(motion)
    big = kinematic.dynamics(motion._replace(positions=10.0 * motion.positions))
    np.testing.assert_allclose(np.array(big), 10.0 * np.array(found))
    hand = motion.skeleton.role("right_hand")
    assert kinematic.dynamics(motion, [hand]).speed.mean > 3.0 * found.speed.mean


def test_smooth_motion_has_the_same_dynamics_at_any_rate(gesture):
    moving = [gesture().skeleton.role("left_hand"), gesture().skeleton.role("right_hand")]
    slow, fast = (kinematic.dynamics(gesture(rate_hz=r, seconds=20.0), moving) for r in (60.0, 120.0))
    np.testing.assert_allclose(np.array(fast), np.array(slow), rtol=0.02)


def test_damage_shows_in_dynamics(gesture, damage):
    motion = gesture()
    truth = kinematic.dynamics(motion)
    jerks = [kinematic.dynamics(damage["trembling"](motion, s)).jerk.mean for s in (0.0, 0.05, 0.1, 0.4)]
    assert jerks == sorted(jerks)
    assert jerks[1] > 3.0 * jerks[0]
    for name in ("frozen", "mean_pose"):
        assert kinematic.dynamics(damage[name](motion)).speed.p95 == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(np.array(kinematic.dynamics(damage["mirrored"](motion))), np.array(truth), rtol=1e-9)


def test_hellinger_of_known_histograms():
    assert kinematic.hellinger(np.array([1.0, 3.0]), np.array([10.0, 30.0])) == pytest.approx(0.0, abs=1e-8)
    assert kinematic.hellinger(np.array([1.0, 0.0]), np.array([0.0, 5.0])) == 1.0
    found = kinematic.hellinger(np.array([1.0, 1.0]), np.array([1.0, 0.0]))
    assert found == pytest.approx(np.sqrt(1.0 - np.sqrt(0.5)))


def test_hellinger_sees_damage_the_more_the_larger_and_neither_units_nor_repetition(gesture, damage):
    truth = [gesture(seed) for seed in range(4)]
    sizes = (0.0, 0.1, 0.3, 1.0)
    found = [kinematic.hellinger_of([damage["trembling"](m, s) for m in truth], truth) for s in sizes]
    assert found[0] == 0.0
    assert found == sorted(found)
    other = kinematic.hellinger_of([gesture(seed) for seed in range(9, 13)], truth)
    assert other < 0.25
    assert kinematic.hellinger_of([damage["frozen"](m) for m in truth], truth) > 2.0 * other
    tenfold = [
        [m._replace(positions=10.0 * m.positions) for m in group]
        for group in ([damage["trembling"](m, 0.3) for m in truth], truth)
    ]
    assert kinematic.hellinger_of(*tenfold) == pytest.approx(found[2], abs=1e-3)
    assert kinematic.hellinger_of([*truth, *truth], truth) == pytest.approx(0.0, abs=1e-7)


def test_fine_bins_put_two_samples_of_one_motion_apart(gesture):
    """The trap of bins of 0.05 cm/s: they measure the number of frames."""
    first, second = [gesture(0, seconds=4.0)], [gesture(9, seconds=4.0)]
    coarse = kinematic.hellinger_of(first, second, edges=np.arange(0.0, 50.0))
    fine = kinematic.hellinger_of(first, second, edges=np.arange(0.0, 49.05, 0.05))
    assert fine > 1.2 * coarse


def test_what_is_faster_than_the_last_edge_is_not_lost(gesture):
    """The trap of a histogram that ends at 49 cm/s: what is faster would not be there at all."""
    motion = gesture(size=200.0)
    edges = np.arange(0.0, 50.0)
    faster = motion._replace(
        positions=motion.positions.mean(axis=0) + 3.0 * (motion.positions - motion.positions.mean(axis=0))
    )
    assert kinematic.hellinger_of([faster], [motion], edges=edges) > 0.02


def test_what_has_no_distribution_is_refused(gesture, damage):
    with pytest.raises(ValueError, match="3 frames"):
        kinematic.dynamics(gesture(seconds=0.1))
    with pytest.raises(ValueError, match="stands still"):
        kinematic.hellinger_of([gesture()], [damage["frozen"](gesture())])
    with pytest.raises(ValueError, match="0 made and 1 true"):
        kinematic.hellinger_of([], [gesture()])
    with pytest.raises(ValueError, match="made motion 1 runs at 60 Hz and true motion 1 at 30 Hz"):
        kinematic.hellinger_of([gesture(rate_hz=60.0)], [gesture()])
    with pytest.raises(ValueError, match="neither empty"):
        kinematic.hellinger(np.zeros(3), np.ones(3))
