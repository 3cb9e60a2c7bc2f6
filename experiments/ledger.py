"""Rows of an experiment in a file of JSON lines, one for each job, so that a stopped experiment goes on; and tables."""

import argparse
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

Row = dict[str, Any]
Jobs = Mapping[str, Callable[[], Row]]


def read(path: Path) -> dict[str, Row]:
    """Finished rows by the name of their job; a line that a kill cut off is left out."""
    rows: dict[str, Row] = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        rows[row["job"]] = row
    return rows


def fill(path: Path, jobs: Jobs, what: str) -> list[Row]:
    """The rows of all jobs, in their order; only those that the file lacks are done, each written when it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    done = read(path)
    if path.exists() and not path.read_bytes().endswith(b"\n"):
        with path.open("a") as file:
            file.write("\n")
    for job in tqdm([job for job in jobs if job not in done], desc=what, unit="job"):
        row = {"job": job, **jobs[job]()}
        with path.open("a") as file:  # one write a line: two processes may share the file
            file.write(json.dumps(row) + "\n")
        done[job] = row
    return [done[job] for job in jobs]


def grouped(rows: Iterable[Row], by: str) -> dict[str, list[Row]]:
    """Rows by the value of a column, in the order of their first appearance."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row[by], []).append(row)
    return groups


def mean(rows: Sequence[Row], column: str) -> float:
    """Mean of a column over the rows that have it; NaN when none has."""
    values = [row[column] for row in rows if row.get(column) is not None]
    return float(np.mean(values)) if values else float("nan")


def spread(rows: Sequence[Row], column: str) -> float:
    """Half the range of a column: what two or three seeds differ by."""
    values = [row[column] for row in rows if row.get(column) is not None]
    return 0.5 * float(np.ptp(values)) if values else float("nan")


def by_seeds(what: str, rows: Iterable[Row], columns: Sequence[tuple[str, str, str]]) -> str:
    """A line for each `name` of the rows: every (column, title, format), with its spread where there are two seeds."""
    body = []
    for name, of in grouped(rows, "name").items():
        apart = [f" ± {form.format(spread(of, column))}" if len(of) > 1 else "" for column, _, form in columns]
        cells = [form.format(mean(of, column)) + more for (column, _, form), more in zip(columns, apart, strict=True)]
        body.append([name, str(len(of)), *cells])
    return table([what, "seeds", *(title for _, title, _ in columns)], body)


def table(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def save(path: Path, content: Any) -> None:
    """Write JSON, whole or not at all."""
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(json.dumps(content, indent=1) + "\n")
    partial.replace(path)
    print(f"wrote {path}")


def add_docs(parser: argparse.ArgumentParser) -> None:
    """The argument of an experiment that can write its table into a document."""
    parser.add_argument("--docs", type=Path, help="Markdown with two lines <!-- NAME OF THE SCRIPT -->: what to renew")


def tell(text: str, name: str, docs: Path | None) -> None:
    """Prints a text, and puts it between the marks of a document where one is given."""
    print(text, flush=True)
    if docs is not None:
        renew(docs, name, text)


def renew(path: Path, name: str, text: str) -> None:
    """Puts `text` between the two lines <!-- NAME --> of a Markdown file; ValueError where they are not there."""
    mark = f"<!-- {name} -->\n"
    parts = path.read_text().split(mark)
    if len(parts) != 3:
        raise ValueError(f"'{path}' has {len(parts) - 1} lines '{mark.strip()}'; put two, one before and one after.")
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(mark.join((parts[0], f"{text.strip()}\n", parts[2])))
    partial.replace(path)
    print(f"renewed {path}")
