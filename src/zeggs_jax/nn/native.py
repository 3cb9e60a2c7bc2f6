"""The kernel of reduced weights, gemv.cc: compiled for this machine when it is first asked for, kept for later.

It lies in the user's cache folder under a name made of all it depends on (source, compiler, instructions of the CPU,
jaxlib) and of its own content, so that a library of another machine or a damaged one is never loaded. Nothing happens
at import. Where it cannot be had, `problem` says why in one sentence and the products are XLA's.
"""

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
from functools import cache
from importlib.metadata import version
from pathlib import Path

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

SOURCE = Path(__file__).with_name("gemv.cc")
MOST_COLUMNS = 1 << 16  # kMostColumns of gemv.cc
FLAGS = ("-O3", "-std=c++17", "-shared", "-fPIC", "-pthread", "-ffp-contract=fast", "-DNDEBUG", "-w")
PATIENCE_S = 300.0


@cache
def problem() -> str | None:
    """Why this process has no kernel, in one sentence; None when it has one, which the first call may have to build."""
    if jax.default_backend() != "cpu":
        return f"weights of fewer bytes are for CPUs and JAX runs on {jax.default_backend()}: float32 is used."
    try:
        _register(library(cache_folder()))
    except (OSError, ValueError) as error:
        return f"the kernel for weights of fewer bytes cannot be had ({error}): they are as slow as float32."
    return None


def multiplies_bfloat16() -> bool:
    """Whether the CPU has instructions for products of bfloat16."""
    return not {"amx_bf16", "avx512_bf16"}.isdisjoint(_instructions().split())


def call(target: str, weight: Array, *arrays: Array) -> Float[Array, "N B"]:
    """The kernel's product 'bfloat16' (weight, x) or 'int8' (weight, scale, x), x [K, B]; only without a `problem`."""
    shape = jax.ShapeDtypeStruct((weight.shape[0], arrays[-1].shape[1]), jnp.float32)
    return jax.ffi.ffi_call(_target(target), shape, vmap_method="expand_dims")(weight, *arrays)


def cache_folder() -> Path:
    """Where built libraries are kept: $XDG_CACHE_HOME/zeggs-jax, by default ~/.cache/zeggs-jax."""
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError as error:
        raise OSError("no home folder; set XDG_CACHE_HOME") from error
    return home / "zeggs-jax"


def library(folder: Path) -> Path:
    """The built kernel in `folder`: found there whole, or built now. OSError: no compiler, failed build, no room."""
    compiler = find_compiler()
    key = _digest(SOURCE.read_bytes(), repr(_build(compiler)).encode(), _instructions().encode())
    for path in sorted(folder.glob(f"gemv-{key}-*.so")):
        if path.stem.endswith(_digest(path.read_bytes())):
            return path
        path.unlink(missing_ok=True)
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        built = Path(scratch) / "gemv.so"
        _compile([*compiler, *_flags(), "-I", jax.ffi.include_dir(), str(SOURCE), "-o", str(built)])
        path = folder / f"gemv-{key}-{_digest(built.read_bytes())}.so"
        os.replace(built, path)
    return path


def find_compiler() -> list[str]:
    """The words of $CXX, else the first of c++, g++ and clang++ on the PATH; an OSError when there is none."""
    for words in (shlex.split(os.environ.get("CXX", "")), ["c++"], ["g++"], ["clang++"]):
        if words and (found := shutil.which(words[0])):
            return [found, *words[1:]]
    raise OSError("no C++ compiler was found: install g++ or clang++, or name one in CXX")


def _compile(command: list[str]) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    except subprocess.TimeoutExpired as error:
        raise OSError(f"{command[0]} took longer than {PATIENCE_S:g} s") from error
    if done.returncode:
        said = next((line for line in done.stderr.splitlines() if "error" in line), "no message")
        raise OSError(f"{command[0]} failed: {said.strip()[:200]}")


def _build(compiler: list[str]) -> tuple[object, ...]:
    """What the library depends on beside its source: the compiler, file and words, its flags, jaxlib's headers."""
    status = os.stat(compiler[0])
    return (*compiler, status.st_size, status.st_mtime_ns, *_flags(), version("jaxlib"))


def _flags() -> tuple[str, ...]:
    return (*FLAGS, "-march=native") if _instructions() else FLAGS


@cache
def _instructions() -> str:
    """An x86 CPU's instruction sets as Linux lists them; elsewhere empty: then the library asks for none."""
    if platform.machine() != "x86_64":
        return ""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return ""
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("flags")), "")


def _digest(*contents: bytes) -> str:
    return hashlib.sha256(b"\0".join(contents)).hexdigest()[:16]


@cache
def _register(path: Path) -> None:
    loaded = ctypes.CDLL(str(path))
    for name in ("bfloat16", "int8"):
        jax.ffi.register_ffi_target(_target(name), jax.ffi.pycapsule(loaded[f"zeggs_{name}"]), platform="cpu")


@cache
def _target(name: str) -> str:
    """XLA's name of a product; with the source's digest, that a cached executable never meets another source."""
    return f"zeggs_{name}_{_digest(SOURCE.read_bytes())}"
