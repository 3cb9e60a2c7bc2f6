"""The ZEGGS download: its table of takes with time codes (`original/`), or the takes cut already (`clean/`)."""

import re
from collections.abc import Iterator
from pathlib import Path

from zeggs_jax.data import table
from zeggs_jax.data.entry import (
    SPEECH_SUFFIXES,
    Entry,
    Problem,
    Span,
    Split,
    Sync,
    beside,
    chosen_splits,
    transcript_beside,
)
from zeggs_jax.data.table import Row

TABLE = "info.csv"
COLUMNS = (
    "audio_filename", "audio_start_time", "anim_start_time", "acting_start_time", "acting_end_time",
    "style", "anim_bvh", "validation",
)  # fmt: skip
_CUT = re.compile(r"(?P<take>\d+_(?P<style>[A-Za-z]+)_\d+(_mirror)?)_x_\d+_\d+")  # 067_Speech_2_mirror_x_1_0


def original(folder: Path) -> Iterator[Entry | Problem]:
    """The takes listed in `info.csv`, with files in `original/` or beside it, each wav with its table of speakers."""
    listing = folder / TABLE
    files = folder / "original" if (folder / "original").is_dir() else folder
    for row in table.read(listing, COLUMNS):
        name = Path(row["anim_bvh"]).stem or f"line {row.line}"
        try:
            yield _listed(listing, files, row)
        except (ValueError, OSError) as error:
            yield Problem(name, str(error))


def is_clean(folder: Path) -> bool:
    """Whether the BVH files of a folder are named as those of the download's `clean/`."""
    names = [path.stem for path in folder.glob("[!.]*.bvh")]
    return bool(names) and all(_CUT.fullmatch(name) for name in names)


def clean(folder: Path) -> Iterator[Entry | Problem]:
    """The takes of `clean/`, synchronised and trimmed, as `<take>_x_<pace>.bvh` and `.wav`.

    Style and split are those of `info.csv` in the folder or above it; without it the style is in the name.
    """
    tables = [path for path in (folder / TABLE, folder.parent / TABLE) if path.is_file()]
    rows = {Path(row["anim_bvh"]).stem: row for row in table.read(tables[0], COLUMNS[5:])} if tables else {}
    files = sorted(folder.glob("[!.]*.bvh"))
    cuts = [match for path in files if (match := _CUT.fullmatch(path.stem))]
    styles = [rows[cut["take"]]["style"] if cut["take"] in rows else cut["style"] for cut in cuts]
    chosen = chosen_splits(styles)
    for path, cut, style, free in zip(files, cuts, styles, chosen, strict=True):
        split = _split(rows[cut["take"]]) if cut["take"] in rows else "train" if rows else free
        own = path.with_suffix("")
        speech = beside(own, SPEECH_SUFFIXES) or beside(own.with_name(own.name.replace("_mirror", "")), SPEECH_SUFFIXES)
        if speech is None:
            yield Problem(own.name, f"'{path}' has no '{own.name}.wav' beside it; add that or remove this.")
        else:
            yield Entry(own.name, path, speech, style, split, transcript=transcript_beside(speech.with_suffix("")))
    there = {cut["take"] for cut in cuts}
    for take in (take for take in rows if take not in there):
        yield Problem(take, f"'{tables[0]}' lists '{take}', of which '{folder}' has no clip; add it or drop the line.")


def _listed(listing: Path, files: Path, row: Row) -> Entry:
    if row.missing:
        raise ValueError(f"Line {row.line} of '{listing}' has no {row.missing}; fill in {', '.join(COLUMNS)}.")
    bvh, wav = files / row["anim_bvh"], files / row["audio_filename"]
    for path in (bvh, wav, wav.with_suffix(".csv")):
        if not path.exists():
            raise FileNotFoundError(f"'{path}' does not exist but '{listing}' lists it; add it or drop the line.")
    sync = _sync(listing, row, wav.with_suffix(".csv"))
    return Entry(bvh.stem, bvh, wav, row["style"], _split(row), sync, transcript_beside(wav.with_suffix("")))


def _split(row: Row) -> Split:
    return "valid" if row["validation"].lower() in ("true", "1", "yes") else "train"


def _sync(listing: Path, row: Row, regions: Path) -> Sync:
    """Time codes are HH:MM:SS:FF, with 30 frames a second for the audio start and 60 for the others."""
    audio, motion, start, stop = (
        _timecode_s(listing, row[column], 30 if column.startswith("audio") else 60) for column in COLUMNS[1:5]
    )
    if start < audio or start < motion or stop <= start:
        raise ValueError(f"'{listing}' lets '{row['anim_bvh']}' act outside its recording; check the times.")
    return Sync((start - audio, stop - audio), (start - motion, stop - motion), _speaking(regions))


def _timecode_s(listing: Path, text: str, rate_hz: int) -> float:
    try:
        hours, minutes, seconds, frames = (int(part) for part in text.split(":"))
    except ValueError:
        raise ValueError(f"'{listing}' has the time '{text}', expected HH:MM:SS:FF; correct it.") from None
    return hours * 3600 + minutes * 60 + seconds + frames / rate_hz


def _speaking(path: Path) -> tuple[Span, ...]:
    """Regions of the recorded speaker: rows whose `#` contains an R, times mm:ss.mmm."""
    return tuple(
        (_clock_s(path, row["Start"]), _clock_s(path, row["End"]))
        for row in table.read(path, ("#", "Start", "End"))
        if "R" in row["#"]
    )


def _clock_s(path: Path, text: str) -> float:
    try:
        minutes, seconds = text.split(":")
        return int(minutes) * 60 + float(seconds)
    except ValueError:
        raise ValueError(f"'{path}' has the time '{text}', expected mm:ss.mmm; correct the table.") from None
