"""Recorded audio vectors: the same check as the parity script, on the stored subset."""

from pathlib import Path

import numpy as np
import pytest

from parity import audio

GOLDEN = Path(__file__).parents[1] / "golden"


def test_every_row_passes():
    rows = list(audio.check(GOLDEN, None))
    assert len(rows) >= 17
    assert [row for row in rows if not row.passed] == []


def test_a_fault_is_seen(monkeypatch):
    """The periodic Hann window, the usual mistake, must not pass."""
    monkeypatch.setattr(audio.features, "hann", lambda size: np.hanning(size + 1)[:-1])
    assert any(not row.passed for row in audio.check(GOLDEN, None))


def test_an_empty_folder_is_refused(tmp_path):
    (tmp_path / "audio").mkdir()
    (tmp_path / "audio" / "case.json").write_text('{"wavs": {}}')
    with pytest.raises(ValueError, match="holds no arrays"):
        list(audio.check(tmp_path, None))
