"""What is wrong with a corpus: every clip that cannot be used and why, in a file and in a few lines."""

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from zeggs_jax.data.entry import Problem

REPORT = "report.json"
SHOWN = 10


def write(out: Path, used: int, problems: Sequence[Problem]) -> Path:
    """OUT/report.json: how many clips can be used, and the name of and reason for each that cannot."""
    content = {"used": used, "problems": [problem._asdict() for problem in problems]}
    path = out / REPORT
    partial = path.with_name(f"{path.name}.partial")
    partial.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    os.replace(partial, path)
    return path


def summary(problems: Sequence[Problem]) -> str:
    """One line for each of the first problems, and how many more there are."""
    lines = [f"  {problem.name}: {problem.reason}" for problem in problems[:SHOWN]]
    more = len(problems) - SHOWN
    return "\n".join([*lines, f"  and {more} more"] if more > 0 else lines)


def settle(out: Path, used: int, problems: Sequence[Problem], skip_bad: bool) -> None:
    """Write the report; where something is wrong, say so on stderr, and raise ValueError unless `skip_bad`.

    ValueError also where nothing is left to use.
    """
    path = write(out, used, problems)
    if not problems:
        return
    what = f"{len(problems)} of {used + len(problems)} clips cannot be used"
    first = f"the first, {problems[0].name}: {problems[0].reason.rstrip('.')}"
    if skip_bad and used:
        print(f"{what} and are left out ('{path}'):\n{summary(problems)}", file=sys.stderr)
    elif used:
        if len(problems) > 1:
            print(f"{what}:\n{summary(problems)}", file=sys.stderr)
        raise ValueError(f"{what} ({first}); mend them (all are in '{path}') or leave them out with --skip-bad.")
    else:
        raise ValueError(f"No clip of the corpus can be used ({first}); all are in '{path}'.")
