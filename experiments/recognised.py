"""Is the prompt followed? Styles recognised from motion (SRA, GestureDiffuCLIP Sec. 7.2), whole and by halves."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import ledger
import prompted
import sweeps
from prompted import Ask, Bench, Said
from zeggs_jax.diffuclip import body_parts, guidance, prompts, request
from zeggs_jax.diffuclip.generate import Wishes
from zeggs_jax.metrics import kinematic, movement, parts, recognition
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.motion import bvh
from zeggs_jax.speech import wav
from zeggs_jax.synthetic import captions, corpus, styles
from zeggs_jax.zeroeggs import generate as zeroeggs
from zeggs_jax.zeroeggs import library as libraries
from zeggs_jax.zeroeggs import style_clip

SETTLE_S, WINDOW_S = 1.0, 10.0  # a clip is judged by 10 s, as the paper does, after its first second
SECONDS = SETTLE_S + WINDOW_S
PROMPTS = (*prompted.TEXTS, "motion", "video")
BRIDGE = "ZeroEGGS, mixed by the text prompt"
PAIRS = (
    ("happy", "old"), ("angry", "neutral"), ("old", "happy"),
    ("sad", "sneaky"), ("relaxed", "tired"), ("scared", "still"),
)  # fmt: skip  # styles of upper and lower body

HALVES: tuple[str, ...] = ("upper", "lower")
Read = Callable[[Movement], Float[np.ndarray, " S"]]


class Judge(NamedTuple):
    """Recognises styles by the nearest centroid of the truth's statistics."""

    centroids: recognition.Centroids
    read: Read
    own: float  # share of the true clips, each by centroids made without it
    clips: int

    def see(self, motion: Movement) -> str:
        """The style that 10 s of a made motion, after its first second, are taken for."""
        return recognition.nearest(self.centroids, self.read(prompted.cut(motion, SETTLE_S, SECONDS)))


def judge(bench: Bench, read: Read, label: Callable[[Said], str | None], among: Sequence[str]) -> Judge:
    """The judge of the styles `among` that two or more clips of the corpus show."""
    rows, names, clips = [], [], []
    for number, said in enumerate(bench.said):
        name = label(said)
        if name not in among:
            continue
        whole = prompted.movement(bench.model, said.take.motion)
        seconds = len(whole.positions) / whole.rate_hz
        for start in np.arange(SETTLE_S, seconds - 0.8 * WINDOW_S, WINDOW_S).tolist():
            rows.append(read(prompted.cut(whole, start, start + WINDOW_S)))
            names.append(name)
            clips.append(number)
    shown = {
        name for name in names if len({clip for clip, other in zip(clips, names, strict=True) if other == name}) > 1
    }
    kept = [k for k, name in enumerate(names) if name in shown]
    if len(shown) < 2:
        raise ValueError(f"{len(shown)} styles of the corpus are shown by two clips or more; give a larger corpus.")
    statistics, names, clips = np.stack([rows[k] for k in kept]), [names[k] for k in kept], [clips[k] for k in kept]
    own = _without_itself(statistics, names, np.array(clips))
    return Judge(recognition.fit(statistics, names), read, own, len(set(clips)))


def _without_itself(statistics: np.ndarray, names: list[str], clips: np.ndarray) -> float:
    right = []
    for clip in np.unique(clips):
        rest = np.flatnonzero(clips != clip)
        centroids = recognition.fit(statistics[rest], [names[k] for k in rest])
        right += [recognition.nearest(centroids, statistics[k]) == names[k] for k in np.flatnonzero(clips == clip)]
    return float(np.mean(right))


def whole_judge(bench: Bench) -> Judge:
    """Of all joints; clips whose legs have another style are left out."""

    def label(said: Said) -> str | None:
        return said.upper if said.lower == said.upper else None

    return judge(bench, kinematic.statistics_of, label, styles.TRAINING)


def half_judge(bench: Bench, half: str) -> Judge:
    """Of the joints of a half; clips of two styles count in both."""
    among = styles.TRAINING if half == "upper" else corpus.LOWER
    return judge(bench, partial(parts.statistics, half=half), lambda said: getattr(said, half), among)


