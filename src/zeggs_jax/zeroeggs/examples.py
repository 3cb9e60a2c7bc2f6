"""Style examples (Fig. 3b, left): a BVH clip, a bundled name or a saved embedding, read for one model."""

import difflib
import os
import zipfile
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..data.body import normalise_like
from ..motion import bvh, edit, features, pose
from ..motion.features import Motion
from .checkpoints import digest
from .model import Model, StyleDistribution, encode_style

Frames = tuple[int, int]


class Example(NamedTuple):
    """One style, as far as a model knows it, and the pose from which its motion can start."""

    name: str
    style: StyleDistribution  # mean[Z], log_var[Z] or None
    start: Motion | None  # its first frame (leading axis 1) and gaze; None for labels


def bundled() -> dict[str, Path]:
    """The style clips that come with the package, by name."""
    folder = Path(str(files("zeggs_jax.zeroeggs") / "pretrained" / "styles"))
    return {path.stem: path for path in sorted(folder.glob("*.bvh"))}


def read(source: str | Path, model: Model, frames: Frames | None = None) -> Example:
    """Reads one style: a label of a label model, a bundled name, a .bvh or a saved .npz.

    `frames` (start, stop) cuts a clip, counted in the clip's own frames.

    Raises:
        ValueError, OSError: unknown name (the nearest ones are offered), clip of another skeleton,
            frames outside the clip, embedding of another model.
    """
    name = str(source)
    if model.config.labels:
        return _read_label(name, model, frames)
    if name in bundled():
        return read_clip(bundled()[name], model, frames)._replace(name=name)
    path = Path(source)
    if path.suffix == ".npz":
        if frames is not None:
            raise ValueError(f"'{name}' is a saved embedding and has no frames to cut; leave --frames out.")
        return load(path, model)
    if path.suffix == ".bvh" or path.exists():
        return read_clip(path, model, frames)
    raise ValueError(_unknown(name, list(bundled()), "a bundled style, a .bvh clip or a saved .npz embedding"))


def read_motion(path: Path, model: Model, frames: Frames | None = None, what: str = "style example") -> Motion:
    """The motion features of a BVH clip, cut to `frames`, read as in training, at the model's frame rate.

    Errors say `what` it is.
    """
    clip = bvh.read(path)
    try:
        if frames is not None:
            clip = edit.trim(clip, *frames)
        clip = edit.fit(clip, model.skeleton, f"{what} '{path.name}'")
        clip = normalise_like(clip, model.config.body, model.skeleton, path.name)
        rate = bvh.rate_hz(model.config.frame_time)
        if bvh.rate_hz(clip.frame_time) != rate:
            clip = edit.resample(clip, rate)
        return features.encode(clip)
    except ValueError as error:
        told = str(error)
        raise ValueError(told if path.name in told else f"{what} '{path.name}': {told}") from error


def read_clip(path: Path, model: Model, frames: Frames | None = None) -> Example:
    """Encodes a BVH clip as a style."""
    motion = read_motion(path, model, frames)
    style = _encode(model, motion.pose)
    return Example(path.stem, style, Motion(jax.tree.map(lambda x: x[:1], motion.pose), motion.gaze))


def _encode(model: Model, poses: pose.Pose) -> StyleDistribution:
    vectors = jax.vmap(pose.to_vector)(poses)
    return encode_style(model.params, model.config, model.scales, vectors)


def _read_label(name: str, model: Model, frames: Frames | None) -> Example:
    labels = model.config.labels
    if frames is not None:
        raise ValueError("this model is steered by labels, which have no frames; leave --frames out.")
    if name not in labels:
        raise ValueError(_unknown(name, list(labels), "one of the model's labels"))
    one_hot = jax.nn.one_hot(labels.index(name), len(labels))
    return Example(name, StyleDistribution(one_hot, None), None)


def _unknown(name: str, known: list[str], expected: str) -> str:
    spelled = {k.lower(): k for k in known}
    near = difflib.get_close_matches(name.lower(), spelled, n=3, cutoff=0.4)
    offered = [spelled[k] for k in near] or known
    return f"unknown style '{name}': expected {expected}; nearest: {', '.join(offered)}."


def save(path: Path, example: Example, model: Model) -> None:
    """Writes an embedding and its starting pose as .npz, marked with the model it belongs to."""
    if example.start is None:
        raise ValueError(f"style '{example.name}' is a label; only embeddings of clips are saved.")
    start = jax.tree.map(lambda x: x[0], example.start.pose)
    log_var = () if example.style.log_var is None else example.style.log_var
    temporary = path.with_name(f".{path.name}.part")
    with temporary.open("wb") as file:
        np.savez(
            file,
            name=example.name,
            model=digest(model),
            mean=np.asarray(example.style.mean),
            log_var=np.asarray(log_var, np.float32),
            gaze=np.asarray(example.start.gaze),
            root_pos=np.asarray(start.root.pos),
            root_rot=np.asarray(start.root.rot),
            pose=np.asarray(pose.to_vector(start)),
        )
    os.replace(temporary, path)


def load(path: Path, model: Model) -> Example:
    """Reads an embedding written by `save`, for the same model."""
    if not path.exists():
        raise FileNotFoundError(f"style embedding '{path}' does not exist; give the path of a saved .npz.")
    try:
        with np.load(path, allow_pickle=False) as archive:
            saved = {key: archive[key] for key in archive.files}
        root = pose.Root(jnp.asarray(saved["root_pos"]), jnp.asarray(saved["root_rot"]))
        start = pose.from_vector(jnp.asarray(saved["pose"]), root)
        log_var = jnp.asarray(saved["log_var"]) if saved["log_var"].size else None
        style = StyleDistribution(jnp.asarray(saved["mean"]), log_var)
        name, owner, gaze = str(saved["name"]), str(saved["model"]), jnp.asarray(saved["gaze"])
    except (KeyError, ValueError, TypeError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"'{path}' is not a saved style embedding; make one with 'zeggs embed'.") from error
    if owner != digest(model):
        raise ValueError(f"embedding '{path.name}' was made with another model; embed its clip again.")
    return Example(name, style, Motion(jax.tree.map(lambda x: x[None], start), gaze))
