"""Preparing that is stopped or broken: it goes on where it was, to the same bytes, and says what happened."""

import errno
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from zeggs_jax.data import job, shard, workers
from zeggs_jax.data import prepare as preparation
from zeggs_jax.data.prepare import PrepareConfig, Prepared, load, prepare

from .conftest import add_pair

RUN = "from zeggs_jax import cli; cli.main()"
FILES = ("speech.npy", "pose.npy", "root_pos.npy", "root_rot.npy", "scales.npz", "manifest.json")


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in FILES}


def start(corpus: Path, out: Path, *flags: str) -> subprocess.Popen:
    """A real process that prepares the corpus."""
    command = [sys.executable, "-c", RUN, "prepare", str(corpus), "-o", str(out), *flags]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "JAX_PLATFORMS": "cpu"},
    )  # fmt: skip


def wait_for_shards(out: Path, count: int, process: subprocess.Popen) -> list[Path]:
    """The first files of clips that appear; the process must still be at work then."""
    until = time.monotonic() + 240
    while len(found := sorted(out.glob("clips/*.npz"))) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.002)
    return found


@pytest.fixture
def many(tmp_path) -> Path:
    for number in range(24):
        add_pair(tmp_path / "many", f"calm/{number:02}", 300, number)
    return tmp_path / "many"


def test_a_killed_run_goes_on_where_it_was(many, tmp_path):
    """SIGKILL in the middle; what was made is not made again, and the result has the same bytes."""
    whole, out = tmp_path / "whole", tmp_path / "out"
    process = start(many, out, "--processes", "1")
    wait_for_shards(out, 3, process)
    process.kill()
    process.communicate()
    assert not (out / "manifest.json").exists()
    with pytest.raises(FileNotFoundError, match="manifest"):
        load(out)
    kept = {path: path.stat().st_mtime_ns for path in out.glob("clips/*.npz")}
    assert 3 <= len(kept) < 24
    made = []
    real = preparation.make
    preparation.make = lambda one: made.append(one.path) or real(one)
    try:
        prepare(many, out, processes=1)
    finally:
        preparation.make = real
    assert len(made) == 24 - len(kept)
    assert not set(made) & kept.keys()
    prepare(many, whole, processes=1)
    assert contents(out) == contents(whole)
    assert not (out / "clips").exists()
    assert sorted(path.name for path in out.iterdir()) == sorted((*FILES, "report.json"))


def test_workers_make_the_same_bytes_and_end_with_their_parent(corpus_folder, prepared, tmp_path):
    assert contents(prepare(corpus_folder, tmp_path / "two", processes=2).folder) == contents(prepared.folder)
    for number in range(24):
        add_pair(tmp_path / "many", f"{number:02}", 300, number)
    process = start(tmp_path / "many", tmp_path / "out", "--processes", "2")
    wait_for_shards(tmp_path / "out", 1, process)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not children.exists():
        pytest.skip("no /proc")
    ids = children.read_text().split()
    assert len(ids) >= 2
    process.kill()
    process.communicate()
    until = time.monotonic() + 60
    while any(Path(f"/proc/{one}").exists() for one in ids):
        assert time.monotonic() < until, "a worker outlives its parent"
        time.sleep(0.05)


def test_a_changed_clip_is_made_again(corpus_folder, tmp_path):
    """A shard of a clip that has changed since is not used, be its file as old and as long as before."""
    out = tmp_path / "out"
    _stop_before_joining(corpus_folder, out)
    wav = corpus_folder / "calm" / "b.wav"
    before, sound = wav.stat(), bytearray(wav.read_bytes())
    sound[2000:4000] = sound[4000:6000]
    wav.write_bytes(sound)
    os.utime(wav, ns=(before.st_atime_ns, before.st_mtime_ns))
    prepare(corpus_folder, out)
    prepare(corpus_folder, tmp_path / "fresh")
    assert contents(out) == contents(tmp_path / "fresh")


def test_other_settings_make_all_again(corpus_folder, tmp_path):
    out = tmp_path / "out"
    _stop_before_joining(corpus_folder, out)
    prepare(corpus_folder, out, PrepareConfig(rate_hz=30))
    prepare(corpus_folder, tmp_path / "fresh", PrepareConfig(rate_hz=30))
    assert contents(out) == contents(tmp_path / "fresh")


