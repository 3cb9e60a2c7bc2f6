"""Speech, its words and a prompt in, a moving body out: the whole of GestureDiffuCLIP in one page (Fig. 2, Eq. 9)."""

import hashlib
import json
import os
from collections.abc import Sequence
from functools import partial
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from tqdm import tqdm

from ..motion import bvh
from ..motion.bvh import Clip
from ..speech import transcript, wav
from ..speech.transcript import Word
from . import body_parts, guidance, representation, request, sampling
from .checkpoints import digest, load_model
from .denoiser import Conditions
from .guidance import Wish
from .model import Model, conditions, motion_of, words_near
from .request import Cue, Request
from .sampling import Settings
from .takes import heard

__all__ = ["BUNDLE", "Cue", "Gesture", "Request", "bundled_model", "bundled_speech", "generate", "load_model", "save"]

BUNDLE = Path(str(files("zeggs_jax.diffuclip") / "pretrained"))
GUESSED = "'{}' has no times: its words share the time of the voice; timed words place gestures better."
BEYOND_S = 1.0  # words may end this long after the recording, by their aligner's rounding


class Gesture(NamedTuple):
    """A generated motion, and how it came about."""

    clip: Clip
    latents: Float[np.ndarray, "L C"]  # scaled Z
    words: tuple[Word, ...]
    provenance: dict[str, Any]
    notes: tuple[str, ...]  # what is worth knowing, such as words of a prompt that were cut


def bundled_model() -> Model:
    """The small model that comes with the package, trained on the synthetic corpus of known meanings."""
    return load_model(BUNDLE / "model")


def bundled_speech() -> dict[str, Path]:
    """The recordings that come with the package, by name; the timed words of each lie beside it as .json."""
    return {path.stem: path for path in sorted((BUNDLE / "speech").glob("*.wav"))}


def generate(
    speech: str | Path | np.ndarray, asked: str | Request | None = None, *, model: Model | None = None,
    progress: bool = False,
) -> Gesture:  # fmt: skip
    """Makes a gesturing body from a speech recording, its transcript and a style prompt.

    Args:
        speech: path of a WAV, FLAC or OGG file, or samples at 16 kHz, mono.
        asked: a prompt (words, or the path of a .bvh or a video), or a full `Request`.
        model: from `load_model`; the bundled model when left out.
        progress: show a bar.

    Returns:
        The clip has round(rate x duration) frames at the model's frame rate.

    Raises:
        ValueError, OSError: with one sentence that says what came and what was expected.
    """
    asked = asked if isinstance(asked, Request) else Request(asked)
    model = bundled_model() if model is None else model
    wave = speech if isinstance(speech, np.ndarray) else wav.read(speech)
    if wave.ndim != 1 or not np.isfinite(wave).all():
        raise ValueError(f"speech has shape {wave.shape}; give finite samples of one channel, [n], at 16 kHz.")
    frames = round(len(wave) / wav.RATE_HZ / model.config.frame_time)
    if frames < 1:
        raise ValueError(f"the speech lasts {len(wave) / wav.RATE_HZ:.3f} s, less than a frame; give a longer one.")
    request.check_fits(asked, model)
    words, untimed = ((), ()) if asked.transcript is None else read_words(asked.transcript, wave)
    prompts, told = read_prompts(asked, model, len(wave) / wav.RATE_HZ)
    notes = (*untimed, *told)
    latents = synthesize(model, wave, words, prompts, asked, progress)
    motion = motion_of(model, latents)[:frames]
    if not np.isfinite(motion).all():
        raise ValueError("the model made motion that is not finite; check its checkpoint, the prompt and the scale.")
    clip = representation.decode(motion, model.skeleton, model.config.frame_time)
    return Gesture(clip, latents, words, {**provenance(speech, asked, model), "notes": notes}, notes)


def read_words(path: str | Path, wave: Float[np.ndarray, " n"]) -> tuple[tuple[Word, ...], tuple[str, ...]]:
    """(the words of a transcript, notes); ValueError where they go on after the speech has ended."""
    words, seconds = transcript.read(path, wave), len(wave) / wav.RATE_HZ
    last = max(words, key=lambda word: word.end)
    if last.end > seconds + BEYOND_S:
        raise ValueError(
            f"transcript '{path}' ends with '{last.text}' at {last.end:.1f} s, but the speech lasts {seconds:.1f} s; "
            "give the transcript of this recording."
        )
    return words, (GUESSED.format(path),) if transcript.is_untimed(path) else ()


