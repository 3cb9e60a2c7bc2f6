"""The records of a run: lines of lost updates go, validations judge the best, TensorBoard gets the same numbers."""

import json
import math

from zeggs_jax.training.record import RECENT, Records, read_log


def test_lines_of_lost_updates_are_dropped(tmp_path):
    (tmp_path / "log.jsonl").write_text("".join(json.dumps({"step": k}) + "\n" for k in range(6)) + '{"step": 6, "lo')
    (tmp_path / "valid.jsonl").write_text("".join(json.dumps({"step": k, "loss": 1}) + "\n" for k in (2, 4, 6)))
    with Records(tmp_path, 4) as records:
        assert [line["step"] for line in records.log] == [0, 1, 2, 3]
        assert [records.validated(step) for step in (2, 4, 6)] == [True, True, False]  # 4 is of the state after 4
        records.update(4, {"loss": 1.0})
    assert [line["step"] for line in read_log(tmp_path / "log.jsonl")] == [0, 1, 2, 3, 4]
    assert [line["step"] for line in read_log(tmp_path / "valid.jsonl")] == [2, 4]


def test_only_the_newest_lines_are_kept_in_mind(tmp_path):
    with Records(tmp_path, 0) as records:
        for k in range(RECENT + 10):
            records.update(k, {"loss": float(k)})
        assert [line["step"] for line in records.log] == list(range(10, RECENT + 10))
    assert len(list(read_log(tmp_path / "log.jsonl"))) == RECENT + 10


def test_the_best_is_below_all_of_as_many_clips(tmp_path):
    with Records(tmp_path, 0) as records:
        assert records.is_best({"loss": 3.0, "clips": 8})
        records.validation(10, {"loss": 3.0, "clips": 8})
        assert not records.is_best({"loss": 3.0, "clips": 8})
        assert records.is_best({"loss": 2.9, "clips": 8})
        assert records.is_best({"loss": 9.0, "clips": 16})
        assert not records.is_best({"loss": math.nan, "clips": 16})
        records.validation(20, {"loss": math.nan, "clips": 8})
        assert records.is_best({"loss": 2.9, "clips": 8})
    assert list(read_log(tmp_path / "valid.jsonl"))[1] == {"step": 20, "loss": None, "clips": 8}


def test_processes_that_do_not_write_remember(tmp_path):
    with Records(tmp_path / "run", 0, write=False) as records:
        records.update(0, {"loss": 1.0})
        assert records.log == [{"step": 0, "loss": 1.0}]
    assert not (tmp_path / "run").exists()


def test_tensorboard_gets_every_number(tmp_path):
    with Records(tmp_path, 0) as records:
        records.update(0, {"loss": 1.0, "world_pos": 0.5})
        records.validation(1, {"loss": 2.0})
    (events,) = (tmp_path / "tensorboard").glob("events.*")
    content = events.read_bytes()
    assert all(name in content for name in (b"train/loss", b"train/world_pos", b"valid/loss"))
