"""Mean and standard deviation as a pytree: networks see scaled values, all else is in cm, s, rad."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from zeggs_jax.data.statistics import Moments, total


class Scale(NamedTuple):
    """Statistics of one kind of vector; `std` may be one number for all columns."""

    mean: Float[ArrayLike, " n"]
    std: Float[ArrayLike, " n"] | Float[ArrayLike, ""]


class Scales(NamedTuple):
    """All statistics that a model carries, by the conventions of the release: its own files are drop-in.

    speech:   one std for all columns together (the energy's offset dominates it, so scaled mels are tiny)
    pose_in:  6 + 15J + 3 columns (pose vector, gaze in the root's frame); one std per group of columns
    pose_out: 6 + 15J columns; one std per column, 0 where a column never changes
    """

    speech: Scale
    pose_in: Scale
    pose_out: Scale


def apply(scale: Scale, x: Float[ArrayLike, "*b n"]) -> Float[Array, "*b n"]:
    """Physical -> scaled values; not finite where the std is 0, so `pose_out` is only ever inverted."""
    x = jnp.asarray(x)
    return (x - jnp.broadcast_to(scale.mean, x.shape)) / jnp.broadcast_to(scale.std, x.shape)


def invert(scale: Scale, x: Float[ArrayLike, "*b n"]) -> Float[Array, "*b n"]:
    """Scaled values -> physical values."""
    x = jnp.asarray(x)
    return x * jnp.broadcast_to(scale.std, x.shape) + jnp.broadcast_to(scale.mean, x.shape)


Blocks = Sequence[np.ndarray]  # one [T, n] array per clip, read from disk as it is needed


def fit(
    speech: Blocks,
    pose: Blocks,
    gaze: Blocks,
    joints: int,
    as_released: bool = False,
    speech_columns: bool = False,
) -> Scales:
    """All scales of a training set from its speech rows, pose vectors, and gaze directions (root frame).

    `speech_columns` gives every speech feature a std of its own. The release has one for all 81, which the
    energy's offset dominates, so that its networks see mels of about +-0.06.
    """
    columns = tuple(fit_columns(blocks, True) for blocks in (speech, pose, gaze)) if as_released else None
    return from_moments(total(speech), total(pose), total(gaze), joints, speech_columns, columns)


def from_moments(
    speech: Moments,
    pose: Moments,
    gaze: Moments,
    joints: int,
    speech_columns: bool = False,
    columns: tuple[Scale, ...] | None = None,
) -> Scales:
    """As `fit`, of the moments of those rows; `columns` are the means and stds of all three where not theirs."""
    heard, posed, looked = columns or tuple(map(_columns, (speech, pose, gaze)))
    groups = [3, 3, 3 * joints, 6 * joints, 3 * joints, 3 * joints]  # the fields of a pose vector, motion/pose.py
    one_std = np.float32(_groups(speech, [len(speech.mean)])[0])
    speech_std = np.maximum(heard.std, np.float32(1e-6)) if speech_columns else one_std
    pose_std = np.concatenate([_groups(pose, groups), _groups(gaze, [3])]) + 1e-10
    pose_in = Scale(np.concatenate([posed.mean, looked.mean]), pose_std.astype(np.float32))
    return Scales(Scale(heard.mean, speech_std), pose_in, posed)


def fit_columns(blocks: Blocks, as_released: bool = False) -> Scale:
    """Mean and std of every column over the rows of all blocks.

    In float64; `as_released` sums row after row in float32, whose error the release's statistics contain
    (1.5 % of the bone offsets at its size).
    """
    if not as_released:
        return _columns(total(blocks))
    rows = np.float32(sum(len(block) for block in blocks))
    mean = _sum_rows(blocks) / rows
    variance = _sum_rows((block - mean) ** 2 for block in blocks) / rows
    return Scale(mean, np.sqrt(variance))


def _columns(moments: Moments) -> Scale:
    """Mean and std of every column."""
    std = np.sqrt(moments.squares / moments.count)
    return Scale(moments.mean.astype(np.float32), std.astype(np.float32))


def _groups(moments: Moments, sizes: Sequence[int]) -> Float[np.ndarray, " n"]:
    """One std per group of neighbouring columns, over all its values together; repeated for each column."""
    variance, stds = moments.squares / moments.count, []
    for start, stop in pairwise(np.cumsum([0, *sizes])):
        between = np.var(moments.mean[start:stop])
        stds.append(np.full(stop - start, np.sqrt(variance[start:stop].mean() + between)))
    return np.concatenate(stds)


def _sum_rows(blocks: Iterable[np.ndarray]) -> np.ndarray:
    """Sum over the rows of all blocks, one row after the other, in float32."""
    blocks = iter(blocks)
    total = np.add.reduce(next(blocks), axis=0, dtype=np.float32)
    for block in blocks:
        total = np.add.reduce(np.concatenate([total[None], block]), axis=0, dtype=np.float32)
    return total