def test_a_damaged_shard_is_made_again(corpus_folder, prepared, tmp_path):
    out = tmp_path / "out"
    _stop_before_joining(corpus_folder, out)
    first, second, *_ = sorted((out / "clips").glob("*.npz"))
    first.write_bytes(first.read_bytes()[:-100])
    data = bytearray(second.read_bytes())
    data[len(data) // 2] ^= 255  # the directory is whole, a value is not
    second.write_bytes(data)
    prepare(corpus_folder, out)
    assert contents(out) == contents(prepared.folder)


def _stop_before_joining(corpus: Path, out: Path) -> None:
    """All shards are there, nothing else."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(preparation, "join", _interrupt)
        with pytest.raises(KeyboardInterrupt, match=r"^stopped: 6 of 6 clips are made, and the same command goes on"):
            prepare(corpus, out)


def _interrupt(*_):
    raise KeyboardInterrupt


def test_what_is_done_is_not_done_again(corpus_folder, tmp_path, monkeypatch):
    prepare(corpus_folder, tmp_path / "out")
    monkeypatch.setattr(preparation, "_make_all", _interrupt)
    prepare(corpus_folder, tmp_path / "out")
    (corpus_folder / "calm" / "b.bvh").write_text((corpus_folder / "calm" / "a.bvh").read_text())
    with pytest.raises(KeyboardInterrupt):
        prepare(corpus_folder, tmp_path / "out")
    with pytest.raises(FileNotFoundError, match="manifest"):
        load(tmp_path / "out")


@pytest.mark.slow
def test_ctrl_c_says_how_far_it_came(many, tmp_path):
    """In a terminal Ctrl-C reaches the workers too; only one sentence is said, and no traceback."""
    process = start(many, tmp_path / "out", "--processes", "2")
    wait_for_shards(tmp_path / "out", 2, process)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=240)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert "of 24 clips are made, and the same command goes on from there." in said.splitlines()[-1]
    assert not list((tmp_path / "out").glob("**/*.partial"))


def _die(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_dead_worker_is_said(tmp_path):
    with pytest.raises(ChildProcessError, match=r"worker process died \(out of memory\?\) at job \d of 9"):
        list(workers.each(_die, range(9), 2))


def test_a_dead_worker_ends_preparing_in_one_sentence(corpus_folder, tmp_path, monkeypatch):
    def die(*_):
        raise ChildProcessError("a worker process died (out of memory?) at job 2 of 6 or one of the next 2")
        yield

    monkeypatch.setattr(workers, "each", die)
    with pytest.raises(ChildProcessError, match=r"died .*: 0 of 6 clips are made.*fewer --processes") as caught:
        prepare(corpus_folder, tmp_path / "out")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("limit", [30_000, 100_000])
def test_a_full_disk_is_said_and_nothing_half_written_counts(corpus_folder, prepared, tmp_path, limit):
    """No file may be longer than the limit: the first stops a clip's shard, the second the joined arrays."""
    sizes = resource.getrlimit(resource.RLIMIT_FSIZE)
    out = tmp_path / "out"
    prepare(corpus_folder, tmp_path / "warm")  # what is compiled is not written to a cache under the limit
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, sizes[1]))
    try:
        with pytest.raises(OSError, match=rf"^The disk of '{out}' is full: free some space; \d of 6 clips") as caught:
            prepare(corpus_folder, out)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, sizes)
    assert "\n" not in str(caught.value)
    assert not [*out.glob("**/*.partial"), *out.glob("manifest.json"), *out.glob("pose.npy")]
    assert contents(prepare(corpus_folder, out).folder) == contents(prepared.folder)


def test_a_full_disk_in_a_worker_is_the_same(corpus_folder, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(job.shard, "write", full)
    with pytest.raises(OSError, match="is full: free some space; 0 of 6 clips"):
        prepare(corpus_folder, tmp_path / "out")


def test_a_shard_comes_back_as_it_was(tmp_path, corpus_folder):
    found = preparation.corpus.find(corpus_folder)
    one = job.jobs_of(found[:1], PrepareConfig(pace=(0.9, 1.0)), tmp_path, tmp_path)[0]
    body = job.make(one)
    back = shard.read(one.path)
    assert isinstance(body, shard.Body)
    assert shard.read_body(one.path).skeleton.names == back.body.skeleton.names == body.skeleton.names
    assert list(back.takes) == ["angry/a_x_0_9", "angry/a_x_1_0"]
    for made in back.takes.values():
        np.testing.assert_allclose(made.pose.mean, made.rows.pose[2:-2].mean(axis=0, dtype=float), atol=1e-9)
        assert int(made.pose.count) == len(made.rows.look) - 4


def test_the_manifest_says_which_pipeline(prepared: Prepared, corpus_folder, tmp_path):
    released = prepare(corpus_folder, tmp_path / "out", PrepareConfig(as_released=True))
    for one, pipeline in ((prepared, "mended"), (released, "as released")):
        assert json.loads((one.folder / "manifest.json").read_text())["pipeline"] == one.pipeline == pipeline
