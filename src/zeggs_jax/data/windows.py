"""Batches for training (ZeroEGGS Sec. 4.2): windows, each with a style example that encompasses it.

Batch k is a pure function of (seed, k): nothing is shuffled or remembered, so training resumes anywhere.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int32

from zeggs_jax.data import augment
from zeggs_jax.data.augment import Piece
from zeggs_jax.data.draws import PAPER, Draws, WindowConfig, draw
from zeggs_jax.data.prepared import Prepared
from zeggs_jax.data.rows import example_rows, released_example_rows
from zeggs_jax.motion.pose import Pose, Root, from_vector


class Batch(NamedTuple):
    """B windows of T frames, examples padded to M; shapes depend on the config alone: nothing recompiles."""

    speech: Float32[np.ndarray, "B T S"]
    poses: Pose  # [B, T, ...]
    gaze: Float32[np.ndarray, "B 3"]  # cm, world
    example: Float32[np.ndarray, "B M D"]  # unscaled pose vectors without gaze; zeros behind example_length
    example_length: Int32[np.ndarray, " B"]
    label: Int32[np.ndarray, " B"]


def batch(
    prepared: Prepared,
    seed: int,
    k: int,
    config: WindowConfig = PAPER,
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
    drawn = draw(prepared, seed, k, config, split)
    part = _part(config.batch, share)
    clips, mirrored = drawn.clip[part], drawn.mirrored[part]
    count, (_, longest) = len(clips), config.example
    windows = [np.zeros((count, config.window, x.shape[1]), np.float32) for x in _arrays(prepared)]
    example = np.zeros((count, longest, prepared.pose.shape[1]), np.float32)
    example_length = np.zeros(count, np.int32)
    across = prepared.across
    image = augment.mirror_of(prepared.skeleton, across) if mirrored.any() and across else None

    def fill(b: int) -> None:
        piece, start = _piece(prepared, drawn, part.start + b, config)
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


def _part(size: int, share: tuple[int, int]) -> slice:
    """Rows of a batch that make up a share of it."""
    index, count = share
    if not 0 <= index < count or size % max(count, 1):
        raise ValueError(
            f"Share {index} of {count} of a batch of {size} windows is none of equal parts; give a batch size that "
            "the number of processes divides."
        )
    return slice(size // count * index, size // count * (index + 1))


def _piece(prepared: Prepared, drawn: Draws, b: int, config: WindowConfig) -> tuple[Piece, int]:
    """The frames of an example, and at which of them its window starts."""
    clip, first = drawn.clip[b], int(drawn.first[b])
    start, stop = (int(row) for row in drawn.ranges[clip])
    window, length = (first, first + config.window), int(drawn.length[b])
    if config.as_released:
        rows = released_example_rows(window, (start, stop), len(prepared.pose), length)
    else:
        rows = example_rows(window, (start, stop), length)
    offset = first - int(rows[0])
    if drawn.pace == 1.0:
        return Piece(*(x[rows] for x in _arrays(prepared))), offset
    at = (np.arange(rows[0] - 1, rows[-1] + 1) - start) * drawn.pace
    whole = slice(start, int(prepared.ranges[clip, 1]))
    clip_rows = Piece(*(x[whole] for x in _arrays(prepared)))
    return augment.play(clip_rows, at, drawn.pace, prepared.frame_time, config.example[1]), offset


def _arrays(prepared: Prepared) -> Piece:
    return Piece(prepared.speech, prepared.pose, prepared.root_pos, prepared.root_rot)
