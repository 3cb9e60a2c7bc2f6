"""Commands that make and show motion: demo, generate, view."""

import shutil
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from tqdm import tqdm
from tyro.conf import Positional, UseAppendAction, arg

from . import bridge, prompted
from .arguments import Out, Ranges, Styles
from .guards import component, frame_range, keep_inputs, prepare_folder, stem

STYLES = ("neutral", "happy", "angry", "old", "sad", "oration")


def demo(
    out: Out = Path("demo"),
    styles: tuple[str, ...] = STYLES,
    speech: Path | None = None,
    seed: int = 1234,
    diffuclip: bool = False,
    transcript: Path | None = None,
    checkpoint: Path | None = None,
) -> None:
    """Make one speech gesture in several styles: BVH and WAV files and one page, index.html, to watch them.

    Args:
        out: The folder to write to.
        styles: Bundled styles to show, or style clips.
        speech: A recording of your own; a bundled one when left out.
        seed: The seed of the style samples.
        diffuclip: Show GestureDiffuCLIP instead: one speech under prompts of words, on one page.
        transcript: With --diffuclip: the timed words of the speech.
        checkpoint: With --diffuclip: a model of your own, from 'zeggs diffuclip train'.
    """
    if diffuclip:
        if styles != STYLES:
            raise ValueError("--styles belong to ZeroEGGS, --diffuclip shows prompts of words; leave one of them out.")
        prompted.demo(out, speech, transcript, seed, checkpoint)
        return
    if transcript is not None or checkpoint is not None:
        raise ValueError("--transcript and --checkpoint belong to --diffuclip here; see 'zeggs generate' for models.")
    from ..stage import player
    from ..zeroeggs import generate as g

    prepare_folder(out)
    model, speech = g.bundled_model(), speech or next(iter(g.bundled_speech().values()))
    copy = out / f"speech{speech.suffix}"
    keep_inputs((copy, *(out / f"{stem(style)}.bvh" for style in styles)), (str(speech), *styles))
    figures = []
    for style in tqdm(styles, desc="generating", unit="style"):
        gesture = g.generate(speech, g.Request(styles=(style,), seed=seed), model=model)
        name = stem(style)
        g.save(out / f"{name}.bvh", gesture)
        figures.append(player.Figure(name, gesture.clip, speech))
    shutil.copyfile(speech, copy)
    player.write(out / "index.html", figures, title="One speech, several styles")
    print(f"wrote {len(figures)} BVH files, their speech and a page; open {out / 'index.html'}")


