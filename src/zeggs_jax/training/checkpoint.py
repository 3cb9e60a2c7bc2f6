"""Checkpoints: a pytree of arrays and its JSON metadata in one folder, written whole or not at all, verified when read.

PATH/arrays is an orbax checkpoint (nested dicts of the leaves); PATH/checkpoint.json holds the metadata, shape,
dtype and SHA-256 of every leaf under one digest, and the SHA-256 of every file of orbax, checked before it
reads them: a flipped bit is an error, never another network.
"""

import hashlib
import json
import logging
import os
import re
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

from . import devices

FORMAT = 1
MANIFEST = "checkpoint.json"
ARRAYS = "arrays"


def save(path: str | Path, tree: Any, metadata: Mapping[str, Any]) -> str:
    """Write `tree` (any pytree of arrays, dtypes kept) and JSON-able `metadata` to folder `path`; return its digest.

    The folder is made beside `path` and renamed into place, so a kill leaves the old checkpoint or the new one (between
    two renames the old one has a hidden name beside it). In a run of several processes all call this with the same
    arrays (replicated ones), in a folder that they share: the first writes, and when it returns, anywhere, the
    checkpoint is complete. OSError, everywhere, when it cannot be written: no room, no right.
    """
    path = Path(path).absolute()
    leaves = {name: np.asarray(leaf) for name, leaf in _named_leaves(tree).items()}
    for name, leaf in leaves.items():
        if leaf.size == 0:
            raise ValueError(f"checkpoint '{path}' cannot hold array '{name}' of shape {leaf.shape}: it is empty.")
    content = {
        "format": FORMAT,
        "metadata": dict(metadata),
        "leaves": {name: _fingerprint(leaf) for name, leaf in leaves.items()},
    }
    content["digest"] = _content_digest(content)
    devices.first_does(lambda: _write(path, leaves, content))
    return content["digest"]


def _write(path: Path, leaves: Mapping[str, np.ndarray], content: dict[str, Any]) -> None:
    """Make the folder beside `path`, orbax's part and the manifest, and rename it into place."""
    path.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        _write_arrays(work / ARRAYS, leaves)
        marker = work / ARRAYS / "commit_success.txt"
        if marker.exists():
            marker.write_text("committed\n")  # orbax writes the machine's path here, which nobody else should read
        content["files"] = {name: _sha256((work / ARRAYS / name).read_bytes()) for name in _files(work / ARRAYS)}
        (work / MANIFEST).write_text(json.dumps(content, indent=1, ensure_ascii=False), encoding="utf-8")
        work.chmod(0o755)
        _swap_in(work, path)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _write_arrays(folder: Path, leaves: Mapping[str, np.ndarray]) -> None:
    """Orbax's part; OSError, with the system's code where there is one, for all that it raises."""
    log = logging.getLogger("absl")  # where orbax's threads would print their stack traces
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with _orbax() as writer:
            writer.save(folder, _nest(leaves))
    except OSError:
        raise
    except Exception as problem:
        if code := re.search(r"os_error_code='(\d+)'", str(problem)):
            raise OSError(int(code[1]), os.strerror(int(code[1])), str(folder)) from problem
        raise OSError(f"orbax cannot write '{folder}': {problem!r}.") from problem
    finally:
        log.setLevel(level)


def _orbax() -> Any:
    """Orbax's reader and writer for this process alone: the arrays are whole in each, so none waits for another."""
    import orbax.checkpoint as ocp  # slow to import: 0.3 s that nobody pays who only reads this file

    me = jax.process_index()
    alone = ocp.options.MultiprocessingOptions(
        primary_host=me, active_processes={me}, barrier_sync_key_prefix=f"process{me}"
    )
    return ocp.StandardCheckpointer(multiprocessing_options=alone)


