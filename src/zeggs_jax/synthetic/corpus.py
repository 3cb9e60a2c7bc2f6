"""A corpus folder with known ground truth: each take a wav, a BVH and its words, stresses and factors."""

import csv
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from zeggs_jax.motion import bvh
from zeggs_jax.speech import wav
from zeggs_jax.synthetic import captions, gestures, lexicon, prosody, recording, styles, voice
from zeggs_jax.synthetic.recording import Recording
from zeggs_jax.synthetic.styles import HELD_OUT, TRAINING, StyleFactors

HELD_OUT_FOLDER = "held_out"
LOWER = ("neutral", "happy", "old", "tired", "still", "scared", "sneaky")  # styles that legs and hips tell apart


@dataclass(frozen=True)
class CorpusConfig:
    """What to write. Held-out styles go to the subfolder `held_out`, a corpus that training never sees."""

    clips: int = 48
    seconds: tuple[float, float] = (15.0, 30.0)  # shortest and longest clip
    rate_hz: int = 30
    seed: int = 0
    styles: tuple[str, ...] = TRAINING
    random_share: float = 0.3  # of the clips show random points of the factor space
    valid_share: float = 0.08
    held_out: tuple[str, ...] = HELD_OUT  # one clip each for every 24 clips, at least one
    meaning: bool = False  # sentences of `lexicon`, their meanings performed; captions; legs of other styles
    mixed_share: float = 0.2  # of such clips have legs of another style than the rest


class Lower(NamedTuple):
    """The style of hips and legs, where it is another one than the rest of the body's."""

    style: str
    factors: StyleFactors


class Take(NamedTuple):
    """One clip to be made; `name` is its path in the corpus without suffix."""

    name: str
    style: str
    factors: StyleFactors
    split: str
    seconds: float
    seed: int
    meaning: bool = False  # says and performs words of `lexicon`
    synonyms: bool = False  # says them by held-out words
    lower: Lower | None = None


