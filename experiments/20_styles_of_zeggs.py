"""SRA by the paper's own protocol (GestureDiffuCLIP Sec. 7.2, Table 2): 13 styles of ZEGGS, "the person is [label]".

    python experiments/20_styles_of_zeggs.py --checkpoint RUN --corpus ZEGGS -o runs/sra [--segments N] [--samplings 10]

RUN was trained on ZEGGS (19_paper_diffuclip.py tells how). All neutral speech is cut into segments and performed in
each of 13 styles; the six that the paper drops are dropped. The judge is the nearest centroid of kinematic statistics
of the recordings, 10 s at a time; how often it is right about recordings that it has not seen is told beside. The
paper's classifier is another one and not public: its 71.53 +- 1.01 % cannot be compared with what is printed here. A
stopped run goes on where it was. Of another corpus the same is done with those of the 13 styles that it has.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

import chorus
import ledger
import prompted
import recognised
from chorus import Voice
from prompted import Bench, Said
from recognised import SECONDS, Judge
from zeggs_jax.diffuclip.model import motion_of
from zeggs_jax.diffuclip.takes import caption_of
from zeggs_jax.metrics import kinematic
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.speech import wav
from zeggs_jax.speech.transcript import Word

NAME = "20_styles_of_zeggs"
STYLES = (
    *("angry", "distracted", "flirty", "happy", "laughing", "neutral", "old"),
    *("relaxed", "sad", "scared", "sneaky", "still", "tired"),
)  # not agreement, disagreement, oration, pensive, sarcastic and threatening
SPOKEN = "neutral"
TOGETHER = 16  # segments at once


class Segment(NamedTuple):
    """A piece of neutral speech: the second that a body needs to begin, and the ten that are judged."""

    wave: Float[np.ndarray, " n"]  # 16 kHz
    words: tuple[Word, ...]  # times from the segment's beginning


def main() -> None:
    parser = prompted.parser(__doc__)
    parser.add_argument("--segments", type=int, help="so many of the neutral segments, evenly spread; all if left out")
    args = parser.parse_args()
    bench = prompted.tune(args)
    judge = recognised.judge(bench, kinematic.statistics_of, label, STYLES)
    spoken = segments(bench.said)
    if args.segments is not None:
        spoken = [spoken[k] for k in np.linspace(0, len(spoken) - 1, min(args.segments, len(spoken))).astype(int)]
    jobs = {
        f"{style} {sampling}": partial(sampled, bench, judge, spoken, style, sampling)
        for sampling in range(args.samplings)
        for style in judge.centroids.names
    }
    rows = ledger.fill(args.out / "sra.jsonl", jobs, "styles")
    ledger.tell(report(rows, judge, len(spoken)), NAME, args.docs)
    ledger.save(args.out / "sra.json", {"styles": judge.centroids.names, "own": judge.own, "rows": rows})


def label(said: Said) -> str:
    """The style of a recording, as the paper's list has it."""
    return said.take.style.lower()


def segments(said: Sequence[Said]) -> list[Segment]:
    """All neutral speech in pieces of the same length, one behind the other; ValueError where there is none."""
    found = []
    for one in said:
        if label(one) != SPOKEN:
            continue
        wave, size = wav.read(one.wav), round(SECONDS * wav.RATE_HZ)
        for k in range(len(wave) // size):
            first, last = k * SECONDS, (k + 1) * SECONDS
            own = (word for word in one.take.words if first <= word.start and word.end <= last)
            words = tuple(word._replace(start=word.start - first, end=word.end - first) for word in own)
            found.append(Segment(wave[k * size : (k + 1) * size], words))
    if not found:
        raise ValueError(f"no recording of the style '{SPOKEN}' is {SECONDS:g} s long; give a corpus that has some.")
    return found


def sampled(bench: Bench, judge: Judge, spoken: Sequence[Segment], style: str, sampling: int) -> ledger.Row:
    """What the segments, performed in a style, are taken for."""
    wishes = prompted.wish(bench, prompted.of_text(bench, caption_of(style)))
    seeds = range(100_000 * sampling, 100_000 * sampling + len(spoken))
    voices = [Voice(one.wave, one.words, wishes, seed) for one, seed in zip(spoken, seeds, strict=True)]
    return {"style": style, "sampling": sampling, "seen": [judge.see(made) for made in perform(bench, voices)]}


def perform(bench: Bench, voices: Sequence[Voice]) -> list[Movement]:
    """The bodies of all voices, some at once; each group is filled up, so that one compiled function serves all."""
    made = []
    for k in range(0, len(voices), TOGETHER):
        some = list(voices[k : k + TOGETHER])
        filled = some + some[:1] * (min(TOGETHER, len(voices)) - len(some))
        for latents in chorus.synthesize(bench.model, filled, bench.steps)[: len(some)]:
            made.append(prompted.movement(bench.model, motion_of(bench.model, latents)))
    return made


def report(rows: Sequence[ledger.Row], judge: Judge, count: int) -> str:
    """SRA, mean and deviation over the samplings, and of each style; chance and the judge's own accuracy beside."""
    names = judge.centroids.names

    def right(some: Sequence[ledger.Row]) -> float:
        return 100.0 * float(np.mean([seen == row["style"] for row in some for seen in row["seen"]]))

    each = [right(some) for some in ledger.grouped(rows, "sampling").values()]
    body = [[style, f"{right(some):.1f}"] for style, some in ledger.grouped(rows, "style").items()]
    few = "" if len(names) == len(STYLES) else f" (of the paper's {len(STYLES)}; the corpus has no more)"
    head = (
        f"SRA {np.mean(each):.1f} +- {np.std(each):.1f} % over {len(each)} samplings: {len(names)} styles{few}, "
        f"{count} segments of neutral speech each; chance {100.0 / len(names):.1f} %, recordings "
        f"{100.0 * judge.own:.1f} % ({judge.clips} clips, each by a judge that has not seen it)."
    )
    return f"{head}\n\n{ledger.table(['style', 'recognised, %'], body)}"


if __name__ == "__main__":
    main()
