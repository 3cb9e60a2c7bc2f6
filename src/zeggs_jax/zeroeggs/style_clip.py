"""A style example (Fig. 3b, left): a BVH clip read as in training and encoded, as one entry of a style library."""

import difflib
from collections.abc import Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jax.typing import ArrayLike

from ..data.body import normalise_like
from ..data.scale import Scales
from ..motion import bvh, edit, features, pose
from ..motion.bvh import Clip
from ..motion.features import Motion
from ..motion.pose import Pose
from .config import ZeroEggsConfig
from .model import Model, Params, StyleDistribution, encode_style

PADDING = 300  # frames: examples are padded to a multiple of this, so that few lengths compile
Frames = tuple[int, int]


class Entry(NamedTuple):
    """One style, as far as a model knows it, and the pose from which its motion can start."""

    name: str  # of its own in a library
    style: str  # the label that it shares with other clips of its style
    source: str  # the file it was made from, or what else it is
    frames: Frames | None  # [start, stop) of the clip; None: all of it
    distribution: StyleDistribution  # mean[Z], log_var[Z] or None
    start: Motion | None  # its first frame (leading axis 1) and gaze


def bundled_clips() -> dict[str, Path]:
    """The style clips that come with the package, by name."""
    folder = Path(str(files("zeggs_jax.zeroeggs") / "pretrained" / "styles"))
    return {path.stem: path for path in sorted(folder.glob("*.bvh"))}


def near(name: str, known: Sequence[str]) -> str:
    """The known names that are spelled most like `name`, or the first of all, as a list for a sentence."""
    spelled = {k.lower(): k for k in known}
    close = difflib.get_close_matches(name.lower(), spelled, n=3, cutoff=0.4)
    return ", ".join([spelled[k] for k in close] or list(known)[:12])


def read_clip(path: Path, model: Model, frames: Frames | None = None) -> Entry:
    """Encodes a BVH clip, or its `frames` counted in its own, as a style; its name and label are the file's."""
    motion = read_motion(path, model, frames)
    return Entry(path.stem, path.stem, str(path), frames, encode(model, motion), first(motion))


def read_motion(path: str | Path, model: Model, frames: Frames | None = None, what: str = "style example") -> Motion:
    """The motion features of a BVH clip, cut to `frames`, read as in training, at the model's frame rate.

    Errors say `what` it is.
    """
    return fit(bvh.read(path), Path(path).name, model, frames, what)


def fit(clip: Clip, name: str, model: Model, frames: Frames | None = None, what: str = "style example") -> Motion:
    """The motion features of a clip as the model wants them: its joints, its axes and units, its frame rate."""
    try:
        if frames is not None:
            clip = edit.trim(clip, *frames)
        clip = edit.fit(clip, model.skeleton, f"{what} '{name}'")
        clip = normalise_like(clip, model.config.body, model.skeleton, name)
        rate = bvh.rate_hz(model.config.frame_time)
        if bvh.rate_hz(clip.frame_time) != rate:
            clip = edit.resample(clip, rate)
        return features.encode(clip)
    except ValueError as error:
        told = str(error)
        raise ValueError(told if name in told else f"{what} '{name}': {told}") from error


def encode(model: Model, motion: Motion) -> StyleDistribution:
    """The style of a motion (Fig. 3b)."""
    frames = len(motion.pose.root_vel)
    padded = jax.tree.map(partial(_pad, frames=-frames % PADDING), motion.pose)
    return _encode(model.params, model.config, model.scales, padded, frames)


@partial(jax.jit, static_argnames=("config",))
def _encode(
    params: Params, config: ZeroEggsConfig, scales: Scales, poses: Pose, frames: ArrayLike
) -> StyleDistribution:
    return encode_style(params, config, scales, pose.to_vector(poses), frames)


def _pad(x: ArrayLike, frames: int) -> np.ndarray:
    """Frames of zeros behind, which change nothing; in numpy, which does not compile every length."""
    x = np.asarray(x)
    return np.concatenate([x, np.zeros((frames, *x.shape[1:]), x.dtype)])


def first(motion: Motion) -> Motion:
    """Its first frame, with a leading axis of 1."""
    return Motion(jax.tree.map(lambda x: np.asarray(x)[:1], motion.pose), motion.gaze)
