"""Which frames of a clip make a window, a style example around it, and the clip played at another pace."""

import math

import numpy as np
from jaxtyping import Float64, Int32


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


def played_ranges(ranges: Int32[np.ndarray, "C 2"], pace: float) -> Int32[np.ndarray, "C 2"]:
    """First and last row + 1 of every clip as if it were played at `pace` from its first row on."""
    frames = np.floor((ranges[:, 1] - ranges[:, 0] - 1) / pace + 1e-9).astype(np.int32) + 1
    return np.stack([ranges[:, 0], ranges[:, 0] + frames], axis=1)


def rows_to_play(frames: int, pace: float) -> int:
    """Rows of a clip at most that lie around so many played frames and the one before them."""
    return math.floor(frames * pace) + 3


def played_times(first: int, frames: int, most: int, pace: float) -> Float64[np.ndarray, " F"]:
    """When `frames` frames of a played clip are, from frame `first` on, in frames of the clip as it is.

    The time of the frame before comes first, that of the last frame again and again up to `most`.
    """
    number = np.minimum(np.arange(most + 1), frames) + (first - 1)
    return np.maximum(number, 0) * pace