def load(path: str | Path, template: Any = None) -> tuple[Any, dict[str, Any]]:
    """(tree of numpy arrays, metadata) of the checkpoint in folder `path`.

    Without `template` the tree is nested dicts with the stored dtypes. With one (arrays or ShapeDtypeStructs) it has
    the template's structure and its floating dtypes, and the first leaf that is missing, unknown or of another shape
    is an error. FileNotFoundError: no such folder; ValueError: not a checkpoint, damaged, or not of this template.
    """
    path = Path(path).absolute()
    content = _manifest(path)
    stored = _read_arrays(path, content)
    if template is None:
        return _nest(stored), content["metadata"]
    wanted = _named_leaves(template)
    check_leaves(path, {name: leaf.shape for name, leaf in stored.items()}, wanted)
    leaves = [_cast(stored[name], leaf.dtype) for name, leaf in wanted.items()]
    return jax.tree.unflatten(jax.tree.structure(template), leaves), content["metadata"]


def metadata(path: str | Path) -> dict[str, Any]:
    """The metadata alone, without reading an array; errors as in `load`."""
    return _manifest(Path(path).absolute())["metadata"]


def digest(path: str | Path) -> str:
    """SHA-256 (hex) of the checkpoint's content: metadata and, through hashes, all arrays; the same for a copy."""
    return _manifest(Path(path).absolute())["digest"]


def tree_digest(tree: Any) -> str:
    """SHA-256 (hex) of the names, shapes, dtypes and bytes of a pytree of arrays."""
    leaves = {name: _fingerprint(np.asarray(leaf)) for name, leaf in _named_leaves(tree).items()}
    return _sha256(json.dumps(leaves, sort_keys=True).encode())


def remove(path: str | Path) -> None:
    """Delete a checkpoint; a kill in between leaves a folder that no longer counts as one."""
    path = Path(path)
    (path / MANIFEST).unlink(missing_ok=True)
    shutil.rmtree(path, ignore_errors=True)


def is_checkpoint(path: str | Path) -> bool:
    """Whether folder `path` looks like a finished checkpoint (nothing is verified)."""
    return (Path(path) / MANIFEST).is_file()


def check_leaves(source: str | Path, shapes: Mapping[str, tuple[int, ...]], wanted: Mapping[str, Any]) -> None:
    """ValueError naming the first leaf of `wanted` that `shapes` lacks or has in another shape, or does not know."""
    for name, leaf in wanted.items():
        if name not in shapes:
            raise ValueError(f"checkpoint '{source}' has no array '{name}': it is of another model or config.")
        if tuple(shapes[name]) != tuple(leaf.shape):
            raise ValueError(
                f"checkpoint '{source}' has array '{name}' in shape {tuple(shapes[name])}, expected "
                f"{tuple(leaf.shape)}: it is of another model or config."
            )
    extra = next((name for name in shapes if name not in wanted), None)
    if extra is not None:
        raise ValueError(f"checkpoint '{source}' has array '{extra}', which this model lacks: it is of another config.")


def _named_leaves(tree: Any) -> dict[str, Any]:
    """Leaves by their path, its parts (keys, field names, indices) joined by '/'."""
    return {
        jax.tree_util.keystr(path, simple=True, separator="/"): leaf for path, leaf in jax.tree.leaves_with_path(tree)
    }


def _nest(leaves: Mapping[str, np.ndarray]) -> dict[str, Any]:
    root: dict[str, Any] = {}
    for name, leaf in leaves.items():
        *parents, last = name.split("/")
        node = root
        for parent in parents:
            node = node.setdefault(parent, {})
        node[last] = leaf
    return root


def _cast(leaf: np.ndarray, dtype: Any) -> np.ndarray:
    return leaf.astype(dtype) if np.issubdtype(leaf.dtype, np.floating) and leaf.dtype != dtype else leaf


def _fingerprint(leaf: np.ndarray) -> dict[str, Any]:
    data = np.ascontiguousarray(leaf).reshape(-1).view(np.uint8)
    return {"shape": list(leaf.shape), "dtype": str(leaf.dtype), "sha256": _sha256(data.data)}


def _sha256(data: bytes | memoryview) -> str:
    return hashlib.sha256(data).hexdigest()


