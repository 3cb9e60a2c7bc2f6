"""Batches for training (ZeroEGGS Sec. 4.2): windows, each with a style example that encompasses it.

Batch k is a pure function of (seed, k): nothing is shuffled or remembered, so training resumes anywhere.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int32

from zeggs_jax.data.prepared import Prepared
from zeggs_jax.motion.pose import Pose, Root, from_vector

_unpack = jax.jit(from_vector)  # half the time of the bare function; shapes never change


class Batch(NamedTuple):
    """B windows of T frames, examples padded to M; shapes depend on the config alone: nothing recompiles."""

    speech: Float32[np.ndarray, "B T S"]
    poses: Pose  # [B, T, ...]
    gaze: Float32[np.ndarray, "B 3"]  # cm, world
    example: Float32[np.ndarray, "B M D"]  # unscaled pose vectors without gaze; zeros behind example_length
    example_length: Int32[np.ndarray, " B"]
    label: Int32[np.ndarray, " B"]


@dataclass(frozen=True)
class WindowConfig:
    """Sizes in frames; the defaults are the paper's."""

    batch: int = 32
    window: int = 256
    example: tuple[int, int] = (256, 512)  # shortest and longest, even
    as_released: bool = False  # one length per batch, examples that reach a frame into the next clip

    def __post_init__(self) -> None:
        low, high = self.example
        if not 0 < self.window <= low <= high or low % 2 or high % 2 or self.batch < 1:
            raise ValueError(
                f"Windows of {self.window} frames with examples of {low} to {high} do not fit; give examples "
                "even lengths of at least the window."
            )


def batch(prepared: Prepared, seed: int, k: int, config: WindowConfig = WindowConfig(), split: str = "train") -> Batch:
    """Batch number k: windows drawn evenly from all clips of the split, example lengths from all even ones.

    An example lies around its window, shifted where the clip ends, and shorter than drawn only where the
    whole clip is. Raises ValueError when no clip of the split is as long as a window.
    """
    random = np.random.default_rng((seed, k))
    clips, first = _draw_windows(prepared, random, config, split)
    low, high = config.example
    lengths = 2 * random.integers(low // 2, high // 2, size=config.batch, endpoint=True)
    if config.as_released:
        lengths[:] = low if k == 0 else lengths[0]
    example = np.zeros((config.batch, high, prepared.pose.shape[1]), np.float32)
    example_length = np.zeros(config.batch, np.int32)
    for b, (clip, start, length) in enumerate(zip(clips, first, lengths, strict=True)):
        window = (int(start), int(start) + config.window)
        rows = _rows(window, prepared.ranges[clip], len(prepared.pose), int(length), config.as_released)
        example_length[b] = len(rows)
        example[b, : len(rows)] = prepared.pose[rows]
    windows = [slice(start, start + config.window) for start in first]
    root = Root(*(jnp.asarray(np.stack([x[w] for w in windows])) for x in (prepared.root_pos, prepared.root_rot)))
    return Batch(
        speech=np.stack([prepared.speech[w] for w in windows]),
        poses=_unpack(np.stack([prepared.pose[w] for w in windows]), root),
        gaze=prepared.gaze[clips],
        example=example,
        example_length=example_length,
        label=prepared.labels[clips],
    )


def window_count(ranges: Int32[np.ndarray, "C 2"], window: int, as_released: bool = False) -> Int32[np.ndarray, " C"]:
    """Windows in each clip; the release never uses a clip's last frame, nor a clip of just one window."""
    frames = ranges[:, 1] - ranges[:, 0]
    return np.maximum(frames - window + (0 if as_released else 1), 0).astype(np.int32)


def example_rows(window: tuple[int, int], clip: tuple[int, int], length: int) -> Int32[np.ndarray, " m"]:
    """Frames of the example around a window [start, stop): `length` within the clip, or the whole clip."""
    start = window[0] - (length - (window[1] - window[0])) // 2
    start = max(clip[0], min(start, clip[1] - length))
    return np.arange(start, min(start + length, clip[1]), dtype=np.int32)


def released_example_rows(
    window: tuple[int, int], clip: tuple[int, int], frames: int, length: int
) -> Int32[np.ndarray, " m"]:
    """The release's choice: may hold the next clip's first frame; the tail comes twice where it is short.

    `frames` is the number of rows of the whole corpus.
    """
    first, last = window[0], window[1] - 1
    margin = (length - (window[1] - window[0])) // 2
    before, after = min(margin, first - clip[0]), min(margin, clip[1] - last)
    start = max(first - (before + margin - after), clip[0])
    stop = min(min(last + (after + margin - before), clip[1]) + 1, frames)
    rows = np.arange(start, stop, dtype=np.int32)
    missing = length - len(rows)
    return np.concatenate([rows, rows[-missing:]]) if missing > 0 else rows


def _rows(window, clip, frames: int, length: int, as_released: bool) -> np.ndarray:
    clip = (int(clip[0]), int(clip[1]))
    if as_released:
        return released_example_rows(window, clip, frames, length)
    return example_rows(window, clip, length)


def _draw_windows(
    prepared: Prepared, random: np.random.Generator, config: WindowConfig, split: str
) -> tuple[np.ndarray, np.ndarray]:
    """Clip and first frame of each window of a batch."""
    clips = prepared.clips(split)
    ranges = prepared.ranges[clips].reshape(-1, 2)
    ends = np.cumsum(window_count(ranges, config.window, config.as_released), dtype=np.int64)
    if not len(ends) or ends[-1] == 0:
        longest = int((ranges[:, 1] - ranges[:, 0]).max(initial=0))
        raise ValueError(
            f"No {split} clip of '{prepared.folder}' holds a window of {config.window} frames, the longest "
            f"has {longest}; use a shorter window or longer clips."
        )
    index = random.integers(ends[-1], size=config.batch)
    of = np.searchsorted(ends, index, side="right")
    first = ranges[of, 0] + index - np.concatenate([[0], ends])[of]
    return clips[of], first
