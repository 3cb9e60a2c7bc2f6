"""APE, AVE and PCK: known answers, what they see and what they do not."""

import numpy as np
import pytest

from zeggs_jax.metrics import accuracy


def test_the_truth_is_without_error(gesture):
    motion = gesture()
    assert accuracy.ape(motion, motion) == 0.0
    assert accuracy.ave(motion, motion) == 0.0
    assert accuracy.pck(motion, motion) == 1.0


def test_a_known_offset_is_the_error(gesture):
    motion = gesture()
    aside = motion._replace(positions=motion.positions + np.array([3.0, 4.0, 0.0]))
    assert accuracy.ape(aside, motion, centred=False) == pytest.approx(5.0)
    assert accuracy.ape(aside, motion) == pytest.approx(0.0, abs=1e-12)
    assert accuracy.pck(aside, motion, within=4.9, centred=False) == 0.0
    assert accuracy.pck(aside, motion, within=5.1, centred=False) == 1.0
    assert accuracy.ave(aside, motion, centred=False) == pytest.approx(0.0, abs=1e-9)


def test_one_joint_in_error_counts_as_one_of_those_that_can_be_wrong(gesture):
    motion = gesture()
    moved = motion.positions.copy()
    moved[:, motion.skeleton.role("head")] += np.array([0.0, 30.0, 0.0])
    off = motion._replace(positions=moved)
    assert accuracy.ape(off, motion) == pytest.approx(30.0 / 15)  # 16 joints, the hips measure themselves
    assert accuracy.ape(off, motion, centred=False) == pytest.approx(30.0 / 16)
    assert accuracy.pck(off, motion) == pytest.approx(14 / 15)


def test_twice_the_size_is_three_times_the_variance(gesture):
    motion = gesture()
    mean = motion.positions.mean(axis=0)
    double = motion._replace(positions=mean + 2.0 * (motion.positions - mean))
    variance = motion.positions.var(axis=0, ddof=1)
    assert accuracy.ave(double, motion, centred=False) == pytest.approx(3.0 * np.linalg.norm(variance, axis=-1).mean())


def test_units_scale_lengths_and_not_shares(gesture, damage):
    truth, made = gesture(0), damage["trembling"](gesture(1), 2.0)
    big = [m._replace(positions=10.0 * m.positions) for m in (made, truth)]
    assert accuracy.ape(*big) == pytest.approx(10.0 * accuracy.ape(made, truth))
    assert accuracy.ave(*big) == pytest.approx(100.0 * accuracy.ave(made, truth))
    assert accuracy.pck(*big, within=100.0) == accuracy.pck(made, truth)


def test_what_does_not_fit_is_refused(gesture):
    with pytest.raises(ValueError, match="cut them to one length"):
        accuracy.ape(gesture(seconds=2.0), gesture(seconds=3.0))
    with pytest.raises(ValueError, match="Hz"):
        accuracy.pck(gesture(rate_hz=60.0), gesture())


def test_damage_raises_the_errors_the_more_the_larger(gesture, damage):
    truth = gesture()
    shaken = [damage["trembling"](truth, size) for size in (0.5, 2.0, 8.0)]
    for found in ([accuracy.ape(made, truth) for made in shaken], [-accuracy.pck(made, truth, 2.0) for made in shaken]):
        assert found == sorted(found)
        assert found[0] < found[-1]
    for name in ("mirrored", "frozen", "mean_pose"):
        assert accuracy.ape(damage[name](truth), truth) > 0.3, name
        assert accuracy.ave(damage[name](truth), truth) > 0.3, name
    shifts = [accuracy.ape(damage["late"](truth, seconds), truth) for seconds in (0.0, 0.05, 0.2)]
    assert shifts == sorted(shifts)
    assert accuracy.ave(damage["late"](truth, 0.2), truth) == pytest.approx(0.0, abs=1e-9), "it does not see when"


def test_a_clip_given_twice_or_at_twice_the_rate_has_the_same_errors(gesture, damage):
    truth = gesture()
    made = damage["mirrored"](truth)
    twice = [m._replace(positions=np.concatenate([m.positions] * 2)) for m in (made, truth)]
    fast = [damage["mirrored"](gesture(rate_hz=60.0)), gesture(rate_hz=60.0)]
    for measure in (accuracy.ape, accuracy.pck):
        assert measure(*twice) == pytest.approx(measure(made, truth))
        assert measure(*fast) == pytest.approx(measure(made, truth), rel=0.02)
