"""Speech and a style in, a moving body out: the whole of ZeroEGGS in one page (Fig. 2, Sec. 3.6)."""

import hashlib
import json
import os
from collections.abc import Sequence
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..motion import bvh, features
from ..motion.bvh import Clip
from ..motion.features import Motion
from ..motion.pose import Pose
from ..speech import features as speech_features
from ..speech import wav
from . import examples, style_space
from .checkpoints import digest, load_model
from .examples import Example, Frames
from .model import Model, decode, encode_speech, sample_style

Speech = str | Path | np.ndarray
BUNDLE = Path(str(files("zeggs_jax.zeroeggs") / "pretrained"))
PADDING = 300  # frames: lengths are rounded up to this, so that few lengths compile


class Request(NamedTuple):
    """What to make: everything that decides the output, besides the speech and the model."""

    styles: tuple[str, ...] = ("neutral",)  # bundled names, .bvh clips, saved .npz embeddings, or labels
    weights: tuple[float, ...] = ()  # blend the styles with these weights (they sum to 1)
    spans: tuple[float, ...] = ()  # or play them one after the other, with these shares of the time
    frames: tuple[Frames, ...] = ()  # cut the style clips: one (start, stop) for each style, or one for all
    first_pose: str | None = None  # a .bvh whose first frame starts the body; default: the last style clip
    temperature: float = 1.0  # 0 = the mean of the style; higher = more varied
    seed: int = 1234


class Gesture(NamedTuple):
    """A generated motion, and how it came about."""

    clip: Clip
    style: Float[Array, "T Z"]  # the embedding of every frame
    provenance: dict[str, Any]  # version, model digest, seed, arguments


def bundled_model() -> Model:
    """The small model that comes with the package, trained on the synthetic corpus."""
    return load_model(BUNDLE / "model")


def bundled_speech() -> dict[str, Path]:
    """The spoken samples that come with the package, by name."""
    return {path.stem: path for path in sorted((BUNDLE / "speech").glob("*.wav"))}


def generate(speech: Speech, style: str | Request = "neutral", *, model: Model | None = None) -> Gesture:
    """Makes a gesturing body from a speech recording.

    Args:
        speech: path of a WAV, FLAC or OGG file of any rate and number of channels, or samples at 16 kHz, mono.
        style: the name of a bundled style, a path (.bvh or .npz), or a full `Request`.
        model: from `load_model`; the bundled model when left out.

    Returns:
        The clip has round(rate x duration) frames at the model's frame rate.

    Raises:
        ValueError, OSError: with one sentence that says what came and what was expected.
    """
    request = style if isinstance(style, Request) else Request(styles=(str(style),))
    model = bundled_model() if model is None else model
    spectrum = read_speech(speech, model)
    chosen = read_styles(request, model)
    start = starting_pose(request, chosen, model)
    sequence = style_sequence(request, chosen, frames=len(spectrum))
    poses = synthesize(model, spectrum, sequence, start)
    clip = features.decode(poses, model.skeleton, model.config.frame_time)
    if not (np.isfinite(clip.euler).all() and np.isfinite(clip.positions).all()):
        raise ValueError(
            "the model made motion that is not finite; check its checkpoint, the style and the temperature."
        )
    return Gesture(clip, sequence, provenance(speech, request, model))


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
    return jnp.asarray(spectrum)


def read_styles(request: Request, model: Model) -> list[Example]:
    """The request's styles, encoded (Fig. 3b)."""
    count = len(request.styles)
    if count == 0:
        raise ValueError("no style was given; name a bundled style, a .bvh clip or a saved .npz embedding.")
    if len(request.frames) not in (0, 1, count):
        raise ValueError(f"got {len(request.frames)} frame ranges for {count} styles; give one or {count}.")
    ranges = request.frames * count if len(request.frames) == 1 else request.frames or (None,) * count
    return [examples.read(name, model, cut) for name, cut in zip(request.styles, ranges, strict=True)]


def starting_pose(request: Request, chosen: Sequence[Example], model: Model) -> Motion:
    """Frame 0 and gaze of `first_pose`, else of the last style that has them (as released)."""
    if request.first_pose is not None:
        return examples.read_motion(Path(request.first_pose), model, what="first pose")
    starts = [example.start for example in chosen if example.start is not None]
    if not starts:
        raise ValueError("a label has no pose to start from; give a .bvh with --first-pose.")
    return starts[-1]


def style_sequence(request: Request, chosen: Sequence[Example], frames: int) -> Float[Array, "T Z"]:
    """Samples every style and blends or stitches them over `frames` frames (Sec. 5.2)."""
    if not 0.0 <= request.temperature < np.inf:
        raise ValueError(f"temperature is {request.temperature:g}; give 0 (the mean) or more.")
    if not 0 <= request.seed < 2**32:
        raise ValueError(f"seed is {request.seed}; give a whole number from 0 to {2**32 - 1}.")
    keys = jax.random.split(jax.random.key(request.seed), len(chosen))
    drawn = [sample_style(k, e.style, request.temperature) for k, e in zip(keys, chosen, strict=True)]
    embeddings = jnp.stack(drawn)
    if request.weights and request.spans:
        raise ValueError("both weights and spans were given; weights blend, spans follow each other: give one.")
    if request.spans:
        shares = style_space.check_shares(request.spans, len(chosen), "spans")
        if min(shares) < 0.0:
            raise ValueError(f"the spans {shares} are shares of the time; give numbers from 0 to 1.")
        return style_space.stitch(embeddings, shares, frames)
    weights = request.weights or (1.0 / len(chosen),) * len(chosen)
    weights = style_space.check_shares(weights, len(chosen), "weights")
    return style_space.hold(style_space.blend(embeddings, jnp.asarray(weights)), frames)


def synthesize(model: Model, spectrum: Float[Array, "T F"], style: Float[Array, "T Z"], start: Motion) -> Pose:
    """Features and style in, poses out: the networks of Fig. 2, without files."""
    speech = encode_speech(model.params, model.config, model.scales, spectrum)
    frames = len(speech)
    extra = -frames % PADDING  # the decoder is causal: what is added behind changes nothing before
    speech, style = (jnp.pad(x, ((0, extra), (0, 0)), mode="edge") for x in (speech, style))
    gaze = style_space.hold(start.gaze, frames + extra)
    first = jax.tree.map(lambda x: jnp.asarray(x[0]), start.pose)
    poses = _decode(model.params, model.config, model.scales, first, speech, style, gaze)
    return jax.tree.map(lambda x: x[:frames], poses)


_decode = jax.jit(decode, static_argnames=("config",))


def provenance(speech: Speech, request: Request, model: Model) -> dict[str, Any]:
    """Version, model, seed, arguments and the digests of all inputs: what it takes to make the same bytes again."""
    named = (*request.styles, *filter(None, (request.first_pose,)))
    found = {name: examples.bundled().get(name, Path(name)) for name in named}
    return {
        "zeggs_jax": version("zeggs-jax"),
        "model_sha256": digest(model),
        "seed": request.seed,
        "speech": {"name": _named(speech), "sha256": _sha256(speech)},
        "arguments": request._asdict(),
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
