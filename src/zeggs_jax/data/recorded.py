"""Recorded clips of a folder as made ones are judged by them: upright bodies in cm, with style, speech, transcript."""

import json
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zeggs_jax.data import body as bodies
from zeggs_jax.data import corpus, release, takes
from zeggs_jax.data.entry import SPEECH_SUFFIXES, Entry, beside, transcript_beside
from zeggs_jax.motion import bvh, edit
from zeggs_jax.motion.bvh import Clip


class Recorded(NamedTuple):
    """A recorded clip: cm, y up; what is not there is None."""

    name: str  # its path below the folder, without suffix
    path: Path
    clip: Clip
    style: str | None
    speech: Path | None
    transcript: Path | None


class Truth(NamedTuple):
    """All recorded clips, how their files are read, and what was left out."""

    clips: list[Recorded]
    body: bodies.BodyConfig
    problems: list[str]


def read_truth(
    folder: Path, speech: Path | None = None, split: str | None = None, rate_hz: float | None = None
) -> Truth:
    """The recorded clips of a folder, with speech from `speech` or beside them.

    A corpus folder that has a table (corpus.csv, or the ZEGGS names) gives styles and splits by it; else each BVH is a
    clip, its style the name of its subfolder, or "style" in the JSON beside it.

    Raises:
        ValueError, OSError: no such folder, no clips in it, a file that does not read, clips of different skeletons or
            rates, a body whose size or upright is not clear.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"the truth '{folder}' is no folder; give one with the recorded clips (.bvh).")
    if speech is not None and not speech.is_dir():
        raise FileNotFoundError(f"the speech '{speech}' is no folder; give one with the recordings (.wav).")
    entries, problems = _entries(folder, split)
    if not entries:
        of_split = f" of the split '{split}'" if split else ""
        raise ValueError(f"the truth '{folder}' holds no clips{of_split}; put the recorded .bvh files there.")
    clips = [(entry, clip_of(entry.bvh, rate_hz)) for entry in entries]
    body = bodies.resolve(clips[0][1], bodies.BodyConfig(), str(entries[0].bvh))
    found = []
    for entry, clip in clips:
        same(clips[0][1], clip, entries[0].bvh, entry.bvh)
        sound = _speech(speech, entry)
        style = entry.style or None
        clip = bodies.normalise(clip, body, str(entry.bvh))
        found.append(Recorded(entry.name, entry.bvh, clip, style, sound, entry.transcript))
    return Truth(found, body, problems)


def _entries(folder: Path, split: str | None) -> tuple[list[Entry], list[str]]:
    if (folder / corpus.TABLE).exists() or (folder / release.TABLE).exists() or release.is_clean(folder):
        found = corpus.survey(folder)
        if cut := next((entry for entry in found.entries if entry.sync), None):
            raise ValueError(
                f"'{cut.bvh}' is an uncut take; give a folder of cut clips with their speech as the truth."
            )
        return [e for e in found.entries if split in (None, e.split)], [problem.reason for problem in found.problems]
    if split is not None:
        raise ValueError(f"the truth '{folder}' has no {corpus.TABLE} that says what its split '{split}' is.")
    entries = []
    for name, path in below(folder):
        transcript = transcript_beside(path.with_suffix(""))
        style = path.parent.name if path.parent != folder else _style_in(transcript)
        entries.append(Entry(name, path, Path(), style, "valid", transcript=transcript))
    return entries, []


def _style_in(transcript: Path | None) -> str:
    notes = read_notes(transcript) if transcript is not None and transcript.suffix.lower() == ".json" else {}
    return str(notes.get("style") or "")


def read_notes(path: Path) -> Mapping[str, Any]:
    """A JSON object of a file, empty where it holds something else; ValueError where it is no JSON."""
    try:
        notes = json.loads(path.read_text(encoding="utf-8-sig"))
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"'{path}' is not JSON ({error}); mend or remove it.") from error
    return notes if isinstance(notes, dict) else {}


def below(folder: Path) -> list[tuple[str, Path]]:
    """(name, path) of the BVH files of a folder and its subfolders, sorted; hidden files are none."""
    files = sorted(path for path in folder.rglob("[!.]*") if path.suffix.lower() == ".bvh" and path.is_file())
    return [(path.relative_to(folder).with_suffix("").as_posix(), path) for path in files]


def _speech(folder: Path | None, entry: Entry) -> Path | None:
    if folder is not None:
        stems = (folder / entry.name, folder / Path(entry.name).name)
    else:
        stems = (entry.bvh.with_suffix(""),)
    own = entry.wav if folder is None and entry.wav.name else None
    return own or next((path for stem in stems if (path := beside(stem, SPEECH_SUFFIXES))), None)


def clip_of(path: Path, rate_hz: float | None) -> Clip:
    """The clip of a BVH file, resampled to a rate where one is given."""
    clip = bvh.read(path)
    with takes.naming(path):
        return clip if rate_hz is None else edit.resample(clip, rate_hz)


def same(first: Clip, other: Clip, first_path: Path, path: Path) -> None:
    """Refuses another skeleton or another rate."""
    a, b = first.skeleton, other.skeleton
    if a.names != b.names or a.parents != b.parents:
        odd = next((y or x for x, y in zip_longest(a.names, b.names) if x != y), None)
        difference = f"first different joint: '{odd}'" if odd else "their hierarchies differ"
        raise ValueError(
            f"'{path}' has a skeleton of {len(b)} joints and '{first_path}' another of {len(a)}, {difference}; "
            "evaluate motions of one skeleton."
        )
    rates = bvh.rate_hz(first.frame_time), bvh.rate_hz(other.frame_time)
    if not np.isclose(*rates, rtol=5e-4):
        raise ValueError(
            f"'{path}' runs at {rates[1]:g} frames per second and '{first_path}' at {rates[0]:g}; "
            f"say --rate {rates[0]:g} to measure all at that."
        )
