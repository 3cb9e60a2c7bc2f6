"""One take of a corpus before it is read: its files, style and split, or what is wrong with it."""

from pathlib import Path
from typing import Literal, NamedTuple

SPEECH_SUFFIXES = (".wav", ".flac", ".ogg")
TRANSCRIPT_SUFFIXES = (".json", ".TextGrid", ".textgrid", ".srt", ".vtt", ".tsv", ".txt")
SPLITS = ("train", "valid")

Split = Literal["train", "valid"]
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
    split: Split
    sync: Sync | None = None
    transcript: Path | None = None  # name.json, .TextGrid, .srt, .vtt, .tsv or .txt beside the two


class Problem(NamedTuple):
    """A clip that cannot be used, and why, in one sentence."""

    name: str
    reason: str


class Survey(NamedTuple):
    """What a corpus folder holds: takes whose files are there, and what is not complete, both in a fixed order."""

    entries: list[Entry]
    problems: list[Problem]


def transcript_beside(stem: Path) -> Path | None:
    """The transcript beside a clip, where there is one: stem.json before all others, stem.txt after them."""
    return beside(stem, TRANSCRIPT_SUFFIXES)


def beside(stem: Path, suffixes: tuple[str, ...]) -> Path | None:
    """The first file stem + suffix that exists, suffixes in small or capital letters."""
    spelled = (case for suffix in suffixes for case in (suffix, suffix.upper()))
    return next((path for case in spelled if (path := stem.with_name(stem.name + case)).is_file()), None)


def chosen_splits(styles: list[str]) -> list[Split]:
    """Where nobody says: the last of four or more clips of a style is for validation."""
    last = {style: at for at, style in enumerate(styles)}
    return ["valid" if styles.count(style) >= 4 and last[style] == at else "train" for at, style in enumerate(styles)]