def _files(folder: Path) -> list[str]:
    return sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())


def _content_digest(content: Mapping[str, Any]) -> str:
    """Hash of what was saved, without the names and bytes of orbax's files, which differ from one save to the next."""
    kept = {key: content[key] for key in ("format", "metadata", "leaves")}
    return _sha256(json.dumps(kept, sort_keys=True, separators=(",", ":")).encode())


def _manifest(path: Path) -> dict[str, Any]:
    """checkpoint.json, verified against its own hash."""
    if not path.exists():
        raise FileNotFoundError(f"checkpoint '{path}' does not exist.")
    if not is_checkpoint(path):
        raise ValueError(f"'{path}' is not a checkpoint: expected a folder with {MANIFEST} in it.")
    try:
        content = json.loads((path / MANIFEST).read_bytes().decode("utf-8"))
        intact = content["digest"] == _content_digest(content) and isinstance(content["files"], dict)
    except (ValueError, KeyError, TypeError):
        intact = False
    if not intact:
        raise ValueError(
            f"checkpoint '{path}' is damaged: {MANIFEST} does not match its own hash; take another copy of it."
        )
    if content["format"] != FORMAT:
        raise ValueError(
            f"checkpoint '{path}' has format {content['format']}, this version reads {FORMAT}: update zeggs-jax."
        )
    return content


def _read_arrays(path: Path, content: Mapping[str, Any]) -> dict[str, np.ndarray]:
    for name, expected in content["files"].items():
        file = path / ARRAYS / name
        if not file.is_file() or _sha256(file.read_bytes()) != expected:
            state = "changed on disk" if file.is_file() else "is missing"
            raise ValueError(f"checkpoint '{path}' is damaged: {ARRAYS}/{name} {state}; take another copy of it.")
    directly = _by_tensorstore(path / ARRAYS, content["leaves"])
    if directly is not None:
        return directly
    import orbax.checkpoint as ocp

    try:
        with _orbax() as reader:
            stored = _named_leaves(reader.restore(path / ARRAYS))
        return {name: np.asarray(stored[name]) for name in content["leaves"]}
    except Exception as problem:  # whatever orbax raises when it cannot read what it wrote, another version's for one
        raise ValueError(f"checkpoint '{path}' cannot be read by orbax {ocp.__version__}: {problem!r}.") from problem


def _by_tensorstore(folder: Path, leaves: Mapping[str, dict[str, Any]]) -> dict[str, np.ndarray] | None:
    """The arrays as orbax lays them out, read without it: half the time. None where they lie in another way."""
    try:
        import tensorstore

        base, context = {"driver": "file", "path": f"{folder}/"}, tensorstore.Context()
        stores = {name: {"driver": "ocdbt", "base": base, "path": name.replace("/", ".") + "/"} for name in leaves}
        opened = {
            name: tensorstore.open({"driver": "zarr", "kvstore": store}, open=True, read=True, context=context)
            for name, store in stores.items()
        }
        reading = {name: store.result().read() for name, store in opened.items()}
        found = {name: np.asarray(array.result()) for name, array in reading.items()}
    except Exception:  # whatever it is, orbax tells it better
        return None
    same = all((list(a.shape), str(a.dtype)) == (leaves[n]["shape"], leaves[n]["dtype"]) for n, a in found.items())
    return found if same else None


def _swap_in(work: Path, path: Path) -> None:
    """Rename `work` to `path`; an older checkpoint there is set aside first and removed last."""
    if not path.exists():
        os.rename(work, path)
        return
    if not (is_checkpoint(path) or (path.is_dir() and not any(path.iterdir()))):
        raise ValueError(f"'{path}' exists and is not a checkpoint: choose another place.")
    old = Path(tempfile.mkdtemp(prefix=f".{path.name}.old.", dir=path.parent))
    os.rename(path, old / "checkpoint")
    os.rename(work, path)
    shutil.rmtree(old, ignore_errors=True)
