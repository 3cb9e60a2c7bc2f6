"""One clip's share of preparing: its two files -> takes -> arrays and their moments -> a shard on disk."""

import hashlib
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from zeggs_jax.data import shard
from zeggs_jax.data.entry import Entry, Problem
from zeggs_jax.data.settings import MENDED, PrepareConfig
from zeggs_jax.data.shard import Body, MadeTake, Rows, Shard
from zeggs_jax.data.statistics import moments
from zeggs_jax.data.takes import Take, naming, takes
from zeggs_jax.motion import bvh, features
from zeggs_jax.motion.pose import gaze_direction, to_vector
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import wav

NOT_IN_SHARDS = ("speech_columns", "skip_bad")  # settings that change no clip's arrays

_vector = jax.jit(to_vector)
_look = jax.jit(gaze_direction)


class Job(NamedTuple):
    """A clip that is to be made into the file `path`."""

    entry: Entry
    config: PrepareConfig
    trimmed: Path | None  # folder for its takes as BVH and WAV
    path: Path


def jobs_of(entries: list[Entry], config: PrepareConfig, out: Path, folder: Path) -> list[Job]:
    """The jobs of a corpus; a shard in `folder` is named by the hash of its clip's files and all settings."""
    digests = _digests(path for entry in entries for path in _files(entry))
    settings = {name: value for name, value in chosen(config).items() if name not in NOT_IN_SHARDS}
    jobs = []
    for entry in entries:
        trimmed = out / "trimmed" / entry.split if config.save_trimmed else None
        made_of = {"name": entry.name, "sync": entry.sync, "split": entry.split if trimmed else None}
        key = shard.key({**made_of, "files": [digests[path] for path in _files(entry)], **settings})
        jobs.append(Job(entry, config, trimmed, folder / f"{key}.npz"))
    return jobs


def chosen(config: PrepareConfig) -> dict[str, Any]:
    """The settings that are not the default's, so that a new one changes no old hash."""
    usual = asdict(MENDED)
    return {name: value for name, value in asdict(config).items() if value != usual[name]}


def _files(entry: Entry) -> list[Path]:
    return [path for path in (entry.bvh, entry.wav, entry.transcript) if path]


def _digests(files: Iterable[Path]) -> dict[Path, str]:
    """SHA-256 of every file; of one that does not read the reason, as whoever makes its clip will say."""

    def digest(path: Path) -> str:
        try:
            with path.open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            return str(error.strerror)

    files = sorted(set(files))
    with ThreadPoolExecutor() as threads:
        return dict(zip(files, threads.map(digest, files), strict=True))


def make(job: Job) -> Body | Problem:
    """Write the clip's shard; or say why it cannot be used. OSError where the shard cannot be written."""
    entry, config = job.entry, job.config
    try:
        rate_hz = None if config.rate_hz is None else float(config.rate_hz)
        made = list(
            takes(entry, config.paces, rate_hz, config.centre, config.as_released, config.body, config.min_frames)
        )
        body = Body(made[0].clip.skeleton, made[0].clip.frame_time)
        arrays = {take.name: arrays_of(take, config) for take in made}
    except (ValueError, OSError) as error:
        return Problem(entry.name, " ".join(str(error).split()))
    if job.trimmed:
        for take in made:
            save_trimmed(job.trimmed, take)
    shard.write(job.path, Shard(body, arrays))
    return body


def arrays_of(take: Take, config: PrepareConfig) -> MadeTake:
    """One row of each array for every frame of a take, and the point it looks at."""
    with naming(take.entry.bvh):
        motion = features.encode(take.clip)
    frames, rate_hz = len(take.clip.euler), bvh.rate_hz(take.clip.frame_time)
    with naming(take.entry.wav):
        speech = speech_features.extract(take.wave, frames, rate_hz, config.speech, config.as_released)
    root, gaze = motion.pose.root, np.asarray(motion.gaze)
    vector = features.in_float64(_vector, motion.pose)
    look = features.in_float64(_look, root, np.repeat(gaze[None], frames, axis=0))
    rows = Rows(*(np.asarray(x, np.float32) for x in (speech, vector, root.pos, root.rot, look)))
    for name, values in rows._asdict().items():
        if not np.isfinite(values).all():
            source = take.entry.wav if name == "speech" else take.entry.bvh
            frame = int(np.argwhere(~np.isfinite(values))[0][0])
            raise ValueError(f"'{source}' gives no finite {name} at frame {frame}; cut or drop it.")
    inner = slice(2, -2)
    return MadeTake(gaze, rows, *(moments(x[inner]) for x in (rows.speech, rows.pose, rows.look)))


def save_trimmed(folder: Path, take: Take) -> None:
    """Write a take as the release does: BVH and 16-bit WAV, loudness as recorded."""
    path = folder / take.name
    path.parent.mkdir(parents=True, exist_ok=True)
    bvh.write(path.with_name(f"{path.name}.bvh"), take.clip)
    wav.write(path.with_name(f"{path.name}.wav"), take.wave)
