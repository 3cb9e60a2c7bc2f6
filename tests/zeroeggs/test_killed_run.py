"""A real `zeggs train` process is killed, started again, stopped by Ctrl-C and started again: the same bits come out.

Everything that could leave a trace is on: validation, samples, the average, accumulation, clipping, augmentation.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from zeggs_jax.training import checkpoint, keep
from zeggs_jax.training.record import TIMING, read_log

STEPS, EVERY = 60, 4  # updates in all and between checkpoints
SETTINGS = {
    "model": {
        "speech": {"hidden": 6, "size": 5, "kernel": 5},
        "style": {"kind": "label"},
        "labels": ["calm", "wild"],
        "decoder": {"hidden": 12, "layers": 1},
    },
    "windows": {"batch": 4, "window": 6, "example": [8, 12]},
    "steps": STEPS, "learning_rate": 0.01, "remat": True, "clip_norm": 50.0, "ema": 0.9, "accumulate": 2,
    "log_every": 1, "checkpoint_every": EVERY, "keep": 2, "keep_every": 20,
    "validate_every": 10, "validate_clips": 2, "sample_every": 30,
}  # fmt: skip
QUICK = "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"  # compiles in half the time
CODE = """
import os, sys, warnings
warnings.simplefilter("error")
from zeggs_jax.cli import main
from zeggs_jax.training.record import Records
write, (last, number) = Records.update, map(int, sys.argv[-2:])
def update(self, step, values):
    write(self, step, values)
    if step == last:
        os.kill(os.getpid(), number)
Records.update, sys.argv = update, sys.argv[:-2]
main()
"""  # the command, which gets a signal as soon as an update is logged


class Command:
    """`zeggs train` as a process of its own, with a compile cache that all runs of this file share."""

    def __init__(self, corpus: Path, folder: Path) -> None:
        self.corpus, self.config = corpus, folder / "config.json"
        self.config.write_text(json.dumps(SETTINGS))
        cache = {"JAX_COMPILATION_CACHE_DIR": str(folder), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1"}
        self.environment = os.environ | {"JAX_PLATFORMS": "cpu", "XLA_FLAGS": QUICK} | cache

    def __call__(self, run: Path, last: int = -1, number: int = 0) -> tuple[int, str]:
        """Train; signal `number` comes right after update `last` is logged. Exit status and what was said."""
        words = [sys.executable, "-c", CODE, "train", self.corpus, "-o", run, "--config", self.config, last, number]
        done = subprocess.run([str(word) for word in words], env=self.environment, capture_output=True, text=True)
        return done.returncode, done.stderr


def log_of(run: Path) -> list[dict]:
    """The log without what depends on the clock."""
    return [{key: line[key] for key in line if key not in TIMING} for line in read_log(run / "log.jsonl")]


def done_of(run: Path) -> int:
    return int(checkpoint.load(keep.checkpoints(run)[-1])[0]["step"])


def samples_of(run: Path) -> dict[str, bytes]:
    return {str(path.relative_to(run)): path.read_bytes() for path in sorted((run / "samples").rglob("*.*"))}


@pytest.fixture(scope="module")
def command(corpus, tmp_path_factory) -> Command:
    return Command(corpus, tmp_path_factory.mktemp("command"))


@pytest.fixture(scope="module")
def whole(command, tmp_path_factory) -> Path:
    """A run that nothing happened to."""
    run = tmp_path_factory.mktemp("whole")
    status, told = command(run)
    assert status == 0, told
    return run


def test_a_killed_and_a_stopped_run_end_in_the_bits_of_an_unbroken_one(command, whole, tmp_path):
    status, _ = command(tmp_path, 17, signal.SIGKILL)
    assert status == -signal.SIGKILL
    assert [line["step"] for line in log_of(tmp_path)] == list(range(18))
    assert done_of(tmp_path) == 16  # what is lost lies between two checkpoints

    status, told = command(tmp_path, 37, signal.SIGINT)
    assert (status, told.splitlines()[-1]) == (
        130,
        "zeggs: stopped after 38 updates; resume with the same command.",
    )
    assert done_of(tmp_path) == 38  # nothing is lost

    status, told = command(tmp_path)
    assert status == 0, told
    assert log_of(tmp_path) == log_of(whole)
    assert (tmp_path / "valid.jsonl").read_text() == (whole / "valid.jsonl").read_text()
    assert samples_of(tmp_path) == samples_of(whole)
    for path in (*keep.checkpoints(whole), keep.best(whole)):
        assert checkpoint.digest(keep.best(tmp_path).with_name(path.name)) == checkpoint.digest(path), path.name


def test_a_run_leaves_what_its_policy_says(whole):
    assert [path.name for path in keep.checkpoints(whole)] == [f"step_{n:08d}" for n in (20, 40, 56, 60)]
    valid = list(read_log(whole / "valid.jsonl"))
    assert [line["step"] for line in valid] == [10, 20, 30, 40, 50, 60]
    best = min(valid, key=lambda line: line["loss"])
    assert int(checkpoint.load(keep.best(whole))[0]["step"]) == best["step"]
    assert {"loss", "kl", "world_pos", "position_cm", "jerk_ratio", "clips"} <= valid[0].keys()
    assert [path.name for path in sorted((whole / "samples").iterdir())] == ["step_00000030", "step_00000060"]
    assert {path.name for path in (whole / "samples" / "step_00000060").iterdir()} == {"wild_d.bvh", "index.html"}
    assert list((whole / "tensorboard").glob("events.*"))
