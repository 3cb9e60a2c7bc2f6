"""Read a folder of golden vectors and compare our numbers with it, one row per quantity."""

import json
import math
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


class Row(NamedTuple):
    """One compared quantity: passes when `error <= allowed` (a NaN error never passes)."""

    stage: str
    name: str
    error: float
    allowed: float

    @property
    def passed(self) -> bool:
        return bool(self.error <= self.allowed)


def read_case(folder: Path) -> dict[str, Any]:
    """The folder's case.json."""
    return json.loads((folder / "case.json").read_text())


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of one .npz, by key."""
    with np.load(path, allow_pickle=False) as archive:
        return {key: archive[key] for key in archive.files}


def present_files(folder: Path, case: dict[str, Any]) -> list[str]:
    """The files of case.json that the folder has; a ValueError when it has none of them."""
    present = [file for file in case["files"] if (folder / file).exists()]
    if not present:
        raise ValueError(f"'{folder}' holds none of the files that its case.json describes.")
    return present


def meta(case: dict[str, Any], file: str, key: str) -> dict[str, Any]:
    """What case.json says of array `key` in `file`."""
    return case["files"][file]["arrays"][key]


def allowed(case: dict[str, Any], file: str, key: str) -> float:
    """The set's own tolerance for array `key` (absolute)."""
    return float(meta(case, file, key)["f32_vs_f64"]["suggested_atol"])


def max_error(ours: Any, expected: Any) -> float:
    """Largest absolute difference; infinite when the shapes differ, NaN only where both are NaN counts 0."""
    a, b = np.asarray(ours, np.float64), np.asarray(expected, np.float64)
    if a.shape != b.shape:
        return math.inf
    both_nan = np.isnan(a) & np.isnan(b)
    difference = np.where(both_nan, 0.0, np.abs(a - b))
    return float(difference.max(initial=0.0))


def compare(stage: str, case: dict[str, Any], file: str, key: str, ours: Any, expected: Any) -> Row:
    """A row for array `key` of `file`, at the tolerance that the set suggests."""
    return Row(stage, f"{file.removesuffix('.npz')}/{key}", max_error(ours, expected), allowed(case, file, key))


def recipe(name: str, shape: tuple[int, ...], seed: int, gain: float = 1.0) -> np.ndarray:
    """One parameter of the golden set's formula weights, float32, from its state_dict name."""
    draw = np.random.Generator(np.random.PCG64(zlib.crc32(name.encode()) + seed))
    z = draw.standard_normal(shape).astype(np.float32)
    if len(shape) >= 2:
        offset, scale = 0.0, gain / math.sqrt(float(np.prod(shape[1:])))
    elif name.endswith(".weight"):
        offset, scale = 1.0, 0.1
    else:
        offset, scale = 0.0, 0.05
    return np.float32(offset) + np.float32(scale) * z
