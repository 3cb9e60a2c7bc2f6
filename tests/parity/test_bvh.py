"""Recorded BVH files and poses: the same check as the parity script, on the stored subset."""

from pathlib import Path

import numpy as np
import pytest

from parity import bvh

GOLDEN = Path(__file__).parents[1] / "golden"


def test_every_row_passes():
    rows = list(bvh.check(GOLDEN))
    assert len(rows) == 19
    assert [row for row in rows if not row.passed] == []


def test_every_row_of_the_full_set_passes(shared):
    rows = list(bvh.check(shared / "golden"))
    assert len(rows) == 61
    assert [row for row in rows if not row.passed] == []


def test_a_fault_is_seen(monkeypatch):
    """Poses that keep their place in the world must not pass for poses moved to the origin."""
    decode = bvh.features.decode
    monkeypatch.setattr(bvh.features, "decode", lambda *args, rebase: decode(*args, rebase=False))
    failed = {row.name for row in bvh.check(GOLDEN) if not row.passed}
    assert failed == {f"write_bvh_start.bvh/{part}" for part in ("root offset", "positions", "rotations")}


def test_another_hierarchy_text_is_seen(monkeypatch):
    monkeypatch.setattr(bvh.bvh, "_triple", lambda xyz: " ".join(f"{x:.5f}" for x in np.asarray(xyz)))
    assert any(row.name.endswith("hierarchy") and not row.passed for row in bvh.check(GOLDEN))


def test_an_empty_folder_is_refused(tmp_path):
    (tmp_path / "bvh").mkdir()
    (tmp_path / "bvh" / "case.json").write_text("{}")
    with pytest.raises(FileNotFoundError, match="holds nothing to check"):
        list(bvh.check(tmp_path))
