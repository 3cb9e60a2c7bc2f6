"""Where one style turns into another: the peak acceleration of any joint there, and what it is in the truth."""

from collections.abc import Sequence

import numpy as np

from zeggs_jax.metrics import kinematic
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.motion import bvh
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.zeroeggs.timeline import Cue, Timeline

WINDOW_S = 2.0  # a peak is looked for in so long from the cue on
SECONDS, STYLES = 60.0, 5  # of a timeline
KINDS: dict[str, tuple[str, float]] = {
    "smooth, 2 s": ("smooth", 2.0),
    "smooth, 1 s": ("smooth", 1.0),
    "smooth, 0.5 s": ("smooth", 0.5),
    "linear, 1 s": ("linear", 1.0),
    "hard": ("hard", 0.0),
}  # fmt: skip

DEFAULT = "smooth, 1 s"  # what a cue has that says nothing else

Peaks = dict[str, list[float]]  # cm/s^2, one for each window, by part of the body


def begins(count: int = STYLES, seconds: float = SECONDS) -> list[float]:
    """Times of the cues: the styles share the speech equally, s."""
    return [seconds * k / count for k in range(count)]


def of_styles(styles: Sequence[str], kind: str) -> Timeline:
    """One style after the other, with transitions of one of the KINDS."""
    curve, transition = KINDS[kind]
    times = begins(len(styles))
    return Timeline(
        tuple(Cue(t, ((s, 1.0),), transition, curve) for t, s in zip(times, styles, strict=True))  # pyright: ignore
    )


def orders(styles: Sequence[str], count: int, seed: int = 3) -> list[list[str]]:
    """`count` draws of STYLES styles, each in its own order."""
    draw = np.random.default_rng(seed)
    return [list(draw.permutation(list(styles)))[:STYLES] for _ in range(count)]


def parts(skeleton: Skeleton) -> dict[str, list[int]]:
    """Joints by part: a jolt of the trunk is smaller than what hands and fingers do all the time."""
    start = skeleton.path(skeleton.role("hips"))[:-1]
    trunk = [joint for joint in skeleton.path(skeleton.role("head")) if joint not in start]
    return {"any joint": list(range(len(skeleton))), "trunk and head": trunk}


def peaks(clip: Clip, times: Sequence[float]) -> Peaks:
    """Largest acceleration of any joint of a part, in world, in the window that begins at each time, cm/s^2.

    Acceleration is the second difference times rate squared. A window begins a frame early: in the difference of the
    frames t - 2, t - 1 and t a jump at t shows first.
    """
    return peaks_of(Movement(kinematic.world_positions(clip), bvh.rate_hz(clip.frame_time), clip.skeleton), times)


def peaks_of(motion: Movement, times: Sequence[float]) -> Peaks:
    """`peaks` of joint positions."""
    rate_hz = motion.rate_hz
    found = kinematic.derivative(motion.positions, rate_hz, 2)
    ends = [(max(round(time * rate_hz) - 2, 0), round((time + WINDOW_S) * rate_hz) - 1) for time in times]
    return {
        part: [float(found[first:last, joints].max()) for first, last in ends]
        for part, joints in parts(motion.skeleton).items()
    }


def all_peaks(clip: Clip) -> Peaks:
    """The same of all windows of a clip, one after the other."""
    seconds = len(clip.euler) / bvh.rate_hz(clip.frame_time)
    return peaks(clip, np.arange(0.0, seconds - WINDOW_S + 1e-6, WINDOW_S).tolist())
