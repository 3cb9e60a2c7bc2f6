"""A corpus folder -> arrays for training on disk, their statistics, a manifest of how they were made."""

import hashlib
import json
import os
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float32
from tqdm import tqdm

from zeggs_jax.data import corpus, scale
from zeggs_jax.data.prepared import ARRAYS, FORMAT, MANIFEST, SCALES, Prepared, load, skeleton_to_json
from zeggs_jax.data.takes import Take, naming, takes
from zeggs_jax.motion import bvh, features
from zeggs_jax.motion.pose import Root, gaze_direction, to_vector
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import wav

__all__ = ["PrepareConfig", "Prepared", "load", "prepare", "save_trimmed"]

RELEASED_PACE = (0.9, 1.0)


@dataclass(frozen=True)
class PrepareConfig:
    """Settings of `prepare`; the defaults mend the release's errors."""

    as_released: bool = False  # its centring, float32 statistics and NaN rules
    rate_hz: float | int | None = None  # resample the motion; None keeps the rate, which all clips must share
    pace: tuple[float, ...] | None = None  # copies of every clip; None: 1.0, or the release's 0.9 and 1.0
    centre: bool = True  # start every clip at the origin, facing +Z
    speech_columns: bool = False  # a std for every speech feature, not one for all as released
    save_trimmed: bool = False  # also write the clips as BVH and WAV under trimmed/
    speech: speech_features.SpeechFeatureConfig = speech_features.RELEASED


def prepare(folder: str | Path, out: str | Path, config: PrepareConfig = PrepareConfig()) -> Prepared:
    """Write the arrays of a corpus folder (see corpus.find) into the folder `out` and load them.

    Raises FileNotFoundError or ValueError, naming the file, when a clip is missing, does not read, is not
    finite, is too short, does not fit its speech, or has another skeleton or frame rate than the first clip.
    """
    entries, out = corpus.find(folder), Path(out)
    out.mkdir(parents=True, exist_ok=True)
    (out / MANIFEST).unlink(missing_ok=True)
    styles = sorted({entry.style for entry in entries})
    pace = config.pace or (RELEASED_PACE if config.as_released else (1.0,))
    rate_hz = None if config.rate_hz is None else float(config.rate_hz)
    made: list[Take] = []  # the first one only
    clips: list[dict[str, Any]] = []
    with ExitStack() as stack:
        files = {name: stack.enter_context(_ArrayFile(out / f"{name}.npy")) for name in ARRAYS}
        for entry in tqdm(entries, desc="preparing", unit="clip", disable=None):
            for take in takes(entry, pace, rate_hz, config.centre, config.as_released):
                made = made or [take]
                _check_alike(made[0], take)
                if config.save_trimmed:
                    save_trimmed(out / "trimmed" / entry.split, take)
                rows, gaze = _rows(take, config)
                start = files["pose"].rows
                for name, file in files.items():
                    file.append(rows[name])
                clips.append({"name": take.name, "split": entry.split, "label": styles.index(entry.style),
                              "range": [start, files["pose"].rows], "gaze": gaze.tolist()})  # fmt: skip
    _save_scales(out / SCALES, _fit(out, clips, config))
    manifest = {
        "format": FORMAT,
        "config": asdict(config),
        "source": Path(folder).name,
        "frame_time": made[0].clip.frame_time,
        "skeleton": skeleton_to_json(made[0].clip.skeleton),
        "styles": styles,
        "clips": clips,
        "sha256": {name: file.digest.hexdigest() for name, file in files.items()},
    }
    partial = out / f"{MANIFEST}.partial"
    partial.write_text(json.dumps(manifest, indent=1) + "\n")
    os.replace(partial, out / MANIFEST)
    return load(out)


def save_trimmed(folder: Path, take: Take) -> None:
    """Write a take as the release does: BVH and 16-bit WAV, loudness as recorded."""
    path = folder / take.name
    path.parent.mkdir(parents=True, exist_ok=True)
    bvh.write(path.with_name(f"{path.name}.bvh"), take.clip)
    wav.write(path.with_name(f"{path.name}.wav"), take.wave)


