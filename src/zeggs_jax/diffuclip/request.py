"""What generation is asked for: prompts of words, motion or video (Sec. 6.1.2), over time and for parts of the body."""

import json
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..data import scale
from ..data.body import normalise_like
from ..motion import bvh, edit
from ..speech import transcript, wav
from ..speech.transcript import Sentence
from . import body_parts, prompts, representation
from .model import Model

MOTION = (".bvh",)
VIDEO = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".gif")
SAME_S = 1e-6


class Cue(NamedTuple):
    """From this time on the body follows this prompt."""

    time: float  # s
    prompt: str  # words, or the path of a .bvh or a video


@dataclass(frozen=True)
class Request:
    """How the body shall gesture; without any prompt it does so in no style that was asked for.

    A prompt is words, or the path of a .bvh clip or of a video. `parts` gives parts of the body prompts of their own
    (Sec. 6.3), `timeline` changes the prompt over time (Fig. 10). `scale` is s of Eq. 17: 0 ignores the prompt, 1
    follows it as trained, more exaggerates. `chunk` latents are made at once, None for the model's own number; 1 is
    Eq. 9 to the letter.
    """

    prompt: str | None = None
    timeline: tuple[Cue, ...] = ()
    parts: tuple[tuple[str, str], ...] = ()  # (upper or lower, prompt)
    scale: float = 2.0
    steps: int = 20
    solver: Literal["dpm", "ddim", "ddpm"] = "dpm"
    seam: float | None = None  # w_body of Eq. 19; None: the model's own
    chunk: int | None = None
    transcript: str | None = None  # a file of timed words (speech/transcript.py)
    seed: int = 1234

    def __post_init__(self) -> None:
        if self.timeline and self.prompt is not None:
            raise ValueError("a prompt and a timeline of prompts were given; give one of them.")
        if self.timeline and self.parts:
            raise ValueError("a timeline and prompts for parts of the body were given; give one of them.")
        if not np.isfinite(self.scale) or self.scale < 0:
            raise ValueError(f"the guidance scale is {self.scale}; give 0 or more, 2 is usual.")
        if self.steps < 1:
            raise ValueError(f"{self.steps} steps were asked for; give 1 or more, 20 is usual.")
        if self.chunk is not None and self.chunk < 1:
            raise ValueError(f"chunks of {self.chunk} latents were asked for; give 1 or more, 8 is usual.")
        if self.seam is not None and not 0 <= self.seam < np.inf:
            raise ValueError(f"the seam's weight is {self.seam}; give 0 or more, 0.01 is usual.")
        if not 0 <= self.seed < 2**32:
            raise ValueError(f"the seed is {self.seed}; give a whole number from 0 to {2**32 - 1}.")
        names = [name for name, _ in self.parts]
        if len(set(names)) < len(names):
            raise ValueError(f"a part of the body has two prompts ({', '.join(names)}); give one each.")
        check_cues(self.timeline)


def check_cues(cues: Sequence[Cue]) -> None:
    """ValueError for cues that do not begin at 0, are out of order or at one time, or have no prompt."""
    for k, cue in enumerate(cues):
        if k == 0 and cue.time != 0:
            raise ValueError(f"the first prompt of the timeline is at {cue.time:g} s; let it begin at 0.")
        if not np.isfinite(cue.time) or (k and cue.time < cues[k - 1].time + SAME_S):
            raise ValueError(
                f"prompt {k + 1} of the timeline is at {cue.time:g} s, not after the one before; sort them."
            )
        if not cue.prompt.strip():
            raise ValueError(f"prompt {k + 1} of the timeline, at {cue.time:g} s, is empty; say how the body moves.")


def read_timeline(path: str | Path, spoken: Sequence[Sentence] = ()) -> tuple[Cue, ...]:
    """Prompts over time from JSON: {"cues": [{"time": 0, "prompt": "..."}, ...]} or {"sentences": ["...", ...]}.

    The second form gives each sentence of the transcript the next prompt, the last one to all that follow.

    Raises:
        ValueError, OSError: another form, no transcript for the second, whatever `check_cues` refuses.
    """
    path = Path(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"timeline '{path}' is not JSON ({error}); see the README for its form.") from error
    if isinstance(data, dict) and set(data) == {"sentences"} and _texts(data["sentences"]):
        if not spoken:
            raise ValueError(f"timeline '{path}' has a prompt for each sentence; give the --transcript they are in.")
        return by_sentence(spoken, data["sentences"])
    cues = data.get("cues") if isinstance(data, dict) and set(data) == {"cues"} else None
    if not isinstance(cues, list) or not cues or not all(_is_cue(cue) for cue in cues):
        raise ValueError(
            f'timeline \'{path}\' has no prompts in a known form; expected {{"cues": [{{"time": 0, "prompt": '
            '"..."}, ...]} or {"sentences": ["...", ...]}.'
        )
    made = tuple(Cue(float(cue["time"]), cue["prompt"]) for cue in cues)
    check_cues(made)
    return made


def spoken(path: str | Path, speech: str | Path) -> tuple[Sentence, ...]:
    """The sentences of a speech's transcript; errors are those of `speech.transcript.read` and `speech.wav.read`."""
    return transcript.sentences(transcript.read(path, wav.read(speech)))


