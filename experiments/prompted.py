"""GestureDiffuCLIP as an instrument: a corpus as truth, speech and a prompt in, moving joints out; for 15 and 16."""

import argparse
import json
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

import chorus
import ledger
import truth
from chorus import Voice
from zeggs_jax.data import corpus as corpora
from zeggs_jax.diffuclip import generate as g
from zeggs_jax.diffuclip import guidance, prompts, representation, request, takes
from zeggs_jax.diffuclip.generate import Wishes
from zeggs_jax.diffuclip.model import Model, motion_of
from zeggs_jax.diffuclip.stages import video
from zeggs_jax.diffuclip.stages.stage import Take
from zeggs_jax.metrics import meaning
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.motion import bvh, edit
from zeggs_jax.speech import wav
from zeggs_jax.synthetic import captions, styles
from zeggs_jax.synthetic.styles import StyleFactors

SCALE = 2.0  # of guidance, where nothing else is said
EXAMPLE_S, EXAMPLES = 8.0, 3  # motion prompts: so long, so many of a style
PADDING = 256  # frames
TEXTS: dict[str, dict[str, bool]] = {
    "text, wording of the training": {},
    "text, held-out paraphrase": {"held_out": True},
    "text, held-out adjective": {"synonym": True},
    "text, held-out paraphrase, not grounded": {"held_out": True},
}  # kinds of text prompts, and what `captions` is asked for


class Said(NamedTuple):
    """A clip of the corpus: what was said, what the body did, what is known of it."""

    take: Take
    wav: Path
    notes: dict[str, Any]  # the JSON beside it

    @property
    def upper(self) -> str | None:
        """The named style of the body, or of its upper half where the lower has another."""
        name = self.take.style.partition("_on_")[0]
        return name if name in styles.STYLES else None

    @property
    def lower(self) -> str | None:
        """The named style of hips and legs."""
        name = self.notes.get("lower", {}).get("style", self.take.style)
        return name if name in styles.STYLES else None

    @property
    def meanings(self) -> list[meaning.Said]:
        """The words with a gesture of their own."""
        heard = self.take.words[-1].end if self.take.words else 0.0
        found = [one for one in self.notes.get("meanings", []) if one["end"] <= heard + 1e-3]
        return [meaning.Said(one["time"], one["meaning"]) for one in found]


class Bench(NamedTuple):
    """What is measured, and what with."""

    model: Model
    said: list[Said]
    out: Path  # for what is kept between calls
    steps: int  # of the solver
    film: Callable[..., jax.Array]  # a motion, its mask and a key -> the pictures of a random camera

    def of(self, split: str) -> list[Said]:
        """The clips of a split; of a corpus without any, all."""
        return [one for one in self.said if one.take.split == split] or self.said


class Ask(NamedTuple):
    """What one body shall do: the speech of a clip, or its first `seconds`, with or without its words."""

    said: Said
    wishes: Wishes
    seed: int
    seconds: float | None = None
    spoken: bool = True


class Made(NamedTuple):
    """A generated motion."""

    latents: Float[np.ndarray, "L C"]  # scaled Z
    motion: Float[np.ndarray, "T D"]
    movement: Movement


def parser(text: str | None) -> argparse.ArgumentParser:
    """The arguments that 15 and 16 share."""
    found = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    found.add_argument(
        "--checkpoint", type=Path, help="a run of 'zeggs diffuclip train'; if left out, the bundled model"
    )
    found.add_argument("--corpus", type=Path, required=True, help="a folder made by 13_meaning_corpus.py")
    found.add_argument("--samplings", type=int, default=10, help="of everything that is drawn")
    found.add_argument("--clips", type=int, default=8, help="valid clips whose speech is performed and compared")
    found.add_argument("--steps", type=int, default=20, help="of the solver")
    ledger.add_docs(found)
    found.add_argument("-o", "--out", type=Path, required=True)
    return found


def tune(args: argparse.Namespace) -> Bench:
    """The model and the clips that the arguments name; the clips as the model's run keeps them, or kept in OUT."""
    args.out.mkdir(parents=True, exist_ok=True)
    model = g.load_model(args.checkpoint) if args.checkpoint else g.bundled_model()
    kept = args.checkpoint if args.checkpoint and (args.checkpoint / takes.FOLDER).is_dir() else args.out
    read, skeleton, _ = takes.gather(args.corpus, kept, model.config)
    if skeleton.names != model.skeleton.names:
        raise ValueError(
            f"the corpus has {len(skeleton)} joints, the model {len(model.skeleton)}; give one of its body."
        )
    entries = {entry.name: entry for entry in corpora.find(args.corpus)}
    said = [_said(take, entries[take.name]) for take in read]
    return Bench(model, said, args.out, args.steps, jax.jit(partial(video.film, model.config, model.skeleton)))


