"""The kernel's library: found again, built anew when damaged, never half written; one sentence when it cannot be."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from zeggs_jax.nn import native

CHECK = """
import jax.numpy as jnp, numpy as np
from zeggs_jax.nn import native, reduced
assert native.problem() is None, native.problem()
rng = np.random.default_rng(0)
for rows, columns in ((1, 1), (9, 130), (33, 257)):
    for kind in ("bfloat16", "int8"):
        weight = reduced.reduce(rng.normal(size=(rows, columns)).astype(np.float32), kind)
        x = rng.normal(size=(columns, 3)).astype(np.float32)
        expected = np.asarray(reduced.restore(weight), np.float64) @ x
        np.testing.assert_allclose(reduced.product(weight, jnp.asarray(x)), expected, atol=1e-4)
"""


@pytest.fixture
def compiled(monkeypatch):
    """The commands that were run, by a compiler that writes down its words."""
    commands = []

    def compile_(command):
        commands.append(command)
        Path(command[-1]).write_bytes(repr(command[:-1]).encode())

    monkeypatch.setattr(native, "_compile", compile_)
    monkeypatch.setattr(native, "find_compiler", lambda: [sys.executable])
    return commands


@pytest.fixture
def asked_anew():
    native.problem.cache_clear()
    yield
    native.problem.cache_clear()


def test_what_is_built_is_found_again(compiled, tmp_path):
    first = native.library(tmp_path / "new")
    assert native.library(tmp_path / "new") == first
    assert len(compiled) == 1
    assert [path.name for path in first.parent.iterdir()] == [first.name]


@pytest.mark.parametrize("damage", [b"", b"\x7fELF, and no more", None])
def test_a_damaged_library_is_built_anew(compiled, tmp_path, damage):
    path = native.library(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if damage is None else damage)
    assert native.library(tmp_path).read_bytes() == whole
    assert len(compiled) == 2
    assert len(list(tmp_path.iterdir())) == 1


def test_another_source_compiler_machine_or_jaxlib_has_another_library(compiled, tmp_path, monkeypatch):
    made = [native.library(tmp_path)]
    source = tmp_path / "gemv.cc"
    source.write_text("another")
    changes = (
        ("SOURCE", source),
        ("find_compiler", lambda: [sys.executable, "-O0"]),
        ("_instructions", lambda: "fewer"),
        ("version", lambda name: "0"),
    )
    for name, other in changes:
        with monkeypatch.context() as patch:
            patch.setattr(native, name, other)
            made.append(native.library(tmp_path))
    assert len({path.name.split("-")[1] for path in made}) == len(compiled) == 5
    assert native.library(tmp_path) == made[0]
    assert len(compiled) == 5


def test_only_a_known_machine_is_compiled_for(compiled, tmp_path, monkeypatch):
    for known in ("avx2 fma", ""):
        monkeypatch.setattr(native, "_instructions", lambda known=known: known)
        native.library(tmp_path)
    assert ["-march=native" in command for command in compiled] == [True, False]


def test_several_may_build_at_once(compiled, tmp_path):
    with ThreadPoolExecutor(8) as pool:
        paths = set(pool.map(native.library, [tmp_path] * 16))
    assert len(paths) == 1
    assert list(tmp_path.iterdir()) == [paths.pop()]


def test_the_compiler_is_the_one_in_cxx(monkeypatch):
    monkeypatch.setenv("CXX", f"{sys.executable} -m something")
    assert native.find_compiler() == [sys.executable, "-m", "something"]
    monkeypatch.setenv("CXX", "no-such-compiler")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(OSError, match="no C\\+\\+ compiler was found"):
        native.find_compiler()


def test_a_build_that_fails_is_told_in_one_sentence(asked_anew, monkeypatch, tmp_path):
    script = tmp_path / "compiler"
    script.write_text("#!/bin/sh\necho 'gemv.cc:1: error: not today' >&2\nexit 1\n")
    script.chmod(0o755)
    monkeypatch.setenv("CXX", str(script))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert "error: not today" in native.problem()
    assert "\n" not in native.problem()
    assert list((tmp_path / "cache" / "zeggs-jax").iterdir()) == []


def test_no_room_is_told_in_one_sentence(asked_anew, compiled, monkeypatch, tmp_path):
    (tmp_path / "zeggs-jax").write_text("a file where the folder should be")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert "zeggs-jax" in native.problem()
    assert not compiled


def test_nothing_is_built_at_import(tmp_path):
    code = "import zeggs_jax.nn.reduced"
    subprocess.run([sys.executable, "-c", code], env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)}, check=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("without", ["", "-mno-avx512vnni -mno-avxvnni", "-mno-avx512f", "-mno-avx2 -mno-avx"])
def test_fewer_instructions_give_the_same_numbers(tmp_path, without):
    if native.problem():
        pytest.skip(native.problem())
    compiler = " ".join([*native.find_compiler(), without])
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "CXX": compiler}
    subprocess.run([sys.executable, "-c", CHECK], env=environment, check=True)