def speech(bench: Bench, number: int) -> Said:
    """The `number`-th of the valid clips that are long enough, in turn."""
    long = [one for one in bench.of("valid") if len(one.take.motion) * bench.model.config.frame_time >= SECONDS]
    if not long:
        raise ValueError(f"no clip of the corpus is {SECONDS:g} s long; make one with longer clips.")
    return long[number % len(long)]


def sra(bench: Bench, judge: Judge, kind: str, sampling: int) -> ledger.Row:
    """One sampling: every style asked for once by a prompt of a kind, each to a speech of its own."""
    names = judge.centroids.names
    speeches = [speech(bench, number + 3 * sampling) for number in range(len(names))]
    if kind == BRIDGE:
        seen = [judge.see(bridged(bench, *each, sampling)) for each in zip(speeches, names, strict=True)]
        return {"kind": "sra", "prompt": kind, "sampling": sampling, "made": list(names), "seen": seen}
    wishes = [
        prompted.wish(bench, prompted.prompt(bench, kind, style, k + 17 * sampling)) for k, style in enumerate(names)
    ]
    asked = [
        Ask(said, wish, 100 * sampling + k, SECONDS)
        for k, (said, wish) in enumerate(zip(speeches, wishes, strict=True))
    ]
    seen = [judge.see(made.movement) for made in prompted.perform(bench, asked)]
    return {"kind": "sra", "prompt": kind, "sampling": sampling, "made": list(names), "seen": seen}


def unprompted(bench: Bench, judge: Judge) -> ledger.Row:
    """What motion without a prompt is taken for, to as many speeches as there are styles."""
    wish = prompted.wish(bench, None)
    asked = [Ask(speech(bench, k), wish, k, SECONDS) for k in range(len(judge.centroids.names))]
    return {"kind": "unprompted", "seen": [judge.see(made.movement) for made in prompted.perform(bench, asked)]}


def bridged(bench: Bench, said: Said, style: str, sampling: int) -> Movement:
    """The bundled ZeroEGGS in the mixture of its styles that our motion encoder finds near a held-out text prompt."""
    model = zeroeggs.bundled_model()
    library = libraries.bundled(model)
    clips = style_clip.bundled_clips()
    near = np.stack([request.motion_prompt(bvh.read(path), name, bench.model) for name, path in clips.items()])
    text = prompted.of_text(bench, captions.captions(style, 7000 + 31 * sampling, held_out=True))
    weights = np.asarray(prompts.pick(text, near))
    entries = [libraries.find(library, name) for name in clips]
    point = sum(w * np.asarray(e.distribution.mean) for w, e in zip(weights, entries, strict=True))
    wave = wav.read(said.wav)[: round(SECONDS * wav.RATE_HZ)]
    spectrum = zeroeggs.read_speech(wave, model)
    (made,) = sweeps.perform(model, spectrum, jnp.asarray(point)[None], [entries[int(weights.argmax())].start])
    return movement.of(made)


def halves(bench: Bench, judges: Mapping[str, Judge], sampling: int, seam: float | None) -> ledger.Row:
    """One sampling of upper and lower body under prompts of their own (Eq. 19)."""
    config, asked = bench.model.config, []
    for number, pair in enumerate(PAIRS):
        texts = [captions.captions(name, 500 * sampling + number, held_out=True) for name in pair]
        by_half = dict(zip(HALVES, [prompted.of_text(bench, text) for text in texts], strict=True))
        own = np.stack([by_half[name] for name in body_parts.names(config)])
        scales, masks = np.full(len(own), prompted.SCALE, np.float32), body_parts.masks(config)
        both = guidance.Wish(own, scales, masks)  # type: ignore[arg-type]
        said = speech(bench, number + 3 * sampling)
        asked.append(Ask(said, Wishes((0.0,), (both,)), 100 * sampling + number, SECONDS))
    rows = [
        {"asked": list(pair), "seen": [judges[half].see(made.movement) for half in HALVES]}
        for pair, made in zip(PAIRS, prompted.perform(bench, asked, seam), strict=True)
    ]
    return {"kind": "halves", "seam": "own" if seam is None else seam, "sampling": sampling, "rows": rows}
