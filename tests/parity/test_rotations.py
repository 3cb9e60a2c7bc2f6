"""Recorded rotations and gradients: the same check as the parity script."""

from pathlib import Path

import pytest

from parity import rotations

GOLDEN = Path(__file__).parents[1] / "golden"


def test_every_row_passes():
    rows = list(rotations.check(GOLDEN))
    assert len(rows) == 162
    assert [row for row in rows if not row.passed] == []


@pytest.mark.parametrize(
    ("table", "key", "wrong"),
    [
        ("NUMPY", "mul", lambda z: rotations.Q.multiply(z["p"], z["q"])),
        (
            "NUMPY",
            "to_euler_xzy",
            lambda z: rotations.Q.to_euler(z["q"], "xzy"),
        ),  # right, but not the release's
        ("TORCH", "quat_normalize", lambda z: rotations.Q.normalize(z["p"], 1e-4)),
    ],
)
def test_a_fault_is_seen(monkeypatch, table, key, wrong):
    monkeypatch.setitem(getattr(rotations, table), key, wrong)
    names = {row.name for row in rotations.check(GOLDEN) if not row.passed}
    assert {name.split("/")[1].removesuffix("__f64") for name in names} == {key}


def test_an_empty_folder_is_refused(tmp_path):
    (tmp_path / "rotations").mkdir()
    (tmp_path / "rotations" / "case.json").write_text("{}")
    with pytest.raises(FileNotFoundError, match="holds none of"):
        list(rotations.check(tmp_path))
