"""What batch k is made of: windows, lengths of their examples, mirror and pace; all of a batch's randomness."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int32, Int64

from zeggs_jax.data.prepared import Prepared
from zeggs_jax.data.rows import played_ranges, window_count

MIRROR, PACE = 0.5, 0.1  # the paper's: as many mirrored windows as not, +-10 %


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
    foreign_start: float = 0.0  # share of windows whose body begins in the pose of another clip (ours, not the paper's)

    def __post_init__(self) -> None:
        low, high = self.example
        if self.window < 2:
            raise ValueError(f"Windows of {self.window} frames show no movement; give at least 2.")
        if not 0 < self.window <= low <= high or low % 2 or high % 2 or self.batch < 1:
            raise ValueError(
                f"Windows of {self.window} frames with examples of {low} to {high} do not fit; give examples "
                "even lengths of at least the window."
            )
        for name, value, top in (
            ("mirror", self.mirror, 1.0),
            ("pace", self.pace, 0.5),
            ("foreign_start", self.foreign_start, 1.0),
        ):
            if value is not None and not 0 <= value <= top:
                raise ValueError(f"{name} is {value}; give a number from 0 to {top}.")
        if self.as_released and (self.mirror or self.pace or self.foreign_start):
            raise ValueError(
                "Windows as released are neither mirrored nor paced and begin in their own pose; leave out mirror, "
                "pace and foreign_start."
            )


PAPER = WindowConfig()


class Spread(NamedTuple):
    """How windows are augmented."""

    mirror: float  # share of them that is mirrored
    pace: float  # how far the pace goes from 1


class Draws(NamedTuple):
    """What a batch is made of: all of its randomness."""

    clip: Int32[np.ndarray, " B"]
    first: Int64[np.ndarray, " B"]  # row of each window's first frame, in clips that are played at the pace
    length: Int64[np.ndarray, " B"]  # of the examples, as drawn
    mirrored: Bool[np.ndarray, " B"]
    pace: float
    ranges: Int32[np.ndarray, "C 2"]  # of the clips, played at the pace
    foreign: Bool[np.ndarray, " B"]  # whether a window's body begins in another clip's pose
    elsewhere: Int64[np.ndarray, " B"]  # row of that pose


def draw(prepared: Prepared, seed: int, k: int, config: WindowConfig, split: str) -> Draws:
    """Everything that is drawn, for the whole batch."""
    mirror, spread = augmentation(config, prepared, split)
    random, other = np.random.default_rng((seed, k)), np.random.default_rng((seed, k, 1))
    mirrored, faster = other.random(config.batch) < mirror, float(other.uniform(-1, 1))
    pace = 1.0 + spread * faster
    ranges, longest = prepared.ranges, _longest(prepared, config, split)
    if spread:  # one at which the longest clip still holds a window
        pace = min(pace, (longest - 1) / max(config.window - 1, 1))
        ranges = played_ranges(ranges, pace)
    clips, first = _draw_windows(ranges, prepared.clips(split), random, config)
    low, high = config.example
    lengths = 2 * random.integers(low // 2, high // 2, size=config.batch, endpoint=True)
    if config.as_released:
        lengths[:] = low if k == 0 else lengths[0]
    return Draws(clips, first, lengths, mirrored, pace, ranges, *_draw_starts(prepared, seed, k, config, split))


def _draw_starts(
    prepared: Prepared, seed: int, k: int, config: WindowConfig, split: str
) -> tuple[Bool[np.ndarray, " B"], Int64[np.ndarray, " B"]]:
    """Which windows begin in another pose, and the rows of those: any frame of any clip, all clips alike."""
    random = np.random.default_rng((seed, k, 2))
    chosen = random.random(config.batch) < (config.foreign_start if split == "train" else 0.0)
    begin, end = prepared.ranges[random.choice(prepared.clips(split), config.batch)].T
    return chosen, random.integers(begin, end, dtype=np.int64)


def augmentation(config: WindowConfig, prepared: Prepared, split: str = "train") -> Spread:
    """What the config asks for, once None is decided; nothing for other splits than the training's."""
    as_released = config.as_released or bool(prepared.config.get("as_released"))
    if split != "train":
        return Spread(0.0, 0.0)
    across = prepared.across
    if config.mirror and across is None:
        raise ValueError(
            f"The body of '{prepared.folder}' has joints without a counterpart on the other side, so its windows "
            "cannot be mirrored; set windows.mirror to 0 or leave it out."
        )
    mirror = config.mirror if config.mirror is not None else 0.0 if as_released or across is None else MIRROR
    return Spread(mirror, config.pace if config.pace is not None else 0.0 if as_released else PACE)


def _longest(prepared: Prepared, config: WindowConfig, split: str) -> int:
    """Frames of the split's longest clip, which must hold a window as it is."""
    ranges = prepared.ranges[prepared.clips(split)].reshape(-1, 2)
    longest = int((ranges[:, 1] - ranges[:, 0]).max(initial=0))
    if not window_count(ranges, config.window, config.as_released).any():
        raise ValueError(
            f"No {split} clip of '{prepared.folder}' holds a window of {config.window} frames, the longest "
            f"has {longest}; use a shorter window or longer clips."
        )
    return longest


def _draw_windows(
    ranges: Int32[np.ndarray, "C 2"], clips: Int32[np.ndarray, " c"], random: np.random.Generator, config: WindowConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Clip and first frame of each window of a batch: all windows of all `clips` are drawn alike."""
    ends = np.cumsum(window_count(ranges[clips], config.window, config.as_released), dtype=np.int64)
    index = random.integers(ends[-1], size=config.batch)
    of = np.searchsorted(ends, index, side="right")
    return clips[of], ranges[clips[of], 0] + index - np.concatenate([[0], ends])[of]
