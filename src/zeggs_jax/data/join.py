"""Shards of clips, one behind the other -> the arrays that training reads, and their statistics.

One clip is in memory at a time, however many there are.
"""

import os
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from zeggs_jax.data import augment, scale, shard
from zeggs_jax.data.arrays import ArrayFile, Blocks
from zeggs_jax.data.job import Job, make
from zeggs_jax.data.prepared import ARRAYS, SCALES, across_of, skeleton_to_json
from zeggs_jax.data.shard import Body, Shard
from zeggs_jax.data.statistics import Moments, merge


def join(jobs: list[Job], body: Body, out: Path, scratch: Path) -> dict[str, Any]:
    """Write the arrays and statistics of all jobs' shards into `out`; what the manifest says of them.

    ValueError where no clip is there to train on.
    """
    if all(job.entry.split != "train" for job in jobs):
        raise ValueError(
            "All clips that can be used are in the split 'valid'; put at least one into 'train' in the column split "
            "of corpus.csv (or validation of info.csv)."
        )
    config, styles, clips, training = jobs[0].config, sorted({job.entry.style for job in jobs}), [], []
    total: tuple[Moments, ...] | None = None
    with ExitStack() as stack:
        paths = {name: (scratch if name == "look" else out) / f"{name}.npy" for name in shard.Rows._fields}
        files = {name: stack.enter_context(ArrayFile(path)) for name, path in paths.items()}
        for job in tqdm(jobs, desc="joining", unit="clip", disable=None):
            entry = job.entry
            for name, take in _shard(job).takes.items():
                spans = {kind: file.append(getattr(take.rows, kind)) for kind, file in files.items()}
                start, stop = spans["pose"]
                clips.append({"name": name, "split": entry.split, "label": styles.index(entry.style),
                              "range": [start, stop], "gaze": take.gaze.tolist()})  # fmt: skip
                if entry.split == "train":
                    training.append((start + 2, stop - 2))  # as released
                    own = (take.speech, take.pose, take.look)
                    total = tuple(map(merge, total, own)) if total else own
    assert total is not None
    if not config.as_released and (across := across_of(body.skeleton)):  # training mirrors the clips
        by = augment.mirror_of(body.skeleton, across)
        total = (total[0], augment.with_images(total[1], by), augment.with_images(total[2], augment.POINT))
    released = None
    if config.as_released:
        released = tuple(
            scale.fit_columns(Blocks(paths[kind], training), as_released=True) for kind in ("speech", "pose", "look")
        )
    joints = len(body.skeleton)
    columns = config.speech_columns or config.speech.log_mel  # log-mels have no std in common
    _save_scales(out / SCALES, scale.from_moments(total[0], total[1], total[2], joints, columns, released))
    return {
        "pipeline": "as released" if config.as_released else "mended",
        "frame_time": body.frame_time,
        "skeleton": skeleton_to_json(body.skeleton),
        "styles": styles,
        "clips": clips,
        "sha256": {name: files[name].digest.hexdigest() for name in ARRAYS},
    }


def _shard(job: Job) -> Shard:
    """The job's shard, made again where the file is damaged."""
    try:
        return shard.read(job.path)
    except ValueError:
        make(job)
        return shard.read(job.path)


def _save_scales(path: Path, scales: scale.Scales) -> None:
    parts = {kind: part._asdict() for kind, part in scales._asdict().items()}
    partial = path.with_name("partial.npz")
    np.savez(partial, **{f"{kind}.{name}": x for kind, part in parts.items() for name, x in part.items()})
    os.replace(partial, path)
