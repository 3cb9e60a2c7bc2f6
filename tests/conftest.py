"""Settings of every test: no silent rank promotion, no GPU, no compile cache; files that are not in the repository."""

import os
import sys
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Tests compile much and compute little: without optimisation all of them take half the time.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true")
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    os.environ.setdefault("JAX_ENABLE_COMPILATION_CACHE", "false")  # nor would the command line switch one on

import jax
import pytest

jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder ZEGGS_SHARED with golden/, reference/ and data/ (recorded vectors, licensed files), or a skip."""
    folder = os.environ.get("ZEGGS_SHARED", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("needs the folder ZEGGS_SHARED (see CONTRIBUTING.md)")
    return Path(folder)


@pytest.fixture
def zeggs(monkeypatch, capsys):
    """Runs a command line; returns (exit status, what it printed, what it complained)."""

    from zeggs_jax import cli

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["zeggs", *map(str, words)])
        try:
            cli.main()
            status = 0
        except SystemExit as stop:
            status = stop.code
        told = capsys.readouterr()
        return status, told.out, told.err

    return run
