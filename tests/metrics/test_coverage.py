"""Gesture area coverage: known areas, who covers more, and that place, heading and rate do not count."""

import numpy as np
import pytest

from zeggs_jax.metrics import coverage
from zeggs_jax.metrics.coverage import CELL, SIDE


def test_a_line_covers_the_cells_that_it_crosses():
    grid = coverage._mark(np.stack([np.linspace(-20.0, 19.9, 4000), np.full(4000, 100.2)], axis=-1))
    assert grid.sum() == 80
    assert grid[200, 160:240].all()
    assert coverage.area(grid) == pytest.approx(80 * 0.25)


def test_areas_half_in_common():
    truth = np.zeros((4, 4), bool)
    truth[:, :2] = True
    made = np.zeros((4, 4), bool)
    made[:, 1:3] = True
    assert coverage.of_grids(made, truth) == pytest.approx((0.5, 1.0, 0.5, 0.5))
    assert coverage.of_grids(truth, truth) == (1.0, 1.0, 0.0, 0.0)
    assert coverage.of_grids(~truth, truth).dice == 0.0
    with pytest.raises(ValueError, match="in cm, y up"):
        coverage.of_grids(made, np.zeros((4, 4), bool))


def test_a_motion_covers_itself_wherever_it_stands_and_at_any_rate(gesture):
    motion = gesture()
    turn = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
    moved = motion._replace(positions=motion.positions @ turn.T + np.array([40.0, 0.0, -300.0]))
    assert coverage.compare(moved, motion).dice > 0.97
    fast = coverage.occupied(gesture(rate_hz=60.0))
    assert coverage.of_grids(fast, coverage.occupied(motion)).dice > 0.97


def test_a_clip_given_twice_covers_no_more(gesture):
    motion = gesture()
    twice = motion._replace(positions=np.concatenate([motion.positions, motion.positions]))
    assert coverage.compare(twice, motion).beyond < 0.02


def test_larger_gestures_cover_more_and_held_poses_less(gesture, damage):
    truth = gesture(0)
    found = [coverage.compare(gesture(0, size=size), truth) for size in (1.0, 4.0, 8.0, 12.0, 20.0)]
    areas = [c.area for c in found]
    assert areas == sorted(areas)
    dice = [c.dice for c in found]
    assert dice[3] == 1.0 == max(dice)
    assert dice[:4] == sorted(dice[:4])
    assert found[-1].beyond > 0.2 > 0.02 > found[0].beyond
    held = coverage.compare(damage["frozen"](truth), truth)
    assert held.area < 0.5
    assert held.missing > 0.7


def test_the_mirror_image_of_one_sided_gestures_covers_another_area(gesture, damage):
    truth = gesture(0)
    found = coverage.compare(damage["mirrored"](truth), truth)
    assert found.area == pytest.approx(1.0, abs=0.05)
    assert found.dice < 0.85


def test_what_is_outside_is_cut_off(gesture):
    motion = gesture()
    high = motion._replace(positions=motion.positions + np.array([0.0, 500.0, 0.0]))
    assert not coverage.occupied(high).any()
    assert coverage.occupied(motion).shape == (SIDE / CELL, SIDE / CELL)
