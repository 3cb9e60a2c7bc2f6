"""Commands of GestureDiffuCLIP: `zeggs diffuclip train` and `zeggs diffuclip generate`."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from .arguments import Out
from .guards import keep_inputs, prepare_folder

Prompt = Annotated[str | None, arg(metavar="PROMPT")]


def train(
    corpus: Positional[Path | None] = None,
    /,
    *,
    out: Annotated[Path | None, arg(aliases=["-o"])] = None,
    config: Path | None = None,
    small: bool = False,
    t5: Path | None = None,
    clip: Path | None = None,
    scale_steps: float = 1.0,
    print_config: bool = False,
) -> None:
    """Train GestureDiffuCLIP in its stages; run the same command again to go on where it stopped.

    Args:
        corpus: A folder of name.bvh + name.wav pairs, with transcripts of timed words (name.json, .TextGrid, .tsv).
        out: The folder of the run: a folder for each stage, and the model at the end.
        config: A JSON file with the settings to change; the paper's sizes when left out.
        small: The settings of the bundled model instead, which two CPU cores train.
        t5: The local folder with T5 (config.json, model.safetensors, tokenizer.json), which the paper's settings read.
        clip: The local folder with CLIP, the same way.
        scale_steps: Multiply the number of updates of every stage, as in 0.01 for a trial.
        print_config: Only print all settings, as a JSON file to start from.
    """
    from ..diffuclip import config as c
    from ..diffuclip import train as t
    from ..diffuclip import weights

    if small and config is not None:
        raise ValueError("--small and --config were given; give one of them (--small --print-config is a start).")
    settings = c.SMALL if small else c.DiffuclipConfig() if config is None else t.read_config(config)
    settings = _scaled(_with_folders(settings, t5, clip), scale_steps)
    if print_config:
        import json

        print(json.dumps(t.to_dict(settings), indent=1))
        return
    if corpus is None or out is None:
        raise ValueError("train needs a corpus and --out; see 'zeggs diffuclip train --help'.")
    weights.check(settings)
    prepare_folder(out)
    t.train(corpus, out, settings)
    print(f"trained; use the model with 'zeggs diffuclip generate SPEECH --checkpoint {out}'")


def _with_folders(settings: Any, t5: Path | None, clip: Path | None) -> Any:
    """The settings with the folders of published weights that the command line names."""
    if t5 is not None:
        settings = replace(settings, joint=replace(settings.joint, text="t5", folder=str(t5)))
    if clip is not None:
        settings = replace(settings, prompts=replace(settings.prompts, text="clip", image="clip", clip=str(clip)))
    return settings


def _scaled(settings: Any, factor: float) -> Any:
    """The settings with so many times the updates in every stage, at least one."""
    if not 0 < factor < float("inf"):
        raise ValueError(f"--scale-steps is {factor:g}; give a number above 0, as 0.01 for a trial.")
    if factor == 1.0:
        return settings
    stages = {name: value for name, value in vars(settings).items() if name.startswith("learn_")}
    shorter = {name: replace(one, steps=max(1, round(one.steps * factor))) for name, one in stages.items()}
    return replace(settings, **shorter)


def generate(
    speech: Positional[Path],
    /,
    *,
    out: Out,
    prompt: Prompt = None,
    transcript: Path | None = None,
    transcribe: Path | None = None,
    scale: float = 2.0,
    upper: Prompt = None,
    lower: Prompt = None,
    timeline: Path | None = None,
    steps: int = 20,
    solver: Literal["dpm", "ddim", "ddpm"] = "dpm",
    chunk: int | None = None,
    seam: float | None = None,
    seed: int = 1234,
    html: Path | None = None,
    checkpoint: Path | None = None,
) -> None:
    """Make a gesturing body from a speech, its words, and a prompt of words, motion or video.

    Args:
        speech: A WAV, FLAC or OGG recording.
        out: The BVH file to write.
        prompt: How the body shall move: words, as in "an old, tired person", or a .bvh clip, or a video (.mp4).
        transcript: The words of the speech, timed: .json, .srt, .vtt, .tsv or .TextGrid; or, less exact, a plain .txt.
        transcribe: Without a transcript: write the English words that a recogniser hears to this .json, and use them.
        scale: How strongly the prompt is followed: 0 not at all, 1 as trained, more exaggerates.
        upper: A prompt for the upper body alone.
        lower: A prompt for the lower body alone.
        timeline: Prompts over time, JSON: {"cues": [{"time": 0, "prompt": "..."}, ...]}, or {"sentences": ["...", ...]}
            for one prompt after another by the sentences of the transcript.
        steps: Denoising steps of each chunk; more are slower and finer.
        solver: How a step is taken; ddpm is the paper's, and needs many of them.
        chunk: Latents made at once; 1 is the paper's Eq. 9 to the letter.
        seam: Weight of the smoothness between parts with prompts of their own (Eq. 19); 0 is fast.
        seed: The same seed gives the same file.
        html: Also write a page that plays the body with its speech, its words and its prompts.
        checkpoint: A model of your own, from 'zeggs diffuclip train'.
    """
    from ..diffuclip import generate as g
    from ..diffuclip import request as r

    if transcribe is not None:
        transcript = _heard(transcribe, transcript, speech)
    parts = tuple((name, text) for name, text in (("upper", upper), ("lower", lower)) if text is not None)
    asked = g.Request(
        prompt=prompt, timeline=_cues(timeline, transcript, speech), parts=parts, scale=scale, steps=steps,
        solver=solver, seam=seam, chunk=chunk, transcript=None if transcript is None else str(transcript), seed=seed,
    )  # fmt: skip
    outputs = tuple(filter(None, (out, html)))
    claimed = (*outputs, out.with_suffix(".provenance.json"))
    shown = (text for text in (prompt, *(text for _, text in parts), *(cue.prompt for cue in asked.timeline)) if text)
    named = tuple(text for text in shown if r.kind_of(text) != "text")
    keep_inputs(claimed, (*map(str, filter(None, (speech, transcript, timeline))), *named))
    if out.suffix.lower() != ".bvh":
        raise ValueError(f"'{out}' is no name for motion; give one that ends in .bvh.")
    for path in outputs:
        prepare_folder(path.parent)
    model = g.load_model(checkpoint) if checkpoint else g.bundled_model()
    gesture = g.generate(speech, asked, model=model, progress=sys.stderr.isatty())
    g.save(out, gesture)
    if html is not None:
        from ..stage import player

        player.write(html, [figure(asked, gesture, speech)])
    for note in gesture.notes:
        print(f"zeggs: note: {note}", file=sys.stderr)
    print(f"wrote {out}: {gesture.clip.euler.shape[0]} frames")


def _heard(words: Path, transcript: Path | None, speech: Path) -> Path:
    """The file `words`, once the words of the speech are heard and written to it."""
    from ..diffuclip import asr

    if transcript is not None:
        raise ValueError("--transcript and --transcribe were given; give one of them.")
    keep_inputs((words,), (str(speech),))
    prepare_folder(words.parent)
    return asr.write(words, asr.transcribe(speech))


def _cues(timeline: Path | None, transcript: Path | None, speech: Path) -> Any:
    """Prompts over time; by the sentence, where the file says so."""
    if timeline is None:
        return ()
    from ..diffuclip import request as r

    return r.read_timeline(timeline, () if transcript is None else r.spoken(transcript, speech))


def figure(asked: Any, gesture: Any, speech: Path, label: str | None = None) -> Any:
    """What the page shows of a gesture: the body, its prompt, and the words as they are spoken."""
    from ..stage import player

    cues = tuple((cue.time, _named(cue.prompt)) for cue in asked.timeline)
    return player.Figure(label or _label(asked), gesture.clip, speech, words=gesture.words, cues=cues)


def _label(asked: Any) -> str:
    parts = " · ".join(f"{name}: {_named(text)}" for name, text in asked.parts)
    return " · ".join(filter(None, (_named(asked.prompt or ""), parts))) or (
        "prompts over time" if asked.timeline else "no prompt"
    )


def _named(prompt: str) -> str:
    """A prompt as a page tells it: of a file only its name."""
    from ..diffuclip import request as r

    return prompt if r.kind_of(prompt) == "text" else Path(prompt).name
