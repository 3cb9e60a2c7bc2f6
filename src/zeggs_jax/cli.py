"""The `zeggs` command: one function for each subcommand, one sentence for each thing that can go wrong."""

import os
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import tyro
from tqdm import tqdm
from tyro.conf import Positional, UseAppendAction, arg

Out = Annotated[Path, arg(aliases=["-o"])]
Styles = Annotated[UseAppendAction[tuple[str, ...]], arg(aliases=["-s"], metavar="STYLE")]
Ranges = Annotated[tuple[str, ...], arg(metavar="A:B")]

app = tyro.extras.SubcommandApp()


@app.command
def demo(
    out: Out = Path("demo"),
    styles: tuple[str, ...] = ("neutral", "happy", "angry", "old", "sad", "oration"),
    speech: Path | None = None,
    seed: int = 1234,
) -> None:
    """Make one speech gesture in several styles: BVH and WAV files and one page, index.html, to watch them.

    Args:
        out: The folder to write to.
        styles: Bundled styles to show, or style clips.
        speech: A recording of your own; a bundled one when left out.
        seed: The seed of the style samples.
    """
    from .stage import player
    from .zeroeggs import generate as g

    _prepare_folder(out)
    model, speech = g.bundled_model(), speech or next(iter(g.bundled_speech().values()))
    copy = out / f"speech{speech.suffix}"
    _keep_inputs((copy, *(out / f"{_stem(style)}.bvh" for style in styles)), (str(speech), *styles))
    figures = []
    for style in tqdm(styles, desc="generating", unit="style"):
        gesture = g.generate(speech, g.Request(styles=(style,), seed=seed), model=model)
        name = _stem(style)
        g.save(out / f"{name}.bvh", gesture)
        figures.append(player.Figure(name, gesture.clip, speech))
    shutil.copyfile(speech, copy)
    player.write(out / "index.html", figures, title="One speech, several styles")
    print(f"wrote {len(figures)} BVH files, their speech and a page; open {out / 'index.html'}")


@app.command
def generate(
    speech: Positional[Path | None] = None,
    /,
    *,
    out: Out,
    style: Styles = (),
    weights: tuple[float, ...] = (),
    spans: tuple[float, ...] = (),
    frames: Ranges = (),
    first_pose: Path | None = None,
    temperature: float = 1.0,
    seed: int = 1234,
    html: Path | None = None,
    checkpoint: Path | None = None,
    csv: Path | None = None,
) -> None:
    """Make a gesturing body from a speech recording, in a style.

    Args:
        speech: A WAV, FLAC or OGG recording.
        out: The BVH file to write (with --csv: the folder).
        style: A bundled style (see 'zeggs styles'), a .bvh clip, or an .npz from 'zeggs embed'; repeat to mix.
        weights: Blend the styles with these weights (they sum to 1).
        spans: Or play the styles one after the other, each for this share of the time (they sum to 1).
        frames: Cut the style clips to frames A to B (B not included); one for each style, or one for all.
        first_pose: A .bvh whose first frame the body starts from.
        temperature: 0 gives the mean of the style, higher values vary more.
        seed: The same seed gives the same file.
        html: Also write a page that plays the body with its speech.
        checkpoint: A model of your own, from 'zeggs train' or 'zeggs convert'.
        csv: Make many at once from a table with the columns audio, style, file_name, temperature, seed, frames ("A B"),
            first_pose, base_path, generate (all but audio may be left out).
    """
    from .stage import player
    from .zeroeggs import generate as g

    if csv is None and speech is None:
        raise ValueError("no speech was given; name a recording, or a table of them with --csv.")
    if csv is not None and (speech is not None or html is not None):
        raise ValueError("--csv names the recordings itself; leave SPEECH and --html out.")
    request = g.Request(
        styles=style or ("neutral",),
        weights=weights,
        spans=spans,
        frames=tuple(_frame_range(text) for text in frames),
        first_pose=None if first_pose is None else str(first_pose),
        temperature=temperature,
        seed=seed,
    )
    outputs = () if csv else tuple(filter(None, (out, html)))
    _keep_inputs(outputs, (str(speech), *request.styles, str(first_pose)))
    for folder in (out,) if csv else (path.parent for path in outputs):
        _prepare_folder(folder)
    model = g.load_model(checkpoint) if checkpoint else g.bundled_model()
    if csv is not None:
        from .zeroeggs import batch

        print(f"wrote {len(batch.generate_all(csv, out, request, model))} files to {out}")
        return
    assert speech is not None
    gesture = g.generate(speech, request, model=model)
    g.save(out, gesture)
    if html is not None:
        player.write(html, [player.Figure(" + ".join(map(_stem, request.styles)), gesture.clip, speech)])
    print(f"wrote {out}: {gesture.clip.euler.shape[0]} frames")


