"""The clips of a corpus: pairs of motion and speech, their transcripts, styles and split, and what is not complete."""

from collections.abc import Iterator
from pathlib import Path

from zeggs_jax.data import release, table
from zeggs_jax.data.entry import (
    SPEECH_SUFFIXES,
    SPLITS,
    Entry,
    Problem,
    Survey,
    Sync,
    beside,
    chosen_splits,
    transcript_beside,
)  # fmt: skip

__all__ = ["Entry", "Problem", "Survey", "Sync", "find", "survey"]

TABLE = "corpus.csv"
Found = Iterator[Entry | Problem]


def find(folder: str | Path) -> list[Entry]:
    """The takes of a folder (see `survey`); ValueError with the first problem where anything is not complete."""
    found = survey(folder)
    if found.problems:
        raise ValueError(found.problems[0].reason)
    return found.entries


def survey(folder: str | Path) -> Survey:
    """The takes of a folder, and every file that has no partner and line of a table that does not read.

    Layouts: the ZEGGS download (`info.csv`; files in `original/` or beside it, each wav with a CSV of the
    speaker's regions; or, synchronised and trimmed, in `clean/`); a `corpus.csv` with columns name,style and
    maybe split (name.bvh and name.wav, .flac or .ogg beside it, subfolders allowed); or pairs without a table,
    where the style is the name of the subfolder. Where no split is given, the last of four or more clips of a
    style goes to validation. A name.json, .TextGrid, .srt, .vtt, .tsv or .txt beside a pair is its transcript.

    Raises FileNotFoundError for a missing folder, ValueError for one without any pair or a table that does not
    read.
    """
    folder = Path(folder)
    if folder.is_file():
        raise FileNotFoundError(f"Corpus '{folder}' is a file; a folder with name.bvh + name.wav was expected.")
    if not folder.is_dir():
        raise FileNotFoundError(f"Corpus folder '{folder}' does not exist; give one with name.bvh + name.wav.")
    entries: dict[str, Entry] = {}
    problems: list[Problem] = []
    for found in _layout(folder):
        if isinstance(found, Problem):
            problems.append(found)
        elif found.name in entries:
            reason = f"Corpus '{folder}' lists '{found.name}' more than once; give each clip its own name."
            problems.append(Problem(found.name, reason))
        else:
            entries[found.name] = found
    if not entries:
        first = f" ({problems[0].reason.rstrip('.')})" if problems else ""
        raise ValueError(
            f"Corpus folder '{folder}' holds no pairs of name.bvh and name.wav{first}; put both of each clip there."
        )
    return Survey(list(entries.values()), problems)


def _layout(folder: Path) -> Found:
    if (folder / TABLE).exists():
        return _listed(folder)
    if (folder / "clean").is_dir() and not (folder / "original").is_dir() and release.is_clean(folder / "clean"):
        return release.clean(folder / "clean")
    if release.is_clean(folder):
        return release.clean(folder)
    if (folder / release.TABLE).exists():
        return release.original(folder)
    return _scanned(folder)


def _listed(folder: Path) -> Found:
    """The lines of corpus.csv."""
    listing = folder / TABLE
    rows = table.read(listing, ("name", "style"))
    given = bool(rows) and "split" in rows[0].cells
    for row, chosen in zip(rows, chosen_splits([row["style"] for row in rows]), strict=True):
        name, split = row["name"], row["split"] if given else chosen
        bvh, wav = (beside(folder / name, suffixes) for suffixes in ((".bvh",), SPEECH_SUFFIXES))
        if row.missing or not split:
            lacking = row.missing or "split"
            yield Problem(name or f"line {row.line}", f"Line {row.line} of '{listing}' has no {lacking}; fill it in.")
        elif split not in SPLITS:
            yield Problem(name, f"'{listing}' puts '{name}' into '{split}', expected train or valid; correct it.")
        elif bvh is None or wav is None:
            lost = folder / (f"{name}.bvh" if bvh is None else f"{name}.wav")
            yield Problem(name, f"'{lost}' does not exist but '{listing}' lists it; add it or drop the line.")
        else:
            yield Entry(name, bvh, wav, row["style"], split, transcript=transcript_beside(folder / name))


def _scanned(folder: Path) -> Found:
    """Pairs in the folder and its subfolders, sorted by name, then what has no partner; hidden files are none."""
    files = sorted(path for path in folder.rglob("[!.]*") if path.suffix.lower() in (".bvh", *SPEECH_SUFFIXES))
    motion = {path.with_suffix(""): path for path in files if path.suffix.lower() == ".bvh"}
    speech = {path.with_suffix(""): path for path in reversed(files) if path.suffix.lower() in SPEECH_SUFFIXES}
    stems = [stem for stem in motion if stem in speech]
    styles = [stem.parent.name if stem.parent != folder else folder.resolve().name for stem in stems]
    for stem, style, split in zip(stems, styles, chosen_splits(styles), strict=True):
        name, wav = stem.relative_to(folder).as_posix(), beside(stem, SPEECH_SUFFIXES) or speech[stem]
        yield Entry(name, motion[stem], wav, style, split, transcript=transcript_beside(stem))
    for there, other, suffix in ((motion, speech, "wav"), (speech, motion, "bvh")):
        for stem in sorted(there.keys() - other):
            reason = f"'{there[stem]}' has no '{stem.name}.{suffix}' beside it; add that or remove this."
            yield Problem(stem.relative_to(folder).as_posix(), reason)
