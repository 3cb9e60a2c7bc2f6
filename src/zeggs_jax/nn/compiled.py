"""Compiled programs kept for later processes: JAX's persistent compilation cache, unless the user decided otherwise.

The command line and training call `keep`. It lies in the user's cache folder beside the kernel (`nn.native`); JAX's
keys tell apart versions and machines. JAX's own settings come first: JAX_COMPILATION_CACHE_DIR names another folder
(empty: none), JAX_ENABLE_COMPILATION_CACHE=false switches it off.
"""

import os
import tempfile
from pathlib import Path
from typing import Any

import jax

from .native import cache_folder

FOLDER = "compiled"
WORTH_KEEPING_S = 0.02  # of compilation; JAX's default of 1 s leaves out half of what a first gesture waits for


def keep() -> Path | None:
    """Keeps what is compiled from now on; the folder, or None where JAX is told otherwise or nothing can be kept.

    A folder that cannot be written (a home that is read-only) is no error and not told: all works, only slower.
    """
    config: Any = jax.config
    if config.jax_compilation_cache_dir is not None or "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return None
    if not config.jax_enable_compilation_cache:
        return None
    try:
        folder = cache_folder() / FOLDER
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        return None
    _write_whole()
    if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
        config.update("jax_persistent_cache_min_compile_time_secs", WORTH_KEEPING_S)
    config.update("jax_compilation_cache_dir", str(folder))
    return folder


def _write_whole() -> None:
    """Lets JAX's entries appear whole or not at all: it never replaces one that a killed process left half written.

    A JAX that has no such class any more keeps its own way of writing.
    """
    try:
        from jax._src.lru_cache import LRUCache
    except ImportError:
        return
    written = LRUCache.put
    if written.__module__ == __name__:
        return

    def put(self: Any, key: str, value: bytes) -> None:
        if self.eviction_enabled:  # then JAX holds a lock and counts the bytes
            return written(self, key, value)
        path = Path(self.path) / f"{key}-cache"
        with tempfile.TemporaryDirectory(dir=path.parent) as scratch:
            Path(scratch, path.name).write_bytes(value)
            os.replace(Path(scratch, path.name), path)

    LRUCache.put = put