@app.command
def embed(
    clips: Positional[tuple[str, ...]], /, *, out: Out, frames: Ranges = (), checkpoint: Path | None = None
) -> None:
    """Encode style clips and save their embeddings, to generate from later.

    Args:
        clips: Bundled styles or .bvh clips.
        out: The .npz file to write (for several clips: the folder).
        frames: Cut the clips to frames A to B (B not included); one for each clip, or one for all.
        checkpoint: A model of your own, from 'zeggs train' or 'zeggs convert'.
    """
    from .zeroeggs import examples
    from .zeroeggs import generate as g

    model = g.load_model(checkpoint) if checkpoint else g.bundled_model()
    request = g.Request(styles=clips, frames=tuple(_frame_range(text) for text in frames))
    paths = [out] if len(clips) == 1 else [out / f"{_stem(clip)}.npz" for clip in clips]
    for path, example in zip(paths, g.read_styles(request, model), strict=True):
        _prepare_folder(path.parent)
        examples.save(path, example, model)
        print(f"wrote {path}")


@app.command
def styles() -> None:
    """List the bundled styles."""
    from .zeroeggs import examples

    print("\n".join(examples.bundled()))


@app.command
def prepare(
    corpus: Positional[Path],
    /,
    *,
    out: Out,
    as_released: bool = False,
    rate: float | None = None,
    scale: float | None = None,
    up: str | None = None,
    facing: str | None = None,
    skeleton: Path | None = None,
    min_frames: int = 8,
    skip_bad: bool = False,
    log_mel: bool = False,
    speech_columns: bool = False,
    save_trimmed: bool = False,
    processes: int | None = None,
) -> None:
    """Turn a folder of BVH and WAV pairs into the arrays that training reads; stopped, it goes on where it was.

    Args:
        corpus: A folder of name.bvh + name.wav, or the ZEGGS download.
        out: The folder to write to.
        as_released: Reproduce the release's data pipeline, its errors included.
        rate: Resample the motion to this many frames per second.
        scale: Centimetres per unit of the BVH files; found from the body's size when left out.
        up: The axis of the files that points up: x, y, z, or as --up=-z one of -x, -y, -z; found when left out.
        facing: The axis of the hips' own frame that points ahead, as for --up; found when left out.
        skeleton: A TOML file with scale, up, facing and, under [roles], the names of hips, spine, head...
        min_frames: Shorter clips cannot be used.
        skip_bad: Leave out clips that cannot be used instead of stopping; OUT/report.json lists them.
        log_mel: Speech features that are true log-mels, each with a standard deviation of its own.
        speech_columns: Give every speech feature a standard deviation of its own (the release has one for all).
        save_trimmed: Also write the clips as they are used, as BVH and WAV, into OUT/trimmed.
        processes: How many clips are made at a time; as many as there are cores when left out.
    """
    from .data import body
    from .data import corpus as corpora
    from .data import prepare as data

    corpora.survey(corpus)
    read = body.read_body(skeleton) if skeleton else body.BodyConfig()
    read = replace(read, scale=scale) if scale is not None else read
    read = replace(read, up=body.axis(up, "--up is")) if up is not None else read
    read = replace(read, facing=body.axis(facing, "--facing is")) if facing is not None else read
    settings = data.PrepareConfig(
        as_released=as_released,
        rate_hz=rate,
        speech_columns=speech_columns,
        save_trimmed=save_trimmed,
        skip_bad=skip_bad,
        min_frames=min_frames,
        body=read,
        speech=replace(data.MENDED.speech, log_mel=log_mel),
    )
    _prepare_folder(out)
    made = data.prepare(corpus, out, settings, processes)
    print(f"wrote {out}: {data.report.told(made)}")


@app.command
def train(
    corpus: Positional[Path | None] = None,
    /,
    *,
    out: Annotated[Path | None, arg(aliases=["-o"])] = None,
    config: Path | None = None,
    steps: int | None = None,
    print_config: bool = False,
    coordinator: str | None = None,
    processes: int | None = None,
    process: int | None = None,
) -> None:
    """Train a model on a corpus; run the same command again to go on where it stopped.

    Args:
        corpus: A folder of name.bvh + name.wav pairs, or one that 'zeggs prepare' wrote.
        out: The folder of the run: checkpoints, log, samples.
        config: A JSON file with the settings to change; the paper's, as released, when left out.
        steps: How many steps to train, whatever the settings say.
        print_config: Only print all settings, as a JSON file to start from.
        coordinator: In a run of several processes, HOST:PORT of process 0; 'auto' asks the cluster.
        processes: How many processes the run has.
        process: Which one this is, from 0.
    """
    import json

    from .zeroeggs import train as t
    from .zeroeggs.config import to_dict

    settings = t.read_config(config) if config else t.TrainConfig()
    if steps is not None:
        settings = replace(settings, steps=steps)
    if print_config:
        print(json.dumps(to_dict(settings), indent=1))
        return
    if corpus is None or out is None:
        raise ValueError("train needs a corpus and --out; see 'zeggs train --help'.")
    t.devices.start(coordinator, processes, process)  # before JAX computes anything
    from .metrics import rollout
    from .stage import player

    def show(path: Path, clips: Sequence[tuple[str, Any]], title: str) -> None:
        player.write(path, [player.Figure(label, clip) for label, clip in clips], title)

    _prepare_folder(out)
    folder = t.prepared_once(corpus, out, settings.speech_columns)
    t.train(folder, out, settings, observers=t.Observers(rollout.measure, show))
    if t.devices.first():
        print(f"trained {settings.steps} steps; use the model with 'zeggs generate SPEECH --checkpoint {out}'")


