"""Arrays on disk: a .npy file that grows clip by clip, and its rows read back one clip at a time."""

import hashlib
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from jaxtyping import Float32

Span = tuple[int, int]


class ArrayFile:
    """A float32 .npy file that grows along its first axis; complete and under its own name after its `with` block."""

    def __init__(self, path: Path) -> None:
        self.path, self.rows, self.width, self.digest = path, 0, 0, hashlib.sha256()
        self.file = path.with_name(f"{path.name}.partial").open("wb")

    def __enter__(self) -> "ArrayFile":
        return self

    def append(self, rows: Float32[np.ndarray, "T n"]) -> Span:
        """Write rows behind those that are there; from which row to which they now lie."""
        if self.rows == 0:
            self.width = rows.shape[1]
            self._write_header()
        data = np.ascontiguousarray(rows, "<f4").data
        self.file.write(data)
        self.digest.update(data)
        self.rows += len(rows)
        return self.rows - len(rows), self.rows

    def __exit__(self, failed: type | None, *_: object) -> None:
        try:
            if failed is None:
                self._write_header()
                self.file.close()
                os.replace(self.file.name, self.path)
        finally:
            with suppress(OSError):  # what a full disk could not take
                self.file.close()
            Path(self.file.name).unlink(missing_ok=True)

    def _write_header(self) -> None:
        """NumPy leaves room for the first axis to grow, so the last header fits in the place of the first."""
        self.file.seek(0)
        header = {"descr": "<f4", "fortran_order": False, "shape": (self.rows, self.width)}
        np.lib.format.write_array_header_1_0(self.file, header)


class Blocks(Sequence[np.ndarray]):
    """Some spans of rows of a .npy file, each read when it is asked for and kept by nobody."""

    def __init__(self, path: Path, spans: Sequence[Span]) -> None:
        self.path, self.spans = path, spans

    def __len__(self) -> int:
        return len(self.spans)

    def __getitem__(self, number: int) -> Float32[np.ndarray, "T n"]:
        start, stop = self.spans[number]
        return np.array(np.load(self.path, mmap_mode="r")[start:stop])
