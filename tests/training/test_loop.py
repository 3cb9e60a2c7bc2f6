"""The loop on a small quadratic: it learns, resumes to the same bits, stops cleanly, never saves what is not finite."""

import os
import signal
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.training import checkpoint, keep, loop
from zeggs_jax.training.loop import Plan, Task
from zeggs_jax.training.optimiser import radam
from zeggs_jax.training.record import TIMING, read_log
from zeggs_jax.training.step import TrainState, begin, make_step

PLAN = Plan(steps=12, log_every=1, checkpoint_every=4, keep=2)
OPTIMISER = radam(0.05)


def loss_fn(params, batch, keys, step):
    noise = 0.01 * jax.vmap(lambda key: jax.random.normal(key, (5,)))(keys)
    error = jnp.mean((params["w"][None] - batch - noise) ** 2)
    return error, {"error": error}


def batches(k: int) -> np.ndarray:
    return np.random.default_rng(k).normal(1.0, 0.1, (4, 5)).astype(np.float32)


def start() -> TrainState:
    return begin({"w": jnp.zeros(5)}, OPTIMISER)


def save(path: Path, state: TrainState) -> None:
    checkpoint.save(path, state, {})


def resume(run: Path) -> TrainState:
    tree, _ = checkpoint.load(keep.checkpoints(run)[-1], start())
    return jax.tree.map(jnp.asarray, tree)


def fit(run: Path, state: TrainState, plan: Plan = PLAN, given=batches, seed: int = 3) -> TrainState:
    step = make_step(loss_fn, OPTIMISER, seed)
    return loop.fit(state, Task(step, given, save), run, plan, progress=False)


def log_of(run: Path) -> list[dict]:
    """The log without what depends on the clock."""
    return [{key: line[key] for key in line if key not in TIMING} for line in read_log(run / "log.jsonl")]


def test_it_learns_and_writes(tmp_path):
    state = fit(tmp_path, start())
    log = log_of(tmp_path)
    assert [line["step"] for line in log] == list(range(12))
    assert log[-1]["loss"] < 0.9 * log[0]["loss"]
    assert set(log[0]) == {"step", "loss", "error", "gradient"}
    assert int(state.step) == 12
    assert [path.name for path in keep.checkpoints(tmp_path)] == ["step_00000008", "step_00000012"]


def test_a_resumed_run_has_the_numbers_of_an_unbroken_one(tmp_path):
    whole = fit(tmp_path / "whole", start())
    fit(tmp_path / "parts", start(), PLAN._replace(steps=5))
    parts = fit(tmp_path / "parts", resume(tmp_path / "parts"))
    assert log_of(tmp_path / "whole") == log_of(tmp_path / "parts")
    jax.tree.map(np.testing.assert_array_equal, whole, parts)


def test_another_seed_gives_other_numbers(tmp_path):
    fit(tmp_path / "a", start())
    fit(tmp_path / "b", start(), seed=4)
    assert log_of(tmp_path / "a")[0]["loss"] != log_of(tmp_path / "b")[0]["loss"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_run_saves_and_resumes(tmp_path, number):
    step = make_step(loss_fn, OPTIMISER, 3)

    def stopping(state: TrainState, batch: np.ndarray):
        if int(state.step) == 5:
            os.kill(os.getpid(), number)
        return step(state, batch)

    handlers = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]
    with pytest.raises(KeyboardInterrupt, match="stopped after 6 updates"):
        loop.fit(start(), Task(stopping, batches, save), tmp_path / "run", PLAN, progress=False)
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)] == handlers
    assert keep.checkpoints(tmp_path / "run")[-1].name == "step_00000006"
    fit(tmp_path / "run", resume(tmp_path / "run"))
    fit(tmp_path / "whole", start())
    assert log_of(tmp_path / "run") == log_of(tmp_path / "whole")


def test_what_is_not_finite_stops_and_is_not_saved(tmp_path):
    def broken(k: int) -> np.ndarray:
        return batches(k) * (np.nan if k == 7 else 1)

    with pytest.raises(ValueError, match=r"update 7 \(batch 7\): 'error' is not finite.*step_00000004"):
        fit(tmp_path, start(), given=broken)
    assert [path.name for path in keep.checkpoints(tmp_path)] == ["step_00000004"]
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(resume(tmp_path)))


def test_a_gradient_that_is_not_finite_stops_too(tmp_path):
    def root(params, batch, key, step):
        error = jnp.sum(jnp.sqrt(jnp.abs(params["w"])))
        return error, {"error": error}

    step = make_step(root, OPTIMISER, 0)
    with pytest.raises(ValueError, match=r"update 0 .*'gradient' is not finite; there is no checkpoint yet"):
        loop.fit(start(), Task(step, batches, save), tmp_path, PLAN._replace(checkpoint_every=1), progress=False)


def test_unfinished_checkpoints_do_not_count(tmp_path):
    fit(tmp_path, start(), PLAN._replace(steps=4))
    (tmp_path / "checkpoints" / "step_00000009").mkdir()
    (tmp_path / "checkpoints" / ".step_00000010.abc").mkdir()
    assert [path.name for path in keep.checkpoints(tmp_path)] == ["step_00000004"]


def test_a_finished_run_does_nothing(tmp_path):
    done = fit(tmp_path, start())
    again = fit(tmp_path, jax.tree.map(jnp.array, done), given=lambda k: pytest.fail("no batch is needed"))
    assert int(again.step) == 12