@app.command
def convert(
    *, out: Out, networks: Path | None = None, processed: Path | None = None, to_torch: Path | None = None
) -> None:
    """Turn the PyTorch release's files into a checkpoint, or a checkpoint back into plain arrays.

    Args:
        out: The checkpoint to write (with --to-torch: the .npz).
        networks: The folder of decoder.pt, style_encoder.pt and speech_encoder.pt.
        processed: The folder of stats.npz, data_definition.json and data_pipeline_conf.json.
        to_torch: A checkpoint to write back as arrays named as in the release's state_dicts.
    """
    from .zeroeggs import release_files

    if to_torch is not None and (networks or processed):
        raise ValueError("--to-torch writes a checkpoint back; leave --networks and --processed out.")
    _prepare_folder(out.parent)
    if to_torch is not None:
        release_files.export(to_torch, out)
    elif networks is None or processed is None:
        raise ValueError("convert needs --networks and --processed, or --to-torch; see 'zeggs convert --help'.")
    else:
        release_files.convert(networks, processed, out)
    print(f"wrote {out}")


@app.command
def view(clips: Positional[tuple[Path, ...]], /, *, out: Out = Path("view.html"), speech: Path | None = None) -> None:
    """Write a page that plays BVH clips side by side, with a speech if one is given.

    Args:
        clips: The .bvh files.
        out: The page to write.
        speech: The recording to play with them.
    """
    from .stage import player

    _prepare_folder(out.parent)
    player.write(out, [player.read_figure(clip, speech) for clip in clips])
    print(f"wrote {out}")


def _stem(style: str) -> str:
    return Path(style).stem


def _frame_range(text: str) -> tuple[int, int]:
    start, colon, stop = text.partition(":")
    if not (colon and start.strip().isdigit() and stop.strip().isdigit() and int(start) < int(stop)):
        raise ValueError(f"--frames got '{text}'; give START:STOP in frames, such as 30:150.")
    return int(start), int(stop)


def _prepare_folder(folder: Path) -> None:
    """Creates the folder and proves that it can be written to, before any work is done."""
    probe = folder / f".zeggs-{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ValueError(f"cannot write to folder '{folder}' ({error.strerror}); name another one.") from error


def _keep_inputs(outputs: tuple[Path, ...], inputs: tuple[str, ...]) -> None:
    """Refuses to write over what is read, over a folder, or twice to one place."""
    read = {Path(name).resolve() for name in inputs}
    for number, path in enumerate(outputs):
        if path.resolve() in read or path.resolve() in {other.resolve() for other in outputs[:number]}:
            raise ValueError(f"'{path}' would be written over; give the output another name.")
        if path.is_dir():
            raise ValueError(f"'{path}' is a folder; give the name of a file.")


def _sentence(error: Exception) -> str:
    """What an error says, in one line; those of the system name the file first."""
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"'{error.filename}' cannot be read or written ({error.strerror}); check its name, its rights, the disk."
    return " ".join(str(error).split())


def main() -> None:
    """Runs the command line; bad input ends in one sentence on stderr and exit status 2."""
    if sys.argv[1:] == ["--version"]:
        print(f"zeggs-jax {version('zeggs-jax')}")
        return
    try:
        app.cli(
            prog="zeggs",
            description="Speech in, a moving body out, in a style you choose.",
        )
    except KeyboardInterrupt as stop:
        print(f"zeggs: {str(stop) or 'stopped'}.", file=sys.stderr)
        sys.exit(130)
    except (ValueError, OSError) as error:
        if os.environ.get("ZEGGS_DEBUG"):
            raise
        print(f"zeggs: {_sentence(error)}", file=sys.stderr)
        if train := sys.modules.get(f"{__package__}.zeroeggs.train"):
            train.devices.leave(2)  # one process of several must not wait for the others, which wait for it
        sys.exit(2)
