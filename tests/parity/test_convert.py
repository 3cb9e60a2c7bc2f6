"""Recorded checkpoints: the same check as the parity script, on the stored subset and on the whole set."""

import shutil
from pathlib import Path

import numpy as np

from parity import convert

GOLDEN = Path(__file__).parents[1] / "golden"


def test_every_row_passes():
    rows = list(convert.check(GOLDEN, None))
    assert [row.name for row in rows] == ["speech_encoder.pt"]
    assert all(row.passed for row in rows)


def test_one_other_bit_is_seen(tmp_path):
    shutil.copytree(GOLDEN / "convert", tmp_path / "convert")
    path = tmp_path / "convert" / "state_dicts.npz"
    with np.load(path) as archive:
        arrays = dict(archive)
    weight = arrays["speech_encoder/layer2.weight"]
    weight[0, 0] = np.nextafter(weight[0, 0], np.float32(2))
    np.savez(path, **arrays)
    assert [row.error for row in convert.check(tmp_path, None)] == [1.0]


def test_the_whole_set(shared):
    rows = list(convert.check(shared / "golden", shared / "reference"))
    assert len(rows) == 13
    assert [row for row in rows if not row.passed] == []
