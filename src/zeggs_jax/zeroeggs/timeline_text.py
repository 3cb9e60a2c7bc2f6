"""Timelines as text: cues in a JSON or CSV file, mixes of styles such as "0.3 old + 0.7 happy"."""

import csv
import difflib
import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

Entry = dict[str, Any]  # one cue as a JSON object: time, style (a name or {name: weight}), ...
KEYS = ("time", "style", "transition", "curve", "intensity")  # of an entry; the columns of a CSV


def mix_of(text: str) -> dict[str, float]:
    """Styles and weights from "old" (weight 1) or "0.3 old + 0.7 happy"; names may hold blanks, but no " + ".

    Raises:
        ValueError: an empty part, a style that comes twice, or two parts or more of which one has no weight.
    """
    parts = [part.strip() for part in f" {text} ".split(" + ")]
    mix: dict[str, float] = {}
    for part in parts:
        first, _, rest = part.partition(" ")
        weight = _number(first)
        if weight is None and len(parts) == 1 and part:
            return {part: 1.0}
        if weight is None or not rest.strip():
            raise ValueError(f"'{text}' is no mix of styles; write '0.3 old + 0.7 happy', or the name of one style.")
        if rest.strip() in mix:
            raise ValueError(f"'{text}' has the style '{rest.strip()}' twice; name every style once.")
        mix[rest.strip()] = weight
    return mix


def text_of(mix: Mapping[str, float]) -> str:
    """The text that `mix_of` reads as this mix; a ValueError for names that text cannot hold."""
    name, full = next(iter(mix)), " + ".join(f"{weight!r} {name}" for name, weight in mix.items())
    for text in (name, full) if list(mix.values()) == [1.0] else (full,):
        try:
            if mix_of(text) == dict(mix):
                return text
        except ValueError:
            continue
    raise ValueError(f"the styles {list(mix)} cannot be written as 'a + b'; save the timeline as .json.")


def load(path: Path) -> list[tuple[str, Entry]]:
    """(where it stands, entry) of every cue of a .json or .csv file, keys checked, values as they came.

    Raises:
        ValueError, OSError: no such file, another ending, not JSON or CSV, unknown or missing keys, no cues.
    """
    if path.suffix.lower() not in (".json", ".csv"):
        raise ValueError(f"'{path}' is no timeline; give a file that ends in .json or .csv.")
    if not path.is_file():
        raise FileNotFoundError(f"timeline '{path}' does not exist; give a .json or .csv file with cues.")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"timeline '{path.name}' is not text in UTF-8; save it as UTF-8.") from error
    found = (_from_csv if path.suffix.lower() == ".csv" else _from_json)(text, path.name)
    if not found:
        raise ValueError(f"timeline '{path.name}' has no cues; give at least one, at time 0.")
    for where, entry in found:
        for key in entry:
            if key not in KEYS:
                near = difflib.get_close_matches(key, KEYS, n=1, cutoff=0.0)[0]
                raise ValueError(f"{where} has an unknown key '{key}'; the nearest known one is '{near}'.")
        for key in ("time", "style"):
            if key not in entry:
                raise ValueError(f"{where} has no {key}; every cue needs a time in seconds and a style.")
    return found


def _from_json(text: str, name: str) -> list[tuple[str, Entry]]:
    try:
        data = json.loads(text, object_pairs_hook=_once, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"timeline '{name}' is not JSON of the form {{\"cues\": [...]}} ({error}).") from error
    if not isinstance(data, dict) or set(data) != {"cues"} or not isinstance(data["cues"], list):
        keys = f"the keys {', '.join(map(repr, data)) or 'none'}" if isinstance(data, dict) else type(data).__name__
        raise ValueError(f"timeline '{name}' holds {keys}; expected {{\"cues\": [...]}}.")
    for k, entry in enumerate(data["cues"], 1):
        if not isinstance(entry, dict):
            raise ValueError(f'cue {k} of timeline \'{name}\' is {entry!r}; expected {{"time": 0, "style": "old"}}.')
    return [(f"cue {k} of timeline '{name}'", entry) for k, entry in enumerate(data["cues"], 1)]


def _from_csv(text: str, name: str) -> list[tuple[str, Entry]]:
    try:
        reader = csv.reader(io.StringIO(text), skipinitialspace=True, strict=True)
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except csv.Error as error:
        raise ValueError(f"timeline '{name}' is not comma-separated text ({error}).") from error
    rows = [(line, row) for line, row in rows if any(row)]
    if not rows:
        return []
    head = rows[0][1]
    if wrong := [column for column in head if column not in KEYS or head.count(column) > 1]:
        raise ValueError(f"timeline '{name}' has the column '{wrong[0]}'; expected {', '.join(KEYS)}, each once.")
    found = []
    for line, row in rows[1:]:
        where = f"line {line} of timeline '{name}'"
        if len(row) > len(head):
            raise ValueError(f"{where} has {len(row)} cells for {len(head)} columns; leave the others out.")
        found.append((where, {key: _cell(key, cell, where) for key, cell in zip(head, row, strict=False) if cell}))
    return found


def _cell(key: str, cell: str, where: str) -> Any:
    try:
        if key == "style":
            return mix_of(cell)
        return cell if key == "curve" else float(cell)
    except ValueError as error:
        told = str(error) if key == "style" else f"the {key} '{cell}' is no number."
        raise ValueError(f"{where}: {told}") from error


def save(path: Path, entries: Sequence[Entry]) -> None:
    """Writes entries as JSON or CSV, as the path's ending says; whole or not at all.

    Raises:
        ValueError: another ending, or a mix that a CSV cell cannot hold.
    """
    kind = path.suffix.lower()
    if kind not in (".json", ".csv"):
        raise ValueError(f"'{path}' is no name for a timeline; give one that ends in .json or .csv.")
    text = _csv(entries) if kind == ".csv" else json.dumps({"cues": list(entries)}, indent=1, ensure_ascii=False) + "\n"
    temporary = path.with_name(f".{path.name}.part")
    try:
        temporary.write_text(text, encoding="utf-8")
        os.replace(temporary, path)
    except OSError as error:
        raise OSError(
            f"cannot write timeline '{path}' ({error.strerror}); choose a folder that is writable."
        ) from error


def _csv(entries: Sequence[Entry]) -> str:
    columns = [key for key in KEYS if any(key in entry for entry in entries)]
    file = io.StringIO()
    table = csv.DictWriter(file, columns, lineterminator="\n")
    table.writeheader()
    for entry in entries:
        style = entry["style"]
        table.writerow(entry | {"style": text_of(style if isinstance(style, dict) else {style: 1.0})})
    return file.getvalue()


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _once(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key comes twice")
    return found


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number")
