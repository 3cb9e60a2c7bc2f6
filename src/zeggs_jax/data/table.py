"""CSV tables of a corpus: their rows as dicts, one sentence where the table or a line of it does not read."""

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Row:
    """A line of a table; what it lacks, or has not at all, is an empty text; row[column] is a cell."""

    line: int
    cells: dict[str, str]
    missing: str  # the first needed column that the line does not fill, or ""

    def __getitem__(self, column: str) -> str:
        return self.cells[column]


def read(path: Path, columns: Iterable[str]) -> list[Row]:
    """The lines of a CSV file that has at least these columns; ValueError or OSError where it does not read."""
    columns = tuple(columns)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            found = [(reader.line_num, row) for row in reader]
            names = [name.strip() for name in reader.fieldnames or ()]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"'{path}' is not a CSV file ({error}); save it as UTF-8 text.") from error
    absent = [column for column in columns if column not in names]
    if absent:
        raise ValueError(f"'{path}' has no column '{absent[0]}'; it needs {', '.join(columns)}.")
    rows = []
    for line, row in found:
        cells = {key.strip(): (value or "").strip() for key, value in row.items() if isinstance(key, str)}
        rows.append(Row(line, cells, next((column for column in columns if not cells[column]), "")))
    return rows
