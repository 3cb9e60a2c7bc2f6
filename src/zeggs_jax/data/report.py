"""What became of a corpus, in a few lines, and in a file every clip that cannot be used and why."""

import json
import os
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from zeggs_jax.data import body
from zeggs_jax.data.entry import Problem
from zeggs_jax.data.prepared import Prepared
from zeggs_jax.motion import bvh

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


def told(made: Prepared) -> str:
    """What lies in a folder of arrays: how much of what, how its body was read, whether it can be mirrored."""
    splits, styles = Counter(made.splits), Counter(made.styles[label] for label in made.labels)
    seconds = len(made.pose) * made.frame_time
    length = f"{seconds / 60:.1f} minutes" if seconds >= 60 else f"{seconds:.1f} seconds"
    if made.pipeline == "as released":
        mirror = "no, as released"
    else:
        mirror = "yes" if made.across else "no, left and right joints are not known by name or not alike"
    lines = [
        f"{_clips(len(made.names))} ({splits['train']} to train, {splits['valid']} to validate), {length} at "
        f"{bvh.rate_hz(made.frame_time):g} frames a second, {made.pipeline}",
        "styles: " + ", ".join(f"{style} {count}" for style, count in styles.items()),
        f"body: {len(made.skeleton)} joints, about {body.height(made.skeleton):.0f} cm tall; files read as "
        + body.describe(made.body or body.BodyConfig()),
        f"mirrored in training: {mirror}",
    ]
    try:
        count = len(json.loads((made.folder / REPORT).read_text(encoding="utf-8"))["problems"])
    except (OSError, ValueError, KeyError):
        count = 0
    if count:
        lines.append(f"left out: {_clips(count)}, with reasons in {made.folder / REPORT}")
    return "\n  ".join(lines)


def _clips(count: int) -> str:
    return "1 clip" if count == 1 else f"{count} clips"
