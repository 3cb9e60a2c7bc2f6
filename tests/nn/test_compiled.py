"""Compiled programs are kept for the next process, unless the user says otherwise; a torn write leaves nothing."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import pytest

from zeggs_jax.nn import compiled

PROGRAM = """
import jax
from zeggs_jax.nn import compiled
folder = compiled.keep()
hits = []
jax.monitoring.register_event_listener(lambda event, **_: hits.append(event) if "cache_hits" in event else None)
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.jit(lambda x: x * 3 + 1)(2.0).block_until_ready()
print(folder, len(hits) > 0)
"""
OPTIONS = (
    "jax_compilation_cache_dir",
    "jax_enable_compilation_cache",
    "jax_persistent_cache_min_compile_time_secs",
)


def run(home: Path) -> str:
    """What a new process says whose cache folder is `home`; warnings are errors."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM],
        env=clean | {"XDG_CACHE_HOME": str(home), "JAX_PLATFORMS": "cpu"},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "arning" not in done.stderr
    return done.stdout.strip()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where programs would be kept by a process to which nobody has said anything."""
    before = {name: getattr(jax.config, name) for name in OPTIONS}
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    jax.config.update("jax_compilation_cache_dir", None)
    jax.config.update("jax_enable_compilation_cache", True)
    yield tmp_path / "zeggs-jax" / "compiled"
    for name, value in before.items():
        jax.config.update(name, value)


def test_a_process_finds_what_two_at_once_have_compiled(tmp_path):
    folder = tmp_path / "zeggs-jax" / "compiled"
    with ThreadPoolExecutor() as pool:
        assert all(said.startswith(str(folder)) for said in pool.map(run, [tmp_path] * 2))
    assert {path.suffix for path in folder.iterdir()} == {""}
    assert all(path.name.endswith("-cache") for path in folder.iterdir())
    assert run(tmp_path) == f"{folder} True"


def test_it_is_on_by_default_and_private(folder):
    assert compiled.keep() == folder
    assert jax.config.jax_compilation_cache_dir == str(folder)
    assert folder.stat().st_mode & 0o077 == 0
    assert compiled.keep() is None
    assert jax.config.jax_compilation_cache_dir == str(folder)


@pytest.mark.parametrize("said", ["", "elsewhere"])
def test_a_folder_of_the_users_comes_first(folder, said, monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", said)
    assert compiled.keep() is None
    jax.config.update("jax_compilation_cache_dir", said)
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    assert compiled.keep() is None
    assert jax.config.jax_compilation_cache_dir == said
    assert not folder.exists()


def test_it_can_be_switched_off(folder):
    jax.config.update("jax_enable_compilation_cache", False)
    assert compiled.keep() is None
    assert not folder.exists()


def test_where_nothing_can_be_written_there_is_none(folder, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert compiled.keep() is None
    assert jax.config.jax_compilation_cache_dir is None


def test_a_write_that_fails_leaves_nothing(folder, monkeypatch):
    compiled.keep()
    cache_type = pytest.importorskip("jax._src.lru_cache").LRUCache
    cache = cache_type(str(folder), max_size=-1)
    with monkeypatch.context() as no_room:
        no_room.setattr(Path, "write_bytes", lambda path, _: path.touch() or (_ for _ in ()).throw(OSError("no room")))
        with pytest.raises(OSError, match="no room"):
            cache.put("key", b"program")
    assert cache.get("key") is None
    cache.put("key", b"program")
    assert cache.get("key") == b"program"
    assert [path.name for path in folder.iterdir()] == ["key-cache"]


def test_every_command_keeps_what_it_compiles(zeggs, monkeypatch):
    def keep():
        raise ValueError("asked to keep")

    monkeypatch.setattr(compiled, "keep", keep)
    for words in (("view", "missing.bvh"), ("diffuclip", "train", "missing", "-o", "run")):
        assert zeggs(*words)[::2] == (2, "zeggs: asked to keep\n")
