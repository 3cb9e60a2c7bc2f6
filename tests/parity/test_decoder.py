"""Recorded decoders: the same check as the parity script, on the stored subset and on the whole set."""

from pathlib import Path

import jax
import pytest

from parity import decoder

GOLDEN = Path(__file__).parents[1] / "golden"


def test_every_row_passes():
    rows = list(decoder.check(GOLDEN, None))
    assert len(rows) == 12
    assert [row for row in rows if not row.passed] == []


def test_a_fault_is_seen(monkeypatch):
    """Another activation must not pass."""
    monkeypatch.setattr(decoder.d.jax.nn, "elu", jax.nn.celu)
    assert all(row.passed for row in decoder.check(GOLDEN, None))  # celu with alpha 1 is elu
    monkeypatch.setattr(decoder.d.jax.nn, "elu", jax.nn.selu)
    assert not any(row.passed for row in decoder.check(GOLDEN, None))


@pytest.mark.slow
def test_the_whole_set(shared):
    rows = list(decoder.check(shared / "golden", shared / "reference"))
    assert any(row.name.startswith("v1_normal_long/") for row in rows)
    assert [row for row in rows if not row.passed] == []
