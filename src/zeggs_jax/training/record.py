"""What a run writes down: log.jsonl (updates), valid.jsonl (validations) and the same numbers for TensorBoard.

A run that goes on from update `start` drops the lines of what it does again, so that the files are those of a run that
was never stopped.
"""

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

LOG, VALID, TENSORBOARD = "log.jsonl", "valid.jsonl", "tensorboard"
RECENT = 50  # log lines that are kept in mind
TIMING = ("speed", "wait")  # of a log line: updates a second and the share of time that they waited for batches


class Records:
    """The files of one run, open for appending within a `with` block; a process that does not write keeps them in mind.

    A line of log.jsonl is {"step": updates done before, "loss", terms...}; one of valid.jsonl {"step": updates done,
    "loss", ...}. Numbers that are not finite are null.
    """

    def __init__(self, run: Path, start: int, write: bool = True) -> None:
        self.log: list[dict[str, Any]] = []  # the newest lines
        self.valid: list[dict[str, Any]] = []  # all lines
        self._run, self._start, self._write = run, start, write
        self._files: dict[str, Any] = {}
        self._board: Any = None

    def __enter__(self) -> "Records":
        log = [line for line in read_log(self._run / LOG) if line["step"] < self._start]
        self.valid = [line for line in read_log(self._run / VALID) if line["step"] <= self._start]
        if self._write:
            self._files = {LOG: _reopen(self._run / LOG, log), VALID: _reopen(self._run / VALID, self.valid)}
            self._board = _board(self._run / TENSORBOARD, self._start)
        self.log = log[-RECENT:]
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for file in self._files.values():
            file.close()
        if self._board is not None:
            self._board.close()

    def update(self, step: int, values: Mapping[str, float]) -> None:
        """Write down update `step`."""
        self.log = [*self.log[1 - RECENT :], self._add(LOG, "train", step, values)]

    def validation(self, step: int, values: Mapping[str, float]) -> None:
        """Write down a validation after `step` updates."""
        self.valid.append(self._add(VALID, "valid", step, values))

    def validated(self, step: int) -> bool:
        """Whether the validation after `step` updates is written down."""
        return any(line["step"] == step for line in self.valid)

    def is_best(self, values: Mapping[str, float]) -> bool:
        """Whether this validation's loss is finite and below all others' over as many clips."""
        if not math.isfinite(values["loss"]):
            return False
        others = [line["loss"] for line in self.valid if line.get("clips") == values.get("clips")]
        return all(loss is None or values["loss"] < loss for loss in others)

    def _add(self, name: str, group: str, step: int, values: Mapping[str, float]) -> dict[str, Any]:
        finite = {key: value if math.isfinite(value) else None for key, value in values.items()}
        line = {"step": step, "loss": finite.get("loss")} | finite
        if self._write:
            try:
                self._files[name].write(json.dumps(line) + "\n")
                self._files[name].flush()
            except OSError as error:
                path = self._run / name
                raise OSError(f"'{path}' cannot be written ({error.strerror}); make room and run again.") from error
            for key, value in values.items():
                self._board.add_scalar(f"{group}/{key}", value, step)
        return line


def read_log(path: str | Path) -> Iterator[dict[str, Any]]:
    """The lines of a log that may not exist; one that a kill cut off in the middle is left out."""
    path = Path(path)
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            yield json.loads(line)
        except ValueError:
            continue


def _reopen(path: Path, lines: list[dict[str, Any]]) -> Any:
    """The file with just these lines, open for appending."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text("".join(json.dumps(line) + "\n" for line in lines))
    partial.replace(path)
    return path.open("a")


def _board(folder: Path, start: int) -> Any:
    """TensorBoard's writer; what earlier sittings wrote from update `start` on is hidden."""
    from tensorboardX import SummaryWriter  # slow to import

    return SummaryWriter(str(folder), purge_step=start, flush_secs=10)
