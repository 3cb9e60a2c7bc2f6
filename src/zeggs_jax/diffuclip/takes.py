"""A corpus folder -> the takes that GestureDiffuCLIP learns from: motion, rhythm, words and captions, kept on disk."""

import hashlib
import io
import json
import os
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from tqdm import tqdm

from ..data import corpus, workers
from ..data import takes as clips
from ..data.body import BodyConfig
from ..data.entry import Entry
from ..data.prepared import skeleton_from_json, skeleton_to_json
from ..motion import bvh
from ..motion.skeleton import Skeleton
from ..speech import rhythm, transcript, wav
from ..speech.transcript import Word
from . import representation
from .config import DiffuclipConfig
from .stages.stage import Take

FORMAT = 1
FOLDER = "takes"
SHORTEST_S = 1.0


class _Job(NamedTuple):
    """One take to be made; what it is made of is in the name of its file."""

    entry: Entry
    body: BodyConfig
    frame_time: float
    rate: int
    path: Path


def gather(
    folder: str | Path, out: str | Path, config: DiffuclipConfig, processes: int | None = None
) -> tuple[list[Take], Skeleton, BodyConfig]:
    """The takes of a corpus (see data/corpus.py), their skeleton and how their bodies were read.

    They are made in so many `processes` and kept in OUT/takes. After a stop the same call goes on where it was. A take
    without a transcript has no words; without "captions" in that file, its caption is made of its style's name.

    Raises:
        ValueError, OSError: no corpus, a clip that does not read or is shorter than a second, clips of another skeleton
            than the first, no clip of the split 'train'.
        KeyboardInterrupt: after Ctrl-C, with all finished takes kept.
    """
    entries = corpus.find(folder)
    body = clips.body_of(entries, clips.FOUND)
    kept = Path(out) / FOLDER
    kept.mkdir(parents=True, exist_ok=True)
    jobs = [_job(entry, body, config, kept) for entry in entries]
    missing = [job for job in jobs if not job.path.exists()]
    cores = processes or max(1, min(os.cpu_count() or 1, len(missing) // 8))
    for _ in tqdm(workers.each(_make, missing, cores), "reading the corpus", len(missing), disable=None, unit="clip"):
        pass
    read = [_read(job) for job in tqdm(jobs, "loading", disable=None, unit="clip", leave=False)]
    skeletons = [skeleton for _, skeleton in read]
    for job, skeleton in zip(jobs, skeletons, strict=True):
        if (skeleton.names, skeleton.parents) != (skeletons[0].names, skeletons[0].parents):
            raise ValueError(
                f"'{job.entry.bvh}' has another skeleton than '{jobs[0].entry.bvh.name}' ({len(skeleton)} and "
                f"{len(skeletons[0])} joints); one skeleton was expected: make a corpus of each by itself."
            )
    takes = [take for take, _ in read]
    if not any(take.split == "train" for take in takes):
        raise ValueError(f"corpus '{folder}' has no clip of the split 'train'; mark some so in corpus.csv.")
    return takes, skeletons[0], body


def caption_of(style: str) -> str:
    """The caption of a take that has none: the paper's wording for a label (Sec. 7.2)."""
    return f"the person is {style.replace('_', ' ').lower()}"


def _job(entry: Entry, body: BodyConfig, config: DiffuclipConfig, kept: Path) -> _Job:
    """The job of an entry; its file is named by a hash of all that goes into it."""
    sha = hashlib.sha256(repr((FORMAT, entry.sync, body, config.frame_time, config.codes.rate)).encode())
    for path in filter(None, (entry.bvh, entry.wav, entry.transcript)):
        sha.update(path.read_bytes())
    return _Job(entry, body, config.frame_time, config.codes.rate, kept / f"{sha.hexdigest()[:24]}.npz")


def _make(job: _Job) -> None:
    """Write the arrays of one take, whole or not at all."""
    entry, rate = job.entry, job.rate
    rate_hz = bvh.rate_hz(job.frame_time)
    made = next(clips.takes(entry, rate_hz=rate_hz, body=job.body, min_frames=round(SHORTEST_S * rate_hz)))
    motion, words = representation.encode(made.clip), words_of(entry.transcript)
    latents = len(motion) // rate
    notes = {
        "words": [list(word) for word in words if word.end <= len(motion) * job.frame_time],
        "captions": _captions(entry),
        "skeleton": skeleton_to_json(representation.bones(made.clip)),
    }
    buffer = io.BytesIO()
    np.savez(
        buffer,
        motion=motion[: latents * rate].astype(np.float32),
        rhythm=heard(made.wave, latents, rate_hz / rate),
        notes=np.frombuffer(json.dumps(notes).encode(), np.uint8),
    )
    partial = job.path.with_suffix(".partial")
    partial.write_bytes(buffer.getvalue())
    os.replace(partial, job.path)


def heard(wave: Float[np.ndarray, " n"], latents: int, latents_hz: float) -> Float[np.ndarray, "L 2"]:
    """Onsets and amplitude of a speech at 16 kHz, its loudness levelled, one row for each latent."""
    levelled = wav.normalize_loudness(wave) if len(wave) > wav.RATE_HZ // 2 else wave
    return rhythm.extract(np.asarray(levelled, np.float32), latents_hz, latents)


def words_of(path: Path | None) -> tuple[Word, ...]:
    """The timed words of a transcript file; none of a file that is not there or has no times (plain text)."""
    if path is None or path.suffix.lower() == ".txt":
        return ()
    return transcript.read(path)


def _captions(entry: Entry) -> list[str]:
    """What the corpus says of how the body moves, or else the style's name in a sentence."""
    if entry.transcript is not None and entry.transcript.suffix.lower() == ".json":
        notes: Any = json.loads(entry.transcript.read_text(encoding="utf-8-sig"))
        written = notes.get("captions") if isinstance(notes, dict) else None
        if isinstance(written, list) and written and all(isinstance(text, str) and text.strip() for text in written):
            return written
    return [caption_of(entry.style)]


def _read(job: _Job) -> tuple[Take, Skeleton]:
    """A take from its file; ValueError for one that is damaged, naming what to delete."""
    try:
        with job.path.open("rb") as file, np.load(file) as arrays:
            notes = json.loads(arrays["notes"].tobytes())
            words = tuple(Word(*word) for word in notes["words"])
            take = Take(
                job.entry.name, job.entry.style, job.entry.split, arrays["motion"], arrays["rhythm"], words,
                tuple(notes["captions"]),
            )  # fmt: skip
            return take, skeleton_from_json(notes["skeleton"])
    except (ValueError, KeyError, TypeError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise ValueError(
            f"'{job.path}' is damaged ({error}): delete it, and the same command makes it anew."
        ) from error
