"""Recorded style encoders: the same check as the parity script, on the stored subset and on the whole set."""

from pathlib import Path

import pytest

from parity import style_encoder
from zeggs_jax.nn import attention
from zeggs_jax.zeroeggs import style_encoder as ours

GOLDEN = Path(__file__).parents[1] / "golden"


def test_every_row_passes():
    rows = list(style_encoder.check(GOLDEN, None))
    assert len(rows) == 50
    assert [row for row in rows if not row.passed] == []


def test_faults_are_seen(monkeypatch):
    """Neither positions counted from 1 nor a temperature that divides may pass."""
    with monkeypatch.context() as patch:
        patch.setattr(ours, "positions", lambda frames, width: attention.positions(frames + 1, width)[1:])
        failed = {row.name for row in style_encoder.check(GOLDEN, None) if not row.passed}
        assert "small_attn_vae/mu_64" in failed
        assert not any("gru" in name for name in failed)
    patched = style_encoder.reparameterise
    monkeypatch.setattr(style_encoder, "reparameterise", lambda d, noise, t=1.0: patched(d, noise, 1 / t))
    failed = {row.name for row in style_encoder.check(GOLDEN, None) if not row.passed}
    assert "small_gru_vae/style_64_temp0.5" in failed
    assert "small_gru_vae/style_64" not in failed


@pytest.mark.slow
def test_the_whole_set(shared):
    assert [row for row in style_encoder.check(shared / "golden", None) if not row.passed] == []
