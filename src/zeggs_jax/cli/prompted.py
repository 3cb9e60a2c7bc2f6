"""The demo of GestureDiffuCLIP: one speech under many prompts, BVH files and one page with a tab for each idea."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from .diffuse import figure
from .guards import keep_inputs, prepare_folder

PROMPTS = {
    "old": "an old, tired person",
    "happy": "the person is happy",
    "angry": "an angry person",
    "sneaky": "sneaking, crouched low",
}
SCALES = (0.0, 1.0, 2.0, 3.0)
SHORTEST_S = 2.5  # a prompt holds at least so long


class Shot(NamedTuple):
    """One body of the demo."""

    name: str  # of its file
    tab: str
    label: str
    asked: Any  # diffuclip.request.Request


def demo(out: Path, speech: Path | None, transcript: Path | None, seed: int, checkpoint: Path | None) -> None:
    """Writes the demo to folder `out`; the model's own speech, with its words, where none is given."""
    from ..diffuclip import generate as g
    from ..stage import player

    if speech is None:
        if transcript is not None:
            raise ValueError("--transcript was given without --speech; name the recording that it is of.")
        speech = next(iter(g.bundled_speech().values()))
        transcript = speech.with_suffix(".json")
    samples, rate = player.read_speech(speech)
    prepare_folder(out)
    copy = out / f"speech{speech.suffix}"
    planned = shots(speech, transcript, len(samples) / rate, seed)
    outputs = (out / "index.html", copy, *(out / f"{shot.name}.bvh" for shot in planned))
    keep_inputs(outputs, tuple(str(path) for path in (speech, transcript) if path is not None))
    model = g.load_model(checkpoint) if checkpoint else g.bundled_model()
    figures, notes = [], {}
    for shot in tqdm(planned, desc="generating", unit="body"):
        gesture = g.generate(speech, shot.asked, model=model)
        notes.update(dict.fromkeys(gesture.notes))
        g.save(out / f"{shot.name}.bvh", gesture)
        figures.append(figure(shot.asked, gesture, speech, shot.label)._replace(group=shot.tab))
    shutil.copyfile(speech, copy)
    player.write(out / "index.html", figures, title="One speech, many prompts")
    for note in notes:
        print(f"zeggs: note: {note}")
    print(f"wrote {len(figures)} BVH files, their speech and a page; open {out / 'index.html'}")


def shots(speech: Path, transcript: Path | None, seconds: float, seed: int) -> list[Shot]:
    """What the demo shows: prompts of text, guidance, prompts that change, prompts for parts of the body."""
    from ..diffuclip.request import Request

    plain = Request(transcript=None if transcript is None else str(transcript), seed=seed)
    made = [Shot(name, "Four prompts", text, replace(plain, prompt=text)) for name, text in PROMPTS.items()]
    for scale in SCALES:
        label = f"happy, guidance {scale:g}"
        asked = replace(plain, prompt=PROMPTS["happy"], scale=scale)
        made.append(Shot(f"guidance_{scale:g}", "Guidance", label, asked))
    asked = replace(plain, timeline=_changing(speech, transcript, seconds))
    made.append(Shot("sentences", "By the sentence", "a prompt for every sentence", asked))
    for upper, lower in (("happy", "old"), ("old", "happy"), ("angry", "sneaky")):
        asked = replace(plain, parts=(("upper", PROMPTS[upper]), ("lower", PROMPTS[lower])))
        made.append(Shot(f"{upper}_over_{lower}", "Upper and lower body", f"upper: {upper} · lower: {lower}", asked))
    return made


def _changing(speech: Path, transcript: Path | None, seconds: float) -> Any:
    """The prompts one after another, by the sentence; every five seconds of a speech whose words are not known."""
    from ..diffuclip import request as r

    texts = list(PROMPTS.values())
    begun = [5.0 * k for k in range(int(seconds / 5.0) + 1)]
    if transcript is not None:
        begun = [sentence.start for sentence in r.spoken(transcript, speech)]
    starts = [0.0]
    for start in begun[1:]:
        if starts[-1] + SHORTEST_S <= start <= seconds - SHORTEST_S:
            starts.append(start)
    return tuple(r.Cue(start, texts[k % len(texts)]) for k, start in enumerate(starts))