def plan(config: CorpusConfig) -> list[Take]:
    """The takes of a corpus: named styles in turn, random points among them, a validation clip now and then.

    Raises ValueError for an unknown style, no clips, or clips shorter than a second.
    """
    if config.clips < 1 or not 1.0 <= config.seconds[0] <= config.seconds[1]:
        raise ValueError(
            f"{config.clips} clips of {config.seconds[0]:g} to {config.seconds[1]:g} s make no corpus; "
            "ask for at least one clip, of a second or more."
        )
    draw = np.random.default_rng([config.seed, 2])
    points = {name: styles.find(name) for name in (*config.styles, *config.held_out)}
    takes: list[Take] = []

    def add(folder: str, style: str, factors: StyleFactors, split: str) -> None:
        seconds = round(float(draw.uniform(*config.seconds)), 1)
        seed = config.seed * 100_003 + len(takes)
        take = Take(f"{folder}{style}_{len(takes):04d}", style, factors, split, seconds, seed)
        takes.append(_with_meaning(take, config, len(takes)) if config.meaning else take)

    named = valid = 0
    for k in range(config.clips):
        split = "valid" if int((k + 1) * config.valid_share) > valid else "train"
        valid += split == "valid"
        if int((k + 1) * config.random_share) > int(k * config.random_share):
            add("", f"random{k}", styles.random_style(config.seed * 100_003 + k), split)
        else:
            name = config.styles[named % len(config.styles)]
            named += 1
            add("", name, points[name], split)
    for name in config.held_out:
        for _ in range(max(1, config.clips // 24)):
            add(f"{HELD_OUT_FOLDER}/", name, points[name], "valid")
    return takes


def _with_meaning(take: Take, config: CorpusConfig, number: int) -> Take:
    """The take with words that matter: synonyms in a third of the valid ones, other legs in some."""
    draw = np.random.default_rng([config.seed, number, 73])
    take = take._replace(meaning=True, synonyms=take.split == "valid" and draw.random() < 1.0 / 3.0)
    if draw.random() >= config.mixed_share:
        return take
    name = str(draw.choice([other for other in LOWER if other != take.style]))
    folder, _, last = take.name.rpartition("/")
    style = f"{take.style}_on_{name}"
    path = f"{folder}/" if folder else ""
    renamed = f"{path}{style}_{last.rpartition('_')[2]}"
    return take._replace(name=renamed, style=style, lower=Lower(name, styles.find(name)))


def speak(take: Take) -> Recording:
    """The take's text said by our own voice."""
    words = int(recording.WORDS_PER_SECOND * take.seconds)
    text = lexicon.monologue(take.seed, words, take.synonyms) if take.meaning else None
    return recording.speak(take.seconds, take.seed, text)


def perform(take: Take, speech: Recording, rate_hz: int = 30) -> tuple[Recording, prosody.Prosody, bvh.Clip]:
    """The take performed: its speech at full length, what the body heard, and what it did."""
    spoken, frames = recording.fit(speech, take.seconds, rate_hz, take.seed)
    heard = prosody.known(spoken.words, spoken.wave) if spoken.words else prosody.measure(spoken.wave)
    lower = take.lower.factors if take.lower else None
    clip = gestures.perform(heard, take.factors, frames, rate_hz, take.seed, lower, performed(take, spoken))
    return spoken._replace(wave=recording.room(spoken.wave, take.seed)), heard, clip


def performed(take: Take, spoken: Recording) -> list[lexicon.Meant]:
    """The words of the speech that get a gesture of their own."""
    return lexicon.meant(spoken.words) if take.meaning else []


def write_take(folder: str | Path, take: Take, speech: Recording, rate_hz: int = 30) -> None:
    """Perform one take and write name.wav, name.bvh and name.json below `folder`, the JSON last."""
    spoken, heard, clip = perform(take, speech, rate_hz)
    stem = Path(folder) / take.name
    stem.parent.mkdir(parents=True, exist_ok=True)
    wav.write(f"{stem}.wav", spoken.wave, voice.RATE)
    bvh.write(f"{stem}.bvh", clip)
    notes = {
        "style": take.style,
        "factors": take.factors._asdict(),
        "speaker": spoken.speaker,
        "text": spoken.text,
        "words": [w._asdict() for w in spoken.words],
        "stresses": [
            {"time": t, "strength": s} for t, s in zip(heard.time.tolist(), heard.strength.tolist(), strict=True)
        ],
        "phrases": heard.phrases.tolist(),
        **(told(take, spoken) if take.meaning else {}),
    }
    _write_text(Path(f"{stem}.json"), json.dumps(_rounded(notes), indent=1) + "\n")


def told(take: Take, spoken: Recording) -> dict[str, object]:
    """What a clip with meanings tells besides: its captions, its meanings, the style of its lower half."""
    below = take.lower.factors if take.lower else take.factors

    def whole(seed: int, **unseen: bool) -> str:
        if take.lower:
            return captions.mixed(take.factors, below, seed, **unseen)
        return captions.captions(take.factors, seed, **unseen)

    first = 1000 * take.seed
    meanings: list[object] = [one._asdict() for one in performed(take, spoken)]
    return {
        "captions": _distinct(whole, first, 8),
        "held_out_captions": _distinct(partial(whole, held_out=True), first + 100, 4),
        "synonym_captions": _distinct(partial(whole, synonym=True), first + 200, 4),
        "upper_captions": _distinct(partial(captions.half, take.factors, "upper"), first + 300, 3),
        "lower_captions": _distinct(partial(captions.half, below, "lower"), first + 400, 3),
        "meanings": meanings,
        "lower": {"style": take.lower.style if take.lower else take.style, "factors": below._asdict()},
    }


def _distinct(say: Callable[[int], str], first: int, count: int) -> list[str]:
    """`count` different captions, fewer where forty seeds have not as many."""
    return list(dict.fromkeys(say(first + k) for k in range(40)))[:count]


def write_index(folder: str | Path, takes: Sequence[Take]) -> None:
    """corpus.csv (name,style,split) of `folder`, and one in `held_out` where there are such takes."""
    for here in {Path(take.name).parent.as_posix() for take in takes}:
        path = Path(folder) / here / "corpus.csv"
        rows = [(Path(t.name).name, t.style, t.split) for t in takes if Path(t.name).parent.as_posix() == here]
        partial = path.with_name(path.name + ".partial")
        with partial.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([("name", "style", "split"), *rows])
        os.replace(partial, path)


def write(folder: str | Path, config: CorpusConfig | None = None) -> list[Take]:
    """Write a whole corpus spoken by synthetic voices; the same config writes the same bytes."""
    config = CorpusConfig() if config is None else config
    takes = plan(config)
    for take in takes:
        write_take(folder, take, speak(take), config.rate_hz)
    write_index(folder, takes)
    return takes


def style_clip(style: str | StyleFactors, seconds: float | int = 10, rate_hz: int = 30, seed: int = 0) -> bvh.Clip:
    """An example clip of a style, performed to synthetic speech (the input of Fig. 3b)."""
    factors = styles.find(style) if isinstance(style, str) else style
    take = Take("example", "example", factors, "train", seconds, seed)
    return perform(take, recording.speak(take.seconds, take.seed), rate_hz)[2]


def _rounded(value: object) -> object:
    if isinstance(value, float):
        return round(value, 5)
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    return [_rounded(item) for item in value] if isinstance(value, list) else value


def _write_text(path: Path, text: str) -> None:
    partial = path.with_name(path.name + ".partial")
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, path)
