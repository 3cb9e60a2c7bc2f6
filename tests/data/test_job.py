"""A clip's share of preparing: clips of other lengths use what was compiled for the first ones."""

from dataclasses import replace

import jax
import pytest

from zeggs_jax.data import corpus, job
from zeggs_jax.data.settings import MENDED
from zeggs_jax.data.shard import Body

from .conftest import add_pair


def test_no_length_of_clip_compiles_anything_new(tmp_path, caplog):
    """Neither time nor memory may grow with the number of different lengths."""
    for number, frames in enumerate((90, 91, 117, 203)):
        add_pair(tmp_path / "c", f"{number}", frames, number)
    first, *others = job.jobs_of(corpus.find(tmp_path / "c"), MENDED, tmp_path, tmp_path)
    assert isinstance(job.make(first), Body)
    with jax.log_compiles():
        assert all(isinstance(job.make(one), Body) for one in others)
        assert [record.getMessage() for record in caplog.records if "Compiling" in record.getMessage()] == []
        jax.jit(lambda x: x + 17)(1.0)
    assert any("Compiling" in record.getMessage() for record in caplog.records), "the log is not seen"


@pytest.mark.parametrize("change", [{"rate_hz": 30}, {"min_frames": 20}, {"centre": False}, {"as_released": True}])
def test_settings_have_shards_of_their_own(tmp_path, change):
    add_pair(tmp_path / "c", "a", 30)
    entries = corpus.find(tmp_path / "c")
    usual, other, statistics = (
        job.jobs_of(entries, config, tmp_path, tmp_path)[0].path
        for config in (MENDED, replace(MENDED, **change), replace(MENDED, speech_columns=True))
    )
    assert usual == statistics != other