def _said(take: Take, entry: Any) -> Said:
    notes = entry.transcript.read_text() if entry.transcript and entry.transcript.suffix == ".json" else "{}"
    return Said(take, entry.wav, json.loads(notes))


def movement(model: Model, motion: Float[np.ndarray, "T D"]) -> Movement:
    """Places of the joints of a motion that is not scaled."""
    padded = np.pad(motion, ((0, -len(motion) % PADDING), (0, 0)), mode="edge")
    offsets = np.asarray(model.skeleton.offsets, np.float32)
    places = np.asarray(_places(padded, offsets, model.skeleton.parents), np.float64)[: len(motion)]
    return Movement(places, bvh.rate_hz(model.config.frame_time), model.skeleton)


_places = jax.jit(representation.positions, static_argnames="parents")


def cut(whole: Movement, start: float, stop: float) -> Movement:
    """From one time to another, s."""
    frames = slice(round(start * whole.rate_hz), round(stop * whole.rate_hz))
    return whole._replace(positions=whole.positions[frames])


def perform(bench: Bench, asked: Sequence[Ask], seam: float | None = None) -> list[Made]:
    """The model's motion to every clip's speech, side by side; `seam` is w_body of Eq. 19, the model's own if None."""
    model, frame_s = bench.model, bench.model.config.frame_time
    frames = [len(one.said.take.motion[: one.seconds and round(one.seconds / frame_s)]) for one in asked]
    voices = []
    for one, count in zip(asked, frames, strict=True):
        wave = wav.read(one.said.wav)[: round(count * frame_s * wav.RATE_HZ)]
        words = [word for word in one.said.take.words if word.end <= count * frame_s] if one.spoken else ()
        voices.append(Voice(wave, words, one.wishes, one.seed))
    found = []
    for one, count, latents in zip(asked, frames, chorus.synthesize(model, voices, bench.steps, seam), strict=True):
        motion = motion_of(model, latents)[:count]
        if not np.isfinite(motion).all():
            raise ValueError(
                f"the model made motion to '{one.said.take.name}' that is not finite; check its checkpoint."
            )
        found.append(Made(latents, motion, movement(model, motion)))
    return found


def wish(bench: Bench, prompt: Float[np.ndarray, " P"] | None, scale: float = SCALE) -> Wishes:
    """One prompt for the whole body and all the time; or none."""
    own = np.zeros(bench.model.config.prompts.size, np.float32) if prompt is None else prompt
    return Wishes((0.0,), (guidance.whole(own, 0.0 if prompt is None else scale, bench.model.config),))


def of_text(bench: Bench, text: str, grounded: bool = True) -> Float[np.ndarray, " P"]:
    """The prompt that a text is, by the best head there is, grounded if the model's are."""
    params, config = bench.model.params["prompts"], bench.model.config
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        embedded = prompts.embed_texts(params, config, [text])[0]
    return prompts.ground(params, config, embedded) if grounded else embedded


def of_motion(bench: Bench, example: Path) -> Float[np.ndarray, " P"]:
    """The prompt that a clip is."""
    return request.embed(str(example), bench.model)[0]


def of_video(bench: Bench, example: Path, seed: int) -> Float[np.ndarray, " P"]:
    """The prompt that a film of a clip is, by a random camera that no training has seen."""
    config, clip = bench.model.config, bvh.read(example)
    if (rate_hz := bvh.rate_hz(config.frame_time)) != bvh.rate_hz(clip.frame_time):
        clip = edit.resample(clip, rate_hz)
    motion = representation.encode(clip)[: config.prompts.frames]
    padded = np.pad(motion, ((0, config.prompts.frames - len(motion)), (0, 0)))
    images = bench.film(padded, np.arange(len(padded)) < len(motion), jax.random.key(seed))
    params = bench.model.params["prompts"]
    return prompts.ground(params, config, prompts.encode_video(params, config, images[None]))


def example(bench: Bench, name: str, factors: StyleFactors, number: int = 0) -> Path:
    """A clip of a style that no training has seen: another seed, other words."""
    place = truth.EXAMPLE_SEED + 1000 * number + sum(map(ord, name))
    return truth.example(bench.out / "examples", name, factors, EXAMPLE_S, place)


def prompt(bench: Bench, kind: str, style: str, number: int) -> Float[np.ndarray, " P"]:
    """The `number`-th prompt of a kind for a named style: one of TEXTS, "motion" or "video"."""
    if kind in TEXTS:
        text = captions.captions(style, 7000 + 31 * number, **TEXTS[kind])
        return of_text(bench, text, not kind.endswith("not grounded"))
    clip = example(bench, style, styles.find(style), number % EXAMPLES)
    return of_motion(bench, clip) if kind == "motion" else of_video(bench, clip, 90_000 + number)
