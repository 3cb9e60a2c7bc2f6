"""Which checkpoints stay: the newest, every so many updates, the best."""

import errno
from pathlib import Path

import numpy as np
import pytest

from zeggs_jax.training import checkpoint, keep


def save(path: Path, state: int) -> None:
    checkpoint.save(path, {"w": np.full(2, state)}, {})


def test_the_policy(tmp_path):
    for step in range(10, 100, 10):
        keep.write(keep.numbered(tmp_path, step), step, save)
        keep.prune(tmp_path, 2, 40)
    keep.write(keep.best(tmp_path), 50, save)
    assert [path.name for path in keep.checkpoints(tmp_path)] == [f"step_{n:08d}" for n in (40, 80, 90)]
    keep.prune(tmp_path, 1)
    assert [path.name for path in keep.checkpoints(tmp_path)] == ["step_00000090"]
    assert int(checkpoint.load(keep.best(tmp_path))[0]["w"][0]) == 50


def test_what_a_kill_left_half_written_goes_with_the_next(tmp_path):
    left = tmp_path / "checkpoints" / ".step_00000010.abcdefgh" / "arrays"
    left.mkdir(parents=True)
    keep.write(keep.numbered(tmp_path, 10), 10, save)
    keep.prune(tmp_path, 2)
    assert [path.name for path in (tmp_path / "checkpoints").iterdir()] == ["step_00000010"]


def test_a_full_disk_is_said_and_the_last_checkpoint_named(tmp_path):
    keep.write(keep.numbered(tmp_path, 5), 5, save)

    def full(path: Path, state: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match=r"step_00000010' cannot be written \(No space left on device\)") as told:
        keep.write(keep.numbered(tmp_path, 10), 10, full)
    assert f"the last good checkpoint is '{keep.numbered(tmp_path, 5)}'" in str(told.value)
    assert "\n" not in str(told.value)