class Watched:
    """Validates and samples, and remembers when."""

    def __init__(self, losses: dict[int, float] | None = None) -> None:
        self.losses, self.validated, self.sampled = losses or {}, [], []

    def validate(self, state: TrainState) -> dict[str, float]:
        self.validated.append(int(state.step))
        return {"loss": self.losses.get(int(state.step), 1.0)}

    def sample(self, folder: Path, state: TrainState) -> None:
        self.sampled.append(int(state.step))
        folder.mkdir(parents=True)

    def task(self) -> Task:
        return Task(make_step(loss_fn, OPTIMISER, 3), batches, save, self.validate, self.sample)


LOOK = PLAN._replace(validate_every=5, sample_every=6)


def test_validation_and_samples_come_when_due_and_change_nothing(tmp_path):
    watched = Watched({5: 3.0, 10: 2.0, 12: 2.5})
    looked = loop.fit(start(), watched.task(), tmp_path / "looked", LOOK, progress=False)
    plain = fit(tmp_path / "plain", start())
    assert (watched.validated, watched.sampled) == ([5, 10, 12], [6, 12])
    assert log_of(tmp_path / "looked") == log_of(tmp_path / "plain")
    jax.tree.map(np.testing.assert_array_equal, looked, plain)
    best, _ = checkpoint.load(keep.best(tmp_path / "looked"))
    assert int(best["step"]) == 10


def test_what_a_kill_after_the_checkpoint_left_undone_is_done_on_resume(tmp_path):
    fit(tmp_path, start(), LOOK._replace(steps=10, validate_every=0, sample_every=0))  # the checkpoint of 10 is there
    watched = Watched()
    loop.fit(resume(tmp_path), watched.task(), tmp_path, LOOK, progress=False)
    assert (watched.validated, watched.sampled) == ([10, 12], [12])
    loop.fit(resume(tmp_path), watched.task(), tmp_path, LOOK, progress=False)
    assert (watched.validated, watched.sampled) == ([10, 12], [12])  # nothing is done twice


def test_only_the_best_is_kept_if_so_asked(tmp_path):
    loop.fit(start(), Watched().task(), tmp_path, LOOK._replace(keep_best=False), progress=False)
    assert not keep.best(tmp_path).exists()


def test_an_exploding_loss_stops_and_is_not_saved(tmp_path):
    def exploding(k: int) -> np.ndarray:
        return batches(k) * (100.0 if k == 7 else 1.0)

    with pytest.raises(ValueError, match=r"update 7 \(batch 7\): the loss is .* 50 times .* 'error'; .*step_00000004"):
        fit(tmp_path, start(), PLAN._replace(explode=50.0), exploding)
    assert [path.name for path in keep.checkpoints(tmp_path)] == ["step_00000004"]
    assert int(fit(tmp_path, resume(tmp_path)).step) == 12


def test_a_full_disk_stops_with_the_last_checkpoint_whole(tmp_path):
    def full(path: Path, state: TrainState) -> None:
        if int(state.step) == 8:
            raise OSError(28, "No space left on device")
        save(path, state)

    task = Task(make_step(loss_fn, OPTIMISER, 3), batches, full)
    with pytest.raises(OSError, match=r"step_00000008' cannot be written \(No space left.*step_00000004'; make room"):
        loop.fit(start(), task, tmp_path / "run", PLAN, progress=False)
    fit(tmp_path / "run", resume(tmp_path / "run"))
    fit(tmp_path / "whole", start())
    assert log_of(tmp_path / "run") == log_of(tmp_path / "whole")


def test_an_error_of_a_batch_comes_as_it_is(tmp_path):
    def broken(k: int) -> np.ndarray:
        if k == 6:
            raise OSError("'pose.npy' is gone.")
        return batches(k)

    with pytest.raises(OSError, match=r"^'pose.npy' is gone\.$"):
        fit(tmp_path, start(), given=broken)
    assert keep.checkpoints(tmp_path)[-1].name == "step_00000004"


def test_the_log_says_how_fast_and_how_long_updates_wait(tmp_path):
    def slow(k: int) -> np.ndarray:
        time.sleep(0.05)
        return batches(k)

    fit(tmp_path / "slow", start(), given=slow)
    fit(tmp_path / "quick", start())
    last = {name: list(read_log(tmp_path / name / "log.jsonl"))[-1] for name in ("slow", "quick")}
    assert last["slow"]["wait"] > 0.5
    assert 0.0 <= last["quick"]["wait"] < last["slow"]["wait"]
    assert last["slow"]["speed"] < 40.0  # a batch takes 1/20 s


def test_a_device_without_room_is_told_what_to_do(tmp_path):
    def step(state: TrainState, batch: np.ndarray):
        raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 8589934592 bytes.\nmore")

    with pytest.raises(ValueError, match=r"update 0 does not fit into the memory of the device \(.*8589934592 bytes"):
        loop.fit(start(), Task(step, batches, save), tmp_path, PLAN, progress=False)


def test_a_stop_that_comes_too_late_for_a_stage_reaches_what_runs_it():
    with loop.stop_requested() as whole:
        with loop.stop_requested() as stage:
            os.kill(os.getpid(), signal.SIGINT)
            assert stage.is_set()
        assert whole.is_set()
        with loop.stop_requested() as later:
            assert not later.is_set()
    with loop.stop_requested() as after:
        assert not after.is_set()