class Wishes(NamedTuple):
    """The prompts of a generation, in order of time."""

    times: tuple[float, ...]  # s, from when on each holds
    each: tuple[Wish, ...]


def read_prompts(asked: Request, model: Model, seconds: float) -> tuple[Wishes, tuple[str, ...]]:
    """(what is wished for over time, what is worth knowing of it)."""
    late = next((cue for cue in asked.timeline if cue.time >= seconds), None)
    if late is not None:
        raise ValueError(f"the timeline has a prompt at {late.time:g} s, but the speech lasts {seconds:.1f} s; cut it.")
    notes: list[str] = []

    def embed(prompt: str) -> np.ndarray:
        found, told = request.embed(prompt, model)
        notes.extend(told)
        return found

    if asked.timeline:
        made = [guidance.whole(embed(cue.prompt), asked.scale, model.config) for cue in asked.timeline]
        return Wishes(tuple(cue.time for cue in asked.timeline), tuple(made)), tuple(notes)
    general = np.zeros(model.config.prompts.size, np.float32) if asked.prompt is None else embed(asked.prompt)
    if not asked.parts:
        scale = 0.0 if asked.prompt is None else asked.scale
        return Wishes((0.0,), (guidance.whole(general, scale, model.config),)), tuple(notes)
    own, names = dict(asked.parts), body_parts.names(model.config)
    styles = np.stack([embed(own[name]) if name in own else general for name in names])
    scales = [0.0 if name not in own and asked.prompt is None else asked.scale for name in names]
    wish = Wish(styles, np.array(scales, np.float32), body_parts.masks(model.config))  # type: ignore[arg-type]
    return Wishes((0.0,), (wish,)), tuple(notes)


def synthesize(
    model: Model,
    wave: Float[np.ndarray, " n"],
    words: Sequence[Word],
    wishes: Wishes,
    asked: Request,
    progress: bool = False,
) -> Float[np.ndarray, "L C"]:
    """Scaled latents, chunk after chunk behind those that are made (Eq. 9), in memory that does not grow."""
    config, hz = model.config, model.config.latents_hz
    latents = max(1, int(np.ceil(len(wave) / wav.RATE_HZ * hz)))
    chunk = asked.chunk or config.diffusion.chunk
    settings = Settings(asked.solver, asked.steps, chunk=chunk, context=config.diffusion.context)
    window = settings.context + chunk + config.denoiser.ahead
    rhythm = np.pad(heard(np.asarray(wave, np.float32), latents, hz), ((0, window), (0, 0)))
    made = 0

    def conditions_at(first: int, length: int) -> tuple[Conditions, Wish]:
        spoken = words_near(words, config, first, length)
        holds = np.searchsorted(wishes.times, made / hz + 1e-6, side="right") - 1
        audio = rhythm[first : first + length + config.denoiser.ahead]
        wish = wishes.each[max(int(holds), 0)]
        return _conditions(model.params, config, audio, spoken, wish.styles[0], True), wish

    seam = config.diffusion.seam if asked.seam is None else asked.seam
    several = len(wishes.each[0].styles) > 1
    extend = partial(guidance.extend, model.params["denoiser"], config, settings, float(seam) if several else 0.0)
    pieces = []
    bar = tqdm(total=latents, desc="generating", unit="latent", disable=not progress)
    for piece in sampling.rollout(
        extend, settings, conditions_at, latents, config.latent_size, jax.random.key(asked.seed)
    ):
        pieces.append(piece)
        made += len(piece)
        bar.update(len(piece))
    bar.close()
    return np.concatenate(pieces)


_conditions = jax.jit(conditions, static_argnames=("config", "prompted"))


def provenance(speech: str | Path | np.ndarray, asked: Request, model: Model) -> dict[str, Any]:
    """Version, model, arguments and the digests of all inputs: what it takes to make the same bytes again."""
    named = (asked.prompt, asked.transcript, *(cue.prompt for cue in asked.timeline), *(p for _, p in asked.parts))
    inputs = [path for path in filter(None, named) if path == asked.transcript or request.kind_of(path) != "text"]
    spoken = speech.tobytes() if isinstance(speech, np.ndarray) else Path(speech).read_bytes()
    return {
        "zeggs_jax": version("zeggs-jax"),
        "model_sha256": digest(model),
        "speech": {
            "name": f"{len(speech)} samples" if isinstance(speech, np.ndarray) else str(speech),
            "sha256": hashlib.sha256(spoken).hexdigest(),
        },
        "arguments": request.described(asked),
        "inputs_sha256": {path: hashlib.sha256(Path(path).read_bytes()).hexdigest() for path in inputs},
    }


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