def generate(
    speech: Positional[Path | None] = None,
    /,
    *,
    out: Out,
    style: Styles = (),
    weights: tuple[float, ...] = (),
    spans: tuple[float, ...] = (),
    frames: Ranges = (),
    timeline: Path | None = None,
    intensity: float = 1.0,
    pca: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="K=AMOUNT")] = (),
    library: Path | None = None,
    prompt: Annotated[str | None, arg(metavar="PROMPT")] = None,
    prompts_from: Path | None = None,
    first_pose: Path | None = None,
    temperature: float = 1.0,
    seed: int = 1234,
    html: Path | None = None,
    checkpoint: Path | None = None,
    csv: Path | None = None,
    precision: Literal["float32", "bfloat16", "int8"] = "float32",
) -> None:
    """Make a gesturing body from a speech recording, in a style.

    Args:
        speech: A WAV, FLAC or OGG recording.
        out: The BVH file to write (with --csv: the folder).
        style: A bundled style (see 'zeggs styles'), a .bvh clip, a library of one style from 'zeggs embed', or one of
            its styles as in lib.npz:NAME; repeat to mix.
        weights: Blend the styles with these weights (they sum to 1).
        spans: Or play the styles one after the other, each for this share of the time (they sum to 1).
        frames: Cut the style clips to frames A to B (B not included); one for each style, or one for all.
        timeline: Styles over time instead, from a file of 'zeggs timeline'.
        intensity: 0 is the mean of the library, 1 the style, above 1 exaggerated.
        pca: Move along a principal component of the library by so many standard deviations, as in 1=+2.0; repeat for
            more. Without a style: from the library's mean.
        library: A library from 'zeggs embed' for --intensity, --pca and names of styles; the bundled model has its own.
        prompt: Words, a .bvh or a video: mixes those of the styles (without any: the bundled ones) that are near to it.
        prompts_from: The GestureDiffuCLIP model that reads --prompt; the bundled one when left out.
        first_pose: A .bvh whose first frame the body starts from.
        temperature: 0 gives the mean of the style, higher values vary more.
        seed: The same seed gives the same file.
        html: Also write a page that plays the body with its speech.
        checkpoint: A model of your own, from 'zeggs train' or 'zeggs convert'.
        csv: Make many at once from a table with the columns audio, style, file_name, temperature, seed, frames ("A B"),
            first_pose, base_path, generate (all but audio may be left out).
        precision: Of the decoder's weights: fewer bytes are read faster by a CPU, and move the body nearly the same.
            The first time, a kernel is compiled; without a C++ compiler they are as slow as float32.
    """
    from ..zeroeggs import generate as g
    from ..zeroeggs import timeline as timelines

    _check_speech(speech, csv, html)
    others = bool(weights or spans or frames or timeline)
    style, weights, notes = bridge.chosen(prompt, prompts_from, style, weights, others)
    request = g.Request(
        styles=style,
        weights=weights,
        spans=spans,
        frames=tuple(frame_range(text) for text in frames),
        first_pose=None if first_pose is None else str(first_pose),
        temperature=temperature,
        seed=seed,
        intensity=intensity,
        pca=tuple(component(text) for text in pca),
        timeline=None if timeline is None else timelines.read(timeline),
        library=None if library is None else str(library),
    )
    outputs = () if csv else tuple(filter(None, (out, html)))
    shown = timelines.names(request.timeline) if request.timeline else request.styles
    keep_inputs(outputs, (*map(str, filter(None, (speech, first_pose, timeline, library))), *shown))
    for folder in (out,) if csv else (path.parent for path in outputs):
        prepare_folder(folder)
    model = g.load_model(checkpoint) if checkpoint else g.bundled_model()
    if csv is not None:
        return _make_all(csv, request, model, out, notes, precision)
    assert speech is not None
    title = " + ".join(map(stem, shown)) or ("neutral" if not pca else "the mean")
    _make(speech, request, model, out, html, title, notes, precision)


def _check_speech(speech: Path | None, csv: Path | None, html: Path | None) -> None:
    if csv is None and speech is None:
        raise ValueError("no speech was given; name a recording, or a table of them with --csv.")
    if csv is not None and (speech is not None or html is not None):
        raise ValueError("--csv names the recordings itself; leave SPEECH and --html out.")


def _make_all(csv: Path, request: Any, model: Any, out: Path, notes: tuple[str, ...], precision: Any) -> None:
    from ..nn import reduced
    from ..zeroeggs import batch

    made = batch.generate_all(csv, out, request, model, precision)
    _tell((*notes, *reduced.notes(precision)))
    print(f"wrote {len(made)} file{'s'[: len(made) != 1]} to {out}")


def _make(
    speech: Path,
    request: Any,
    model: Any,
    out: Path,
    html: Path | None,
    title: str,
    notes: tuple[str, ...],
    precision: Any,
) -> None:
    """One recording: motion, provenance, page, and what is worth knowing of the style."""
    from ..stage import player
    from ..zeroeggs import generate as g

    gesture = g.generate(speech, request, model=model, precision=precision)
    g.save(out, gesture)
    if html is not None:
        player.write(html, [player.Figure(title, gesture.clip, speech)])
    _tell((*notes, *gesture.notes))
    print(f"wrote {out}: {gesture.clip.euler.shape[0]} frames")


def _tell(notes: tuple[str, ...]) -> None:
    for note in notes:
        print(f"zeggs: note: {note}", file=sys.stderr)


def view(clips: Positional[tuple[Path, ...]], /, *, out: Out = Path("view.html"), speech: Path | None = None) -> None:
    """Write a page that plays BVH clips side by side, with a speech if one is given.

    Args:
        clips: The .bvh files.
        out: The page to write.
        speech: The recording to play with them.
    """
    from ..stage import player

    prepare_folder(out.parent)
    player.write(out, [player.read_figure(clip, speech) for clip in clips])
    print(f"wrote {out}")
