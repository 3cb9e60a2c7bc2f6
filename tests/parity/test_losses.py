"""Recorded losses: the same check as the parity script, on the stored subset and on the whole set."""

from pathlib import Path

import numpy as np
import pytest

from parity import losses

GOLDEN = Path(__file__).parents[1] / "golden"


@pytest.fixture(scope="module")
def rows():
    return list(losses.check(GOLDEN))


def test_every_row_passes(rows):
    assert len(rows) == 28  # four of values, two for each of ten gradients, four of kinematics
    assert [row for row in rows if not row.passed] == []


def test_a_fault_is_seen(rows, monkeypatch):
    """Another annealing must not pass; `rows` has compiled the rest."""
    right = losses.losses.kl_weight
    monkeypatch.setattr(losses.losses, "kl_weight", lambda step: right(step, limit=0.21))
    assert [row.name for row in losses.check(GOLDEN) if not row.passed] == ["kl_weight, relative"]


def test_gradients_are_compared_whole():
    """A wrong shape, a wrong scale and one wrong entry in a hundred fail; one flipped sign in 10,000 does not."""
    right = np.full((100, 100), 1e-3)
    flipped, wrong = right.copy(), right.copy()
    flipped[3, 4], wrong[:, 0] = -1e-3, -1e-3
    verdicts = [
        [row.passed for row in losses.gradient_rows("s", "g", ours, right, 1e-9)]
        for ours in (right, right * 1.01, wrong, flipped)
    ]
    assert verdicts == [[True, True], [False, False], [False, False], [True, False]]
    assert next(losses.gradient_rows("s", "g", right[0], right, 1e-9)).error == np.inf


def test_a_folder_without_the_file_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"holds no losses\.npz"):
        list(losses.check(tmp_path))


@pytest.mark.slow
def test_the_whole_set(shared):
    whole = list(losses.check(shared / "golden"))
    assert any(row.name == "dO_ltxy__f64" for row in whole)
    assert [row for row in whole if not row.passed] == []
