"""Recorded data pipeline: the same check as the parity script, on the stored subset."""

from pathlib import Path

import pytest

from parity import dataset
from zeggs_jax.data import takes

GOLDEN = Path(__file__).parents[1] / "golden"


def test_every_row_passes():
    rows = list(dataset.check(GOLDEN, None))
    assert len(rows) == 8  # one clip at two paces: hierarchy, offsets, motion, sound
    assert [row for row in rows if not row.passed] == []


@pytest.mark.slow
def test_every_row_of_the_full_set_passes(shared):
    rows = list(dataset.check(shared / "golden", None))
    assert len(rows) > 40
    assert [row for row in rows if not row.passed] == []


def test_a_fault_is_seen(monkeypatch):
    """Rigid centring, right as it is, must not pass for the release's."""
    rigid = takes.edit.centre
    monkeypatch.setattr(takes.edit, "centre", lambda clip, as_released: rigid(clip))
    assert any(not row.passed for row in dataset.check(GOLDEN, None))


def test_a_folder_without_results_is_refused(tmp_path):
    (tmp_path / "dataset").mkdir()
    (tmp_path / "dataset" / "case.json").write_text('{"files": {}}')
    with pytest.raises(ValueError, match="holds no results"):
        list(dataset.check(tmp_path, None))
