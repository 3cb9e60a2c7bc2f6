"""The checkpoints of a run and which of them stay: the newest, every so many updates, and the best.

RUN/checkpoints/step_00005000 is the state after 5,000 updates; RUN/checkpoints/best the one with the lowest validation
loss.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import checkpoint, devices

BEST = "best"


def checkpoints(run: str | Path) -> list[Path]:
    """Finished checkpoints of a run, oldest first, without the best."""
    found = (Path(run) / "checkpoints").glob("step_*")
    return sorted(path for path in found if checkpoint.is_checkpoint(path))


def numbered(run: Path, step: int) -> Path:
    """Where the state after `step` updates is kept."""
    return run / "checkpoints" / f"step_{step:08d}"


def best(run: Path) -> Path:
    """Where the state with the lowest validation loss is kept."""
    return run / "checkpoints" / BEST


def write(path: Path, state: Any, save: Callable[[Path, Any], Any]) -> None:
    """`save` a state; OSError that names the last good checkpoint when there is no room or right to write."""
    try:
        save(path, state)
    except OSError as error:
        raise OSError(
            f"checkpoint '{path}' cannot be written ({error.strerror or error}); {last_good(path.parents[1])}; make "
            "room or give the rights, and run the same command again."
        ) from error


def prune(run: Path, keep: int, keep_every: int = 0) -> None:
    """Remove all but the `keep` newest checkpoints and those of multiples of `keep_every` (0: none); not the best.

    What kills left half written goes too: to be called while no checkpoint is being written.
    """
    if not devices.first():
        return
    for unfinished in (run / "checkpoints").glob(".step_*"):
        checkpoint.remove(unfinished)
    for old in checkpoints(run)[: -max(keep, 1)]:
        if not keep_every or int(old.name.removeprefix("step_")) % keep_every:
            checkpoint.remove(old)


def last_good(run: Path) -> str:
    """Half a sentence for messages: which checkpoint a run can go on from."""
    found = checkpoints(run)
    return f"the last good checkpoint is '{found[-1]}'" if found else "there is no checkpoint yet"
