"""Bodies under prompts: one speech in four styles, guidance 0 to 3, sentence by sentence, by halves (Fig. 1, 9, 10).

    python experiments/18_bodies_diffuclip.py -o runs/bodies [--checkpoint RUN] [--speech WAV --transcript JSON]

Each row of (a) is shown at the words written above it; (b) and (c) at the instant nearest to the mean pose, (d) in the
middle of every sentence, whose prompt is written above.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

import instrument
from zeggs_jax.diffuclip import generate as g
from zeggs_jax.diffuclip import request
from zeggs_jax.diffuclip.generate import Gesture, Request
from zeggs_jax.diffuclip.model import Model
from zeggs_jax.speech import transcript
from zeggs_jax.speech.transcript import Word
from zeggs_jax.stage import plots, poses
from zeggs_jax.stage.drawing import Layout
from zeggs_jax.synthetic import lexicon

PROMPTS = ("an old, tired person", "a happy person", "an angry man talks", "someone who is scared")
GUIDED, SCALES = "a sneaky person", (0.0, 1.0, 2.0, 3.0)
HALVES = (
    ("a happy person", "an old person"), ("an old person", "a happy person"),
    ("an angry person", "a still person"), ("a tired person", "a scared person"),
)  # fmt: skip
COLUMNS = 8
LEFT_OUT = ("a", "an", "person", "man", "talks", "someone", "who", "is")
WORDS_FROM_S = 1.5  # before, a body only begins


class Group(NamedTuple):
    """Bodies side by side under a title."""

    place: tuple[int, int]  # row and column of the first
    title: str
    shown: Sequence[tuple[Gesture, float, str]]  # of what, at which second, what is written above it
    colour: str


def spoken(words: Sequence[Word], count: int) -> list[tuple[float, str]]:
    """(middle, word) of words to look at, in order: those with gestures of their own first, then any."""
    later = [word for word in words if word.start >= WORDS_FROM_S]
    telling = [word for word in later if lexicon.find(word.text)] or later
    chosen = [telling[k] for k in np.linspace(0, len(telling) - 1, min(count, len(telling))).round().astype(int)]
    return [((word.start + word.end) / 2, word.text.strip(".,;:!?")) for word in chosen]


def groups(model: Model, speech: Path, written: Path, steps: int) -> list[Group]:
    """All that is drawn."""
    words = transcript.read(written)
    bar = tqdm(desc="bodies", unit="clip")

    def make(asked: Request) -> Gesture:
        bar.update()
        return g.generate(speech, asked, model=model)

    base = {"transcript": str(written), "steps": steps}
    half, found = COLUMNS // 2, []
    for k, prompt in enumerate(PROMPTS):
        made = make(Request(prompt, **base))
        shown = [(made, *each) for each in spoken(words, half)]
        found.append(Group((k // 2, k % 2 * half), f"“{prompt}”", shown, plots.COLOURS[k]))
    scaled = [make(Request(GUIDED, scale=scale, **base)) for scale in SCALES]
    shown = [(one, instrument.typical(one.clip), f"s = {s:g}") for one, s in zip(scaled, SCALES, strict=True)]
    found.append(Group((2, 0), f"(b) “{GUIDED}”, guidance s", shown, plots.COLOURS[4]))
    parts = [(make(Request(parts=(("upper", a), ("lower", b)), **base)), a, b) for a, b in HALVES if model.config.parts]
    shown = [(one, instrument.typical(one.clip), f"{_short(a)} on {_short(b)} legs") for one, a, b in parts]
    found.append(Group((2, half), "(c) upper and lower body under prompts of their own", shown, plots.COLOURS[4]))
    sentences = transcript.sentences(words)[:COLUMNS]
    if len(sentences) > 1:
        texts = [PROMPTS[k % len(PROMPTS)] for k in range(len(sentences))]
        made = make(Request(timeline=request.by_sentence(sentences, texts), **base))
        middles = [(one.words[0].start + one.words[-1].end) / 2 for one in sentences]
        shown = [(made, middle, _short(text)) for middle, text in zip(middles, texts, strict=True)]
        found.append(Group((3, 0), "(d) a prompt for every sentence", shown, plots.COLOURS[5]))
    bar.close()
    return found


def _short(prompt: str) -> str:
    """The prompt's adjectives."""
    return " ".join(word for word in prompt.split() if word not in LEFT_OUT)


def draw(path: Path, found: Sequence[Group]) -> None:
    """One group beside or under the other."""
    layout, count = Layout(width=104), 1 + max(group.place[0] for group in found)
    with plots.sheet(path, plots.PAGE, 1.85 * count) as figure:
        axes = figure.add_subplot()
        poses.bare(axes, COLUMNS, count, layout)
        for number, group in enumerate(found):
            row, first = group.place
            label = f"(a) {group.title}" if number == 0 else group.title
            corner = (first * layout.width, row * layout.height + 4)
            axes.text(*corner, label, fontsize=6.5, fontweight="bold", va="center")
            for column, (made, instant, text) in enumerate(group.shown, first):
                poses.line_up(axes, made.clip, [instant], group.colour, layout, row, column)
                middle = ((column + 0.5) * layout.width, row * layout.height + 17)
                axes.text(*middle, text, fontsize=5.5, ha="center", va="center")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkpoint", type=Path, help="a run of 'zeggs diffuclip train' (or the bundled model)")
    parser.add_argument("--speech", type=Path, help="a recording; if left out, the bundled synthetic one")
    parser.add_argument("--transcript", type=Path, help="its timed words; if left out, the .json beside it")
    parser.add_argument("--steps", type=int, default=20, help="of the solver")
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    model = g.load_model(args.checkpoint) if args.checkpoint else g.bundled_model()
    speech = args.speech or g.bundled_speech()["synthetic"]
    found = groups(model, speech, args.transcript or speech.with_suffix(".json"), args.steps)
    draw(args.out / "bodies.png", found)
    print(f"wrote {args.out / 'bodies.png'}")


if __name__ == "__main__":
    main()
