"""Recorded training: the same check as the parity script, on the stored subset and on the whole set."""

import json
from pathlib import Path

import pytest

from parity import train
from zeggs_jax.training.optimiser import radam

GOLDEN = Path(__file__).parents[1] / "golden"


@pytest.fixture(scope="module")
def rows():
    return list(train.check(GOLDEN))


def test_every_row_passes(rows):
    assert len(rows) == 182
    assert sum(row.name.startswith("run_attn_vae/w20.") for row in rows) > 20
    assert [row for row in rows if not row.passed] == []


def test_a_fault_is_seen(monkeypatch):
    """Without the momentum steps of the first five updates nothing matches."""

    def waiting(*args, momentum_start, **options):
        return radam(*args, momentum_start=not momentum_start, **options)

    monkeypatch.setattr(train, "radam", waiting)
    case, arrays = train.read_case(GOLDEN / "train"), train.read_arrays(GOLDEN / "train" / "radam.npz")
    rows = train._optimiser(case, "plain", case["radam"]["plain"], arrays)
    failed = [row.name.removeprefix("radam/plain_") for row in rows if not row.passed]
    assert failed == ["w", "g", "exp_avg", "exp_avg_sq"]


def test_a_folder_without_results_is_refused(tmp_path):
    (tmp_path / "train").mkdir()
    (tmp_path / "train" / "case.json").write_text(json.dumps({"configs": {"run_gru": {}}, "files": {}}))
    with pytest.raises(ValueError, match="holds none of the files"):
        list(train.check(tmp_path))


@pytest.mark.slow
def test_the_whole_set(shared):
    whole = list(train.check(shared / "golden"))
    assert {row.name.split("/")[0] for row in whole} >= {"run_attn_vae", "run_gru", "run_label", "radam"}
    assert [row for row in whole if not row.passed] == []