def _rows(take: Take, config: PrepareConfig) -> tuple[dict[str, np.ndarray], Float32[np.ndarray, "3"]]:
    """One row of each array for every frame of a clip, and the point it looks at (world, cm)."""
    with naming(take.entry.bvh):
        motion = features.encode(take.clip)
    frames, rate_hz = len(take.clip.euler), bvh.rate_hz(take.clip.frame_time)
    with naming(take.entry.wav):
        speech = speech_features.extract(take.wave, frames, rate_hz, config.speech, config.as_released)
    rows = {
        "speech": speech,
        "pose": np.asarray(to_vector(motion.pose)),
        "root_pos": np.asarray(motion.pose.root.pos),
        "root_rot": np.asarray(motion.pose.root.rot),
    }
    for name, values in rows.items():
        if not np.isfinite(values).all():
            source = take.entry.wav if name == "speech" else take.entry.bvh
            frame = int(np.argwhere(~np.isfinite(values))[0][0])
            raise ValueError(f"'{source}' gives no finite {name} at frame {frame}; cut or drop it.")
    return rows, np.asarray(motion.gaze)


def _fit(out: Path, clips: list[dict[str, Any]], config: PrepareConfig) -> scale.Scales:
    """Statistics over the training clips, without the first and last two frames of each, as released."""
    training = [clip for clip in clips if clip["split"] == "train"]
    if not training:
        raise ValueError("All clips of the corpus are in the split 'valid'; put at least one into 'train'.")
    inner = [slice(clip["range"][0] + 2, clip["range"][1] - 2) for clip in training]
    speech, pose, pos, rot = (np.load(out / f"{name}.npy", mmap_mode="r") for name in ARRAYS)
    look = jax.vmap(gaze_direction, (0, None))
    gaze = [
        np.asarray(look(Root(pos[rows], rot[rows]), np.float32(clip["gaze"])))
        for clip, rows in zip(training, inner, strict=True)
    ]
    joints = (pose.shape[1] - 6) // 15
    return scale.fit(
        [speech[rows] for rows in inner],
        [pose[rows] for rows in inner],
        gaze,
        joints,
        config.as_released,
        config.speech_columns,
    )


def _check_alike(first: Take, take: Take) -> None:
    """All clips of a corpus share one skeleton and one frame rate."""
    a, b = first.clip, take.clip
    if bvh.rate_hz(a.frame_time) != bvh.rate_hz(b.frame_time):
        raise ValueError(
            f"'{take.entry.bvh}' has {bvh.rate_hz(b.frame_time):g} frames a second, '{first.entry.bvh.name}' "
            f"{bvh.rate_hz(a.frame_time):g}; choose one with --rate."
        )
    expected, found = (list(zip(c.skeleton.names, c.skeleton.parents, strict=True)) for c in (a, b))
    if expected != found:
        differ = [one or other for one, other in zip_longest(expected, found) if one != other]
        raise ValueError(
            f"'{take.entry.bvh}' has {len(found)} joints, '{first.entry.bvh.name}' {len(expected)}, and one "
            f"skeleton was expected; first different joint: '{differ[0][0]}'."
        )


def _save_scales(path: Path, scales: scale.Scales) -> None:
    parts = {kind: part._asdict() for kind, part in scales._asdict().items()}
    partial = path.with_name("partial.npz")
    np.savez(partial, **{f"{kind}.{name}": x for kind, part in parts.items() for name, x in part.items()})
    os.replace(partial, path)


class _ArrayFile:
    """A .npy file that grows along its first axis; complete and under its own name after its `with` block."""

    def __init__(self, path: Path) -> None:
        self.path, self.rows, self.width, self.digest = path, 0, 0, hashlib.sha256()
        self.file = path.with_name(f"{path.name}.partial").open("wb")

    def __enter__(self) -> "_ArrayFile":
        return self

    def append(self, rows: np.ndarray) -> None:
        if self.rows == 0:
            self.width = rows.shape[1]
            self._write_header()
        data = np.ascontiguousarray(rows, "<f4").tobytes()
        self.file.write(data)
        self.digest.update(data)
        self.rows += len(rows)

    def __exit__(self, failed: type | None, *_: object) -> None:
        if failed is None:
            self._write_header()
        self.file.close()
        if failed is None:
            os.replace(self.file.name, self.path)
        else:
            os.unlink(self.file.name)

    def _write_header(self) -> None:
        """NumPy leaves room for the first axis to grow, so the last header fits in the place of the first."""
        self.file.seek(0)
        header = {"descr": "<f4", "fortran_order": False, "shape": (self.rows, self.width)}
        np.lib.format.write_array_header_1_0(self.file, header)
