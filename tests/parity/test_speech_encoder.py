"""Recorded speech encoders: the parity script's check, on the stored subset and on the whole set."""

from pathlib import Path

import pytest

from parity import speech_encoder
from zeggs_jax.nn.layers import Conv
from zeggs_jax.zeroeggs import speech_encoder as ours

GOLDEN = Path(__file__).parents[1] / "golden"


def test_every_row_passes():
    rows = list(speech_encoder.check(GOLDEN, None))
    assert len(rows) == 14
    assert [row for row in rows if not row.passed] == []


def test_a_fault_is_seen(monkeypatch):
    """Zeros beyond the ends, the usual mistake, must not pass."""
    monkeypatch.setattr(ours, "Conv", lambda *sizes, padding="", **rest: Conv(*sizes, **rest))
    assert any(not row.passed for row in speech_encoder.check(GOLDEN, None))


def test_an_empty_folder_is_refused(tmp_path):
    (tmp_path / "speech_encoder").mkdir()
    (tmp_path / "speech_encoder" / "case.json").write_text('{"files": {"small.npz": {}}}')
    with pytest.raises(ValueError, match="holds none of the files"):
        list(speech_encoder.check(tmp_path, None))


def test_the_published_weights(shared):
    rows = list(speech_encoder.check(shared / "golden", shared / "reference"))
    assert len(rows) == 42
    assert [row for row in rows if not row.passed] == []
