"""The clips of a corpus: pairs of motion and speech, their styles, their split, the release's time codes."""

import csv
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple

SPEECH_SUFFIXES = (".wav", ".flac", ".ogg")
RELEASE_COLUMNS = (
    "audio_filename", "audio_start_time", "anim_start_time", "acting_start_time", "acting_end_time",
    "style", "anim_bvh", "validation",
)  # fmt: skip
SPLITS = ("train", "valid")

Span = tuple[float, float]


class Sync(NamedTuple):
    """Where the acted part of a take lies in its two files, in seconds from the start of each."""

    audio_s: Span
    motion_s: Span
    speaking_s: tuple[Span, ...]  # of the whole audio file; everything else is silenced


class Entry(NamedTuple):
    """One take. Files are used whole when `sync` is None."""

    name: str
    bvh: Path
    wav: Path
    style: str
    split: Literal["train", "valid"]
    sync: Sync | None = None


def find(folder: str | Path) -> list[Entry]:
    """The takes of a folder, in a fixed order.

    Layouts: the ZEGGS download (`info.csv`, files beside it or in `original/`, each wav with a CSV of the
    speaker's regions); a `corpus.csv` with columns name,style,split (name.bvh and name.wav beside it,
    subfolders allowed); or pairs without a table, where the style is the name of the subfolder and the last
    of four or more clips of a style goes to validation. Raises FileNotFoundError for a missing folder or
    file, ValueError for a folder without pairs or a table that does not read.
    """
    folder = Path(folder)
    if folder.is_file():
        raise FileNotFoundError(f"Corpus '{folder}' is a file; a folder with name.bvh + name.wav was expected.")
    if not folder.is_dir():
        raise FileNotFoundError(f"Corpus folder '{folder}' does not exist; give one with name.bvh + name.wav.")
    if (folder / "info.csv").exists():
        entries = _released(folder)
    elif (folder / "corpus.csv").exists():
        entries = _listed(folder)
    else:
        entries = _scanned(folder)
    if not entries:
        raise ValueError(
            f"Corpus folder '{folder}' holds no pairs of name.bvh and name.wav; put both of each clip there."
        )
    twice = [name for name, count in Counter(entry.name for entry in entries).items() if count > 1]
    if twice:
        raise ValueError(f"Corpus '{folder}' lists '{twice[0]}' more than once; give each clip its own name.")
    return entries


def _released(folder: Path) -> list[Entry]:
    table = folder / "info.csv"
    original = folder / "original" if (folder / "original").is_dir() else folder
    entries = []
    for row in _rows(table, RELEASE_COLUMNS):
        bvh, wav = original / row["anim_bvh"], original / row["audio_filename"]
        _require(bvh, wav, wav.with_suffix(".csv"), listed_in=table)
        split = "valid" if row["validation"].strip().lower() in ("true", "1", "yes") else "train"
        sync = _sync(table, row, wav.with_suffix(".csv"))
        entries.append(Entry(bvh.stem, bvh, wav, row["style"], split, sync))
    return entries


def _sync(table: Path, row: dict[str, str], regions: Path) -> Sync:
    """Time codes are HH:MM:SS:FF, with 30 frames a second for the audio start and 60 for the others."""
    audio, motion, start, stop = (
        _timecode_s(table, row[column], 30 if column.startswith("audio") else 60) for column in RELEASE_COLUMNS[1:5]
    )
    if start < audio or start < motion or stop <= start:
        raise ValueError(f"'{table}' lets '{row['anim_bvh']}' act outside its recording; check the times.")
    return Sync((start - audio, stop - audio), (start - motion, stop - motion), _speaking(regions))


def _timecode_s(table: Path, text: str, rate_hz: int) -> float:
    try:
        hours, minutes, seconds, frames = (int(part) for part in text.split(":"))
    except ValueError:
        raise ValueError(f"'{table}' has the time '{text}', expected HH:MM:SS:FF; correct it.") from None
    return hours * 3600 + minutes * 60 + seconds + frames / rate_hz


def _speaking(path: Path) -> tuple[Span, ...]:
    """Regions of the recorded speaker: rows whose `#` contains an R, times mm:ss.mmm."""
    return tuple(
        (_clock_s(path, row["Start"]), _clock_s(path, row["End"]))
        for row in _rows(path, ("#", "Start", "End"))
        if "R" in row["#"]
    )


def _clock_s(path: Path, text: str) -> float:
    try:
        minutes, seconds = text.split(":")
        return int(minutes) * 60 + float(seconds)
    except ValueError:
        raise ValueError(f"'{path}' has the time '{text}', expected mm:ss.mmm; correct the table.") from None


def _listed(folder: Path) -> list[Entry]:
    table = folder / "corpus.csv"
    entries = []
    for row in _rows(table, ("name", "style", "split")):
        name, split = row["name"], row["split"]
        if split not in SPLITS:
            raise ValueError(f"'{table}' puts '{name}' into '{split}', expected train or valid; correct it.")
        bvh = folder / f"{name}.bvh"
        candidates = [folder / f"{name}{suffix}" for suffix in SPEECH_SUFFIXES]
        wav = next(filter(Path.exists, candidates), candidates[0])
        _require(bvh, wav, listed_in=table)
        entries.append(Entry(name, bvh, wav, row["style"], split))
    return entries


def _scanned(folder: Path) -> list[Entry]:
    """Pairs in the folder and its subfolders, sorted by name."""
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in (".bvh", *SPEECH_SUFFIXES))
    motion = {path.with_suffix(""): path for path in files if path.suffix.lower() == ".bvh"}
    speech = {path.with_suffix(""): path for path in files if path.suffix.lower() != ".bvh"}
    if not motion.keys() & speech.keys():
        return []
    for there, other, suffix in ((motion, speech, "wav"), (speech, motion, "bvh")):
        if there.keys() - other:
            first = min(there.keys() - other)
            raise FileNotFoundError(
                f"'{there[first]}' has no '{first.name}.{suffix}' beside it; add that or remove this."
            )
    styles = {stem: stem.parent.name if stem.parent != folder else folder.resolve().name for stem in motion}
    clips = Counter(styles.values())
    last = {style: stem for stem, style in styles.items()}
    return [
        Entry(
            name=stem.relative_to(folder).as_posix(),
            bvh=motion[stem],
            wav=speech[stem],
            style=style,
            split="valid" if clips[style] >= 4 and last[style] == stem else "train",
        )
        for stem, style in styles.items()
    ]


def _rows(table: Path, columns: Iterable[str]) -> list[dict[str, str]]:
    """Rows of a CSV file that has at least these columns."""
    try:
        with table.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            rows, names = list(reader), reader.fieldnames or ()
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"'{table}' is not a CSV file ({error}); save it as UTF-8 text.") from error
    absent = [column for column in columns if column not in names]
    if absent:
        raise ValueError(f"'{table}' has no column '{absent[0]}'; it needs {', '.join(columns)}.")
    for number, row in enumerate(rows, start=2):
        if any(row[column] is None for column in columns):
            raise ValueError(f"Line {number} of '{table}' is too short; fill in {', '.join(columns)}.")
    return rows


def _require(*paths: Path, listed_in: Path) -> None:
    for path in paths:
        if not path.exists():
            raise FileNotFoundError(f"'{path}' does not exist but '{listed_in}' lists it; add it or drop the line.")
