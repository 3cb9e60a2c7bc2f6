"""Speech and a style in, a moving body out: the whole of ZeroEGGS in one page (Fig. 2, Sec. 3.6)."""

import hashlib
import json
import os
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from ..motion import bvh, features
from ..motion.bvh import Clip
from ..motion.pose import Pose
from ..nn import reduced
from ..nn.reduced import Precision
from ..speech import features as speech_features
from ..speech import wav
from . import examples, library, steering
from .checkpoints import digest, load_model
from .model import Model
from .steering import Request, read_styles, starting_pose, style_sequence
from .synthesis import Told, synthesize

__all__ = ["BUNDLE", "Gesture", "Request", "bundled_model", "bundled_speech", "generate", "load_model", "provenance"]
__all__ += ["finish", "prepare", "read_speech", "read_styles", "save", "starting_pose", "style_sequence", "synthesize"]

Speech = str | Path | np.ndarray
BUNDLE = Path(str(files("zeggs_jax.zeroeggs") / "pretrained"))


class Gesture(NamedTuple):
    """A generated motion, and how it came about."""

    clip: Clip
    style: Float[Array, "T Z"]  # the embedding of every frame
    provenance: dict[str, Any]  # version, model digest, seed, arguments, notes
    notes: tuple[str, ...]  # what is worth knowing: that the style lies far outside the library, for one


class Asked(NamedTuple):
    """One gesture to be made: what the networks are told, and what for."""

    told: Told
    speech: Speech
    request: Request
    notes: tuple[str, ...]


def bundled_model() -> Model:
    """The small model that comes with the package, trained on the synthetic corpus."""
    return load_model(BUNDLE / "model")


def bundled_speech() -> dict[str, Path]:
    """The spoken samples that come with the package, by name."""
    return {path.stem: path for path in sorted((BUNDLE / "speech").glob("*.wav"))}


def generate(
    speech: Speech,
    style: str | Request = "neutral",
    *,
    model: Model | None = None,
    precision: Precision = "float32",
) -> Gesture:
    """Makes a gesturing body from a speech recording.

    Args:
        speech: path of a WAV, FLAC or OGG file of any rate and number of channels, or samples at 16 kHz, mono.
        style: the name of a bundled style, a path (.bvh or .npz), or a full `Request`.
        model: from `load_model`; the bundled model when left out.
        precision: of the decoder's weights; "bfloat16" and "int8" are faster on a CPU and nearly the same motion.

    Returns:
        The clip has round(rate x duration) frames at the model's frame rate.

    Raises:
        ValueError, OSError: with one sentence that says what came and what was expected.
    """
    request = style if isinstance(style, Request) else Request(styles=(str(style),))
    model = bundled_model() if model is None else model
    asked = prepare(speech, request, model)
    gesture = finish(asked, synthesize(model, *asked.told, precision), model, precision)
    return gesture._replace(notes=(*gesture.notes, *reduced.notes(precision)))


def prepare(speech: Speech, request: Request, model: Model) -> Asked:
    """All that comes before the networks' loop: speech and styles read, the style laid out; errors as `generate`'s."""
    spectrum = read_speech(speech, model)
    rate_hz = bvh.rate_hz(model.config.frame_time)
    space = steering.read_space(request, model)
    chosen = read_styles(request, model, space)
    start = starting_pose(request, chosen, model)
    sequence = style_sequence(request, chosen, len(spectrum), rate_hz, space)
    notes = steering.notes(request, chosen, len(spectrum), rate_hz, space)
    return Asked(Told(spectrum, sequence, start), speech, request, notes)


def finish(asked: Asked, poses: Pose, model: Model, precision: Precision = "float32") -> Gesture:
    """All that comes after it; a ValueError for motion that is not finite."""
    clip = features.decode(poses, model.skeleton, model.config.frame_time)
    if not (np.isfinite(clip.euler).all() and np.isfinite(clip.positions).all()):
        raise ValueError(
            "the model made motion that is not finite; check its checkpoint, the style and the temperature."
        )
    told = {**provenance(asked.speech, asked.request, model), "precision": precision, "notes": asked.notes}
    return Gesture(clip, jax.device_put(asked.told.style), told, asked.notes)


def read_speech(speech: Speech, model: Model) -> Float[Array, "T F"]:
    """Speech features at the model's frame rate; a ValueError for speech shorter than a frame or not finite."""
    if isinstance(speech, np.ndarray):
        if speech.ndim != 1 or not np.isfinite(speech).all():
            raise ValueError(f"speech has shape {speech.shape}; give finite samples of one channel, [n], at 16 kHz.")
        wave = speech
    else:
        wave = wav.read(speech)
    rate_hz = bvh.rate_hz(model.config.frame_time)
    spectrum = speech_features.extract(wave, rate_hz=rate_hz, config=model.config.features)
    if not len(spectrum):
        raise ValueError(f"speech '{_named(speech)}' is shorter than one frame of motion; give a longer recording.")
    return jax.device_put(spectrum)  # `jnp.asarray` would compile every length


def provenance(speech: Speech, request: Request, model: Model) -> dict[str, Any]:
    """Version, model, seed, arguments and the digests of all inputs: what it takes to make the same bytes again."""
    named = (*steering.named(request), *filter(None, (request.first_pose, request.library)))
    own = library.names(library.load(request.library, model)) if request.library else ()
    found = {name: examples.bundled().get(name, examples.split(name)[0]) for name in named if name not in own}
    if steering.needs_space(request) and request.library is None:
        found["the bundled library"] = library.BUNDLED
    cues = [cue._asdict() for cue in request.timeline.cues] if request.timeline else None
    return {
        "zeggs_jax": version("zeggs-jax"),
        "model_sha256": digest(model),
        "seed": request.seed,
        "speech": {"name": _named(speech), "sha256": _sha256(speech)},
        "arguments": {**request._asdict(), "timeline": cues},
        "inputs_sha256": {name: _sha256(path) for name, path in found.items() if path.is_file()},
    }


def _named(speech: Speech) -> str:
    return f"{len(speech)} samples" if isinstance(speech, np.ndarray) else str(speech)


def _sha256(source: Speech) -> str:
    content = source.tobytes() if isinstance(source, np.ndarray) else Path(source).read_bytes()
    return hashlib.sha256(content).hexdigest()


def save(path: str | Path, gesture: Gesture) -> Path:
    """Writes the clip as BVH (`path` must end so) and, beside it, its provenance as `<name>.provenance.json`."""
    path = Path(path)
    if path.suffix.lower() != ".bvh":
        raise ValueError(f"'{path}' is no name for motion; give one that ends in .bvh.")
    bvh.write(path, gesture.clip)
    beside = path.with_suffix(".provenance.json")
    temporary = beside.with_name(f".{beside.name}.part")
    temporary.write_text(json.dumps(gesture.provenance, indent=2) + "\n")
    os.replace(temporary, beside)
    return path