def by_sentence(spoken: Sequence[Sentence], texts: Sequence[str]) -> tuple[Cue, ...]:
    """Each sentence under the next prompt, from its first word on; the first prompt from 0 s (Fig. 10)."""
    pairs = zip(spoken[: len(texts)], texts, strict=False)
    cues = tuple(Cue(0.0 if k == 0 else sentence.start, text) for k, (sentence, text) in enumerate(pairs))
    check_cues(cues)
    return cues


def _texts(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(text, str) for text in value)


def _is_cue(cue: Any) -> bool:
    return (
        isinstance(cue, dict)
        and set(cue) == {"time", "prompt"}
        and type(cue["time"]) in (int, float)
        and isinstance(cue["prompt"], str)
    )


def kind_of(prompt: str) -> Literal["text", "motion", "video"]:
    """What a prompt is: the path of a clip or of a video by its ending, or else words."""
    ending = Path(prompt).suffix.lower()
    return "motion" if ending in MOTION else "video" if ending in VIDEO else "text"


def embed(prompt: str, model: Model) -> tuple[Float[np.ndarray, " P"], tuple[str, ...]]:
    """(the prompt in the prompt space, of unit length; what is worth knowing, such as words that were cut).

    Raises:
        ValueError, OSError: an empty text, a clip or a video that does not read, a skeleton that does not fit.
    """
    kind = kind_of(prompt)
    if kind == "motion":
        return motion_prompt(bvh.read(prompt), Path(prompt).name, model), ()
    if kind == "video":
        from . import video

        pieces = video.read(prompt, model.config.prompts.video_frames, model.config.prompts.pixels)
        watched = _watch(model.params["prompts"], model.config, pieces)
        return prompts.ground(model.params["prompts"], model.config, watched), ()
    if not prompt.strip():
        raise ValueError("the prompt is empty; say how the body moves, as in --prompt 'an old, tired person'.")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        embedded = prompts.embed_texts(model.params["prompts"], model.config, [prompt])[0]
    grounded = prompts.ground(model.params["prompts"], model.config, embedded)
    return grounded, tuple(str(warning.message) for warning in told if warning.category is UserWarning)


def motion_prompt(clip: bvh.Clip, name: str, model: Model) -> Float[np.ndarray, " P"]:
    """The prompt that a clip is: the mean of its stretches, as long as the encoder reads, of unit length."""
    try:
        clip = edit.fit(clip, model.skeleton, f"motion prompt '{name}'")
        clip = normalise_like(clip, model.config.body, model.skeleton, name)
        rate = bvh.rate_hz(model.config.frame_time)
        if bvh.rate_hz(clip.frame_time) != rate:
            clip = edit.resample(clip, rate)
        motion = representation.encode(clip)
    except ValueError as error:
        told = str(error)
        raise ValueError(told if name in told else f"motion prompt '{name}': {told}") from error
    return stretches(np.asarray(scale.apply(model.motion_scale, motion)), model)


def stretches(motion: Float[np.ndarray, "T D"], model: Model) -> Float[np.ndarray, " P"]:
    """The mean prompt of a scaled motion cut into stretches that half overlap."""
    longest = model.config.prompts.frames
    starts = range(0, max(len(motion) - longest, 0) + longest // 2, longest // 2)
    pieces = [motion[start : start + longest] for start in starts if start == 0 or len(motion) - start >= longest // 2]
    rows = [np.pad(piece, ((0, longest - len(piece)), (0, 0))) for piece in pieces]
    masks = [np.arange(longest) < len(piece) for piece in pieces]
    pairs = zip(rows, masks, strict=True)
    found = [_encode(model.params["prompts"], model.config, row, mask) for row, mask in pairs]
    mean = np.mean(np.asarray(found), axis=0)
    return (mean / np.linalg.norm(mean)).astype(np.float32)


_encode = jax.jit(prompts.encode_motion, static_argnames="config")
_watch = jax.jit(prompts.encode_video, static_argnames="config")


def check_fits(request: Request, model: Model) -> None:
    """ValueError for what this model cannot do: parts of the body, steps, and chunks that it has not learnt."""
    diffusion, learnt = model.config.diffusion, round(model.config.learn_denoiser.seconds * model.config.latents_hz)
    if request.steps > diffusion.steps:
        raise ValueError(f"{request.steps} steps were asked for, but this model's process has {diffusion.steps}.")
    if request.chunk is not None and request.chunk > learnt:
        raise ValueError(
            f"chunks of {request.chunk} latents were asked for, but this model has learnt from windows of {learnt}; "
            f"give at most so many, {diffusion.chunk} is usual."
        )
    known = body_parts.names(model.config)
    for name, _ in request.parts:
        if name not in known or not model.config.parts:
            has = f"its parts are {', '.join(known)}" if model.config.parts else "it has one for the whole body"
            raise ValueError(f"'{name}' has a prompt, but this model has no such part of the body: {has}.")


def described(request: Request) -> dict[str, Any]:
    """The request as plain data."""
    plain = asdict(request)
    return plain | {"timeline": [cue._asdict() for cue in request.timeline], "parts": dict(request.parts)}
