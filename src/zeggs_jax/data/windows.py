"""Batches for training (ZeroEGGS Sec. 4.2): windows, each with a style example that encompasses it.

Batch k is a pure function of (seed, k): nothing is shuffled or remembered, so training resumes anywhere.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64

from zeggs_jax.data import augment
from zeggs_jax.data.augment import Piece
from zeggs_jax.data.prepared import Prepared
from zeggs_jax.motion.pose import Pose, Root, from_vector

MIRROR, PACE = 0.5, 0.1  # the paper's: as many mirrored windows as not, +-10 %


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
    """Sizes in frames; the defaults are the paper's.

    Only the training split is augmented. None is the paper's share or pace; for windows or a corpus as
    released it is 0 (the release's corpus brings its own copies), as is the mirror of a body without sides.
    """

    batch: int = 32
    window: int = 256
    example: tuple[int, int] = (256, 512)  # shortest and longest, even
    as_released: bool = False  # one length per batch, examples that reach a frame into the next clip
    mirror: float | None = None  # share of windows that are mirrored; None: 0.5
    pace: float | None = None  # each batch is played at a pace drawn from 1 +- this; None: 0.1

    def __post_init__(self) -> None:
        low, high = self.example
        if not 0 < self.window <= low <= high or low % 2 or high % 2 or self.batch < 1:
            raise ValueError(
                f"Windows of {self.window} frames with examples of {low} to {high} do not fit; give examples "
                "even lengths of at least the window."
            )
        for name, value, top in (("mirror", self.mirror, 1.0), ("pace", self.pace, 0.5)):
            if value is not None and not 0 <= value <= top:
                raise ValueError(f"{name} is {value}; give a number from 0 to {top}.")
        if self.as_released and (self.mirror or self.pace):
            raise ValueError("Windows as released are neither mirrored nor paced; leave out mirror and pace.")


class _Plan(NamedTuple):
    """What a batch is made of: all of its randomness."""

    clip: Int32[np.ndarray, " B"]
    first: Int64[np.ndarray, " B"]  # row of each window's first frame, in clips that are played at the pace
    length: Int64[np.ndarray, " B"]  # of the examples, as drawn
    mirrored: Bool[np.ndarray, " B"]
    pace: float
    ranges: Int32[np.ndarray, "C 2"]  # of the clips, played at the pace


def batch(
    prepared: Prepared,
    seed: int,
    k: int,
    config: WindowConfig = WindowConfig(),
    split: str = "train",
    share: tuple[int, int] = (0, 1),
) -> Batch:
    """Batch number k: windows drawn evenly from all clips of the split, example lengths from all even ones.

    `share` (i, n) gives the i-th of n equal parts of the batch, and makes no more than that. An example lies
    around its window, shifted where the clip ends, and shorter than drawn only where the whole clip is.
    Windows of the training split are mirrored and played at another pace (ZeroEGGS Sec. 4.1), with their
    examples, speech and gaze. Raises ValueError when no clip of the split is as long as a window, or when the
    batch has no n equal parts.
    """
    plan = _plan(prepared, seed, k, config, split)
    part = _part(config.batch, share)
    clips, mirrored = plan.clip[part], plan.mirrored[part]
    count, (_, longest) = len(clips), config.example
    windows = [np.zeros((count, config.window, x.shape[1]), np.float32) for x in _arrays(prepared)]
    example = np.zeros((count, longest, prepared.pose.shape[1]), np.float32)
    example_length = np.zeros(count, np.int32)
    across = _across(prepared)
    image = augment.mirror_of(prepared.skeleton, across) if mirrored.any() and across else None

    def fill(b: int) -> None:
        piece, start = _piece(prepared, plan, part.start + b, config)
        piece = augment.mirror(piece, image) if mirrored[b] and image else piece
        example_length[b] = len(piece.pose)
        example[b, : len(piece.pose)] = piece.pose
        for window, frames in zip(windows, piece, strict=True):
            window[b] = frames[start : start + config.window]

    with ThreadPoolExecutor() as pool:  # copying leaves Python's lock free
        list(pool.map(fill, range(count)))
    speech, pose, pos, rot = windows
    flip = np.where(mirrored[:, None], np.array([-1, 1, 1], np.float32), np.float32(1))
    return Batch(
        speech=speech,
        poses=from_vector(pose, Root(pos, rot)),  # pyright: ignore[reportArgumentType]  numpy, not yet on a device
        gaze=prepared.gaze[clips] * flip,
        example=example,
        example_length=example_length,
        label=prepared.labels[clips],
    )


def augmentation(config: WindowConfig, prepared: Prepared, split: str = "train") -> tuple[float, float]:
    """Share of windows that are mirrored, and how far the pace goes from 1, once None is decided."""
    as_released = config.as_released or bool(prepared.config.get("as_released"))
    if split != "train":
        return 0.0, 0.0
    across = _across(prepared)
    if config.mirror and across is None:
        raise ValueError(
            f"The body of '{prepared.folder}' has joints without a counterpart on the other side, so its windows "
            "cannot be mirrored; set windows.mirror to 0 or leave it out."
        )
    mirror = config.mirror if config.mirror is not None else 0.0 if as_released or across is None else MIRROR
    return mirror, config.pace if config.pace is not None else 0.0 if as_released else PACE


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


def _part(size: int, share: tuple[int, int]) -> slice:
    """Rows of a batch that make up a share of it."""
    index, count = share
    if not 0 <= index < count or size % max(count, 1):
        raise ValueError(
            f"Share {index} of {count} of a batch of {size} windows is none of equal parts; give a batch size that "
            "the number of processes divides."
        )
    return slice(size // count * index, size // count * (index + 1))


def _plan(prepared: Prepared, seed: int, k: int, config: WindowConfig, split: str) -> _Plan:
    """Everything that is drawn, for the whole batch."""
    mirror, spread = augmentation(config, prepared, split)
    random, other = np.random.default_rng((seed, k)), np.random.default_rng((seed, k, 1))
    mirrored, faster = other.random(config.batch) < mirror, float(other.uniform(-1, 1))
    pace = 1.0 + spread * faster
    ranges = prepared.ranges
    if pace != 1.0:  # a pace at which some clip still holds a window
        longest = int(np.diff(ranges[prepared.clips(split)]).max(initial=0))
        pace = min(pace, (max(longest, config.window) - 1) / max(config.window - 1, 1))
        ranges = augment.played_ranges(ranges, pace)
    clips, first = _draw_windows(prepared, ranges, random, config, split)
    low, high = config.example
    lengths = 2 * random.integers(low // 2, high // 2, size=config.batch, endpoint=True)
    if config.as_released:
        lengths[:] = low if k == 0 else lengths[0]
    return _Plan(clips, first, lengths, mirrored, pace, ranges)


def _piece(prepared: Prepared, plan: _Plan, b: int, config: WindowConfig) -> tuple[Piece, int]:
    """The frames of an example, and at which of them its window starts."""
    clip, first = plan.clip[b], int(plan.first[b])
    start, stop = (int(row) for row in plan.ranges[clip])
    window, length = (first, first + config.window), int(plan.length[b])
    if config.as_released:
        rows = released_example_rows(window, (start, stop), len(prepared.pose), length)
    else:
        rows = example_rows(window, (start, stop), length)
    offset = first - int(rows[0])
    if plan.pace == 1.0:
        return Piece(*(x[rows] for x in _arrays(prepared))), offset
    at = (np.arange(rows[0] - 1, rows[-1] + 1) - start) * plan.pace
    whole = slice(start, int(prepared.ranges[clip, 1]))
    clip_rows = Piece(*(x[whole] for x in _arrays(prepared)))
    return augment.paced(clip_rows, at, plan.pace, prepared.frame_time, config.example[1]), offset


def _arrays(prepared: Prepared) -> Piece:
    return Piece(prepared.speech, prepared.pose, prepared.root_pos, prepared.root_rot)


def _across(prepared: Prepared) -> tuple[int, ...] | None:
    try:
        return prepared.skeleton.mirror_map()
    except ValueError:
        return None


def _draw_windows(
    prepared: Prepared, ranges: Int32[np.ndarray, "C 2"], random: np.random.Generator, config: WindowConfig, split: str
) -> tuple[np.ndarray, np.ndarray]:
    """Clip and first frame of each window of a batch, in clips with these ranges."""
    clips = prepared.clips(split)
    ranges = ranges[clips].reshape(-1, 2)
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
