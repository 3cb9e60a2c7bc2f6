"""Batches for training (ZeroEGGS Sec. 4.2): windows, each with a style example that encompasses it.

Batch k is a pure function of (seed, k): nothing is shuffled or remembered, so training resumes anywhere.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, Int, Int32

from zeggs_jax.data.draws import PAPER, Draws, Spread, WindowConfig, augmentation, draw
from zeggs_jax.data.prepared import Prepared
from zeggs_jax.data.rows import example_rows, played_times, released_example_rows, rows_to_play
from zeggs_jax.motion.pose import Pose, Root, from_vector

Values = np.ndarray | Array  # numpy as it is made, of JAX in the step


class Foreign(NamedTuple):
    """Poses of other clips in which bodies begin, so that the style and not the pose says where they go from there."""

    chosen: Bool[Values, "*B"]  # whether the body begins so
    pose: Float32[Values, "*B D"]


class Batch(NamedTuple):
    """B windows of T frames, examples padded to M; shapes depend on the config alone: nothing recompiles."""

    speech: Float32[Values, "B T S"]
    poses: Pose  # [B, T, ...]
    gaze: Float32[Values, "B 3"]  # cm, world
    example: Float32[Values, "B M D"]  # unscaled pose vectors without gaze; zeros behind example_length
    example_length: Int32[Values, " B"]
    label: Int32[Values, " B"]
    foreign: Foreign | None = None  # None: every body begins in its own first pose


class Piece(NamedTuple):
    """R frames of one clip, as a prepared corpus stores them."""

    speech: Float[Values, "*B R S"]
    pose: Float[Values, "*B R D"]  # pose vectors, see motion/pose.py
    root_pos: Float[Values, "*B R 3"]  # cm, world
    root_rot: Float[Values, "*B R 4"]  # world


class Located(NamedTuple):
    """The same, where the whole corpus is on the device (`pack`): rows of it, to be gathered inside the step."""

    row: Int32[Values, "*B R"]  # the corpus's length: a row of zeros


class Times(NamedTuple):
    """When the F - 1 frames of a played piece are, and the one before them: `row + weight`, in frames of the piece."""

    pace: Float[Values, "*B"]  # apart; where a clip starts, the time before is that of its first frame
    row: Int[Values, "*B F"]
    weight: Float[Values, "*B F"]  # 0 to 1


class Recorded(NamedTuple):
    """What a batch is made of by `augment.augment`: B examples as they are in the corpus, padded to R frames."""

    piece: Piece | Located
    gaze: Float32[Values, "B 3"]
    label: Int32[Values, " B"]
    start: Int32[Values, " B"]  # frame of the example at which its window starts
    length: Int32[Values, " B"]  # of the example
    mirrored: Bool[Values, " B"] | None  # None: no batch of the run has mirrored windows
    times: Times | None  # None: none is played at another pace
    foreign: Foreign | None = None


def batch(
    prepared: Prepared,
    seed: int,
    k: int,
    config: WindowConfig = PAPER,
    split: str = "train",
    share: tuple[int, int] = (0, 1),
    resident: bool = False,
) -> Batch | Recorded:
    """Batch number k: windows drawn evenly from all clips of the split, example lengths from all even ones.

    `share` (i, n) gives the i-th of n equal parts of the batch, and makes no more than that. An example lies
    around its window, shifted where the clip ends, and shorter than drawn only where the whole clip is.
    Where the windows are to be mirrored or played at another pace (ZeroEGGS Sec. 4.1; the training split's
    only), with their examples, speech and gaze, they come as `Recorded`, and the step augments them. `resident`: as
    `Recorded` too, whose pieces the step gathers from the packed corpus. Raises ValueError when no clip of the split is
    as long as a window, when the batch has no n equal parts, or when windows as released are to be resident.
    """
    if resident and config.as_released:
        raise ValueError("Windows as released are not gathered on the device; leave out resident or as_released.")
    spread = augmentation(config, prepared, split)
    drawn = draw(prepared, seed, k, config, split)
    part = _part(config.batch, share)
    if resident or any(spread):
        return _recorded(prepared, drawn, part, config, spread, resident)
    return _plain(prepared, drawn, part, config)


def pack(prepared: Prepared) -> Piece:
    """All frames of the corpus and a row of zeros, for the device."""
    return Piece(*(np.concatenate([x, np.zeros_like(x[:1])], dtype=np.float32) for x in _arrays(prepared)))


def gather(packed: Piece, located: Located) -> Piece:
    """The frames of a piece, or of a batch of them."""
    return Piece(*(jnp.take(x, located.row, axis=0, mode="clip") for x in packed))


def _part(size: int, share: tuple[int, int]) -> range:
    """Rows of a batch that make up a share of it."""
    index, count = share
    if not 0 <= index < count or size % max(count, 1):
        raise ValueError(
            f"Share {index} of {count} of a batch of {size} windows is none of equal parts; give a batch size that "
            "the number of processes divides."
        )
    return range(size // count * index, size // count * (index + 1))


def _plain(prepared: Prepared, drawn: Draws, part: range, config: WindowConfig) -> Batch:
    """Windows and examples as they are in the corpus."""
    size, example_length = config.window, np.zeros(len(part), np.int32)
    windows = _zeros(prepared, len(part), size)
    example = np.zeros((len(part), config.example[1], prepared.pose.shape[1]), np.float32)

    def fill(b: int) -> None:
        first, clip = int(drawn.first[part[b]]), drawn.clip[part[b]]
        window, whole, length = (first, first + size), _span(prepared.ranges[clip]), int(drawn.length[part[b]])
        if config.as_released:
            rows = released_example_rows(window, whole, len(prepared.pose), length)
        else:
            rows = example_rows(window, whole, length)
        example_length[b] = len(rows)
        in_a_row = slice(rows[0], rows[-1] + 1)
        example[b, : len(rows)] = prepared.pose[rows if config.as_released else in_a_row]
        for frames, made in zip(_arrays(prepared), windows, strict=True):
            made[b] = frames[slice(*window)]

    _each(fill, len(part))
    clips, root = drawn.clip[part], Root(windows.root_pos, windows.root_rot)  # pyright: ignore[reportArgumentType]
    poses = from_vector(windows.pose, root)
    gaze, labels, foreign = prepared.gaze[clips], prepared.labels[clips], _foreign(prepared, drawn, part, config)
    return Batch(windows.speech, poses, gaze, example, example_length, labels, foreign)


def _recorded(
    prepared: Prepared, drawn: Draws, part: range, config: WindowConfig, spread: Spread, resident: bool
) -> Recorded:
    """The frames that examples are made of, or where they are, and when the examples' own are."""
    count, most = len(part), config.example[1]
    frames = rows_to_play(most, 1 + spread.pace) if spread.pace else most
    located = Located(np.full((count, frames), len(prepared.pose), np.int32))
    pieces = located if resident else _zeros(prepared, count, frames)
    start, length = np.zeros(count, np.int32), np.zeros(count, np.int32)
    row, weight = np.zeros((count, most + 1), np.int32), np.zeros((count, most + 1), np.float32)

    def fill(b: int) -> None:
        first, clip = int(drawn.first[part[b]]), drawn.clip[part[b]]
        played, whole = _span(drawn.ranges[clip]), _span(prepared.ranges[clip])
        rows = example_rows((first, first + config.window), played, int(drawn.length[part[b]]))
        start[b], length[b] = first - rows[0], len(rows)
        if spread.pace:
            at = played_times(int(rows[0]) - played[0], len(rows), most, drawn.pace)
            row[b], weight[b] = at.astype(np.int32), at % 1
            rows = np.arange(row[b, 0], row[b, -1] + 2) + whole[0]
            row[b] -= row[b, 0]
        taken = slice(rows[0], min(rows[-1] + 1, whole[1]))
        located.row[b, : taken.stop - taken.start] = np.arange(taken.start, taken.stop)  # pyright: ignore[reportIndexIssue]
        if isinstance(pieces, Piece):
            for frames, made in zip(_arrays(prepared), pieces, strict=True):
                made[b, : taken.stop - taken.start] = frames[taken]

    _each(fill, count)
    clips, pace = drawn.clip[part], np.full(count, drawn.pace, np.float32)
    return Recorded(
        piece=pieces,
        gaze=prepared.gaze[clips],
        label=prepared.labels[clips],
        start=start,
        length=length,
        mirrored=drawn.mirrored[part] if spread.mirror else None,
        times=Times(pace, row, weight) if spread.pace else None,
        foreign=_foreign(prepared, drawn, part, config),
    )


def _foreign(prepared: Prepared, drawn: Draws, part: range, config: WindowConfig) -> Foreign | None:
    if not config.foreign_start:
        return None
    return Foreign(drawn.foreign[part], np.asarray(prepared.pose[drawn.elsewhere[part]], np.float32))


def _each(fill: Callable[[int], None], count: int) -> None:
    with ThreadPoolExecutor() as pool:  # copying leaves Python's lock free
        list(pool.map(fill, range(count)))


def _span(ends: Int32[np.ndarray, "2"]) -> tuple[int, int]:
    return int(ends[0]), int(ends[1])


def _arrays(prepared: Prepared) -> Piece:
    return Piece(prepared.speech, prepared.pose, prepared.root_pos, prepared.root_rot)


def _zeros(prepared: Prepared, count: int, frames: int) -> Piece:
    return Piece(*(np.zeros((count, frames, x.shape[1]), np.float32) for x in _arrays(prepared)))
