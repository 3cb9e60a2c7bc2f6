"""What a run does not check, by name: a stage that skips something says so here, so no skip looks like a success."""

from pathlib import Path
from typing import NamedTuple

from .golden import read_case


class LeftOut(NamedTuple):
    """One thing that was not compared."""

    stage: str
    name: str
    why: str


_KEPT: list[LeftOut] = []


def leave_out(stage: str, name: str, why: str) -> None:
    """Note that `name` of `stage` is not compared."""
    entry = LeftOut(stage, name, why)
    if entry not in _KEPT:
        _KEPT.append(entry)


def take() -> list[LeftOut]:
    """All that was left out since the last call."""
    taken = list(_KEPT)
    _KEPT.clear()
    return taken


def absent_files(golden: Path, stage: str) -> None:
    """Note the files that the stage's case.json describes and the set does not hold."""
    folder = golden / stage
    for file in read_case(folder).get("files", {}) if (folder / "case.json").is_file() else ():
        if not (folder / file).exists():
            leave_out(stage, file, "not in this set")


def other_stages(golden: Path, known: tuple[str, ...]) -> None:
    """Note the folders with a case.json that no stage is named after."""
    for path in sorted(golden.glob("*/case.json")):
        if path.parent.name not in known:
            leave_out(path.parent.name, "all", "no stage of this name")
