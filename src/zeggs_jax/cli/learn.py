"""Commands that make models: prepare, train, convert."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from .arguments import Out
from .guards import prepare_folder


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
    from ..data import body
    from ..data import corpus as corpora
    from ..data import prepare as data

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
    prepare_folder(out)
    made = data.prepare(corpus, out, settings, processes)
    print(f"wrote {out}: {data.report.told(made)}")


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

    from ..zeroeggs import train as t

    settings = t.read_config(config) if config else t.TrainConfig()
    if steps is not None:
        settings = replace(settings, steps=steps)
    if print_config:
        print(json.dumps(t.to_dict(settings), indent=1))
        return
    if corpus is None or out is None:
        raise ValueError("train needs a corpus and --out; see 'zeggs train --help'.")
    t.devices.start(coordinator, processes, process)  # before JAX computes anything
    from ..metrics import rollout
    from ..stage import player

    def show(path: Path, clips: Sequence[tuple[str, Any]], title: str) -> None:
        player.write(path, [player.Figure(label, clip) for label, clip in clips], title)

    prepare_folder(out)
    folder = t.prepared_once(corpus, out, settings.speech_columns)
    t.train(folder, out, settings, observers=t.Observers(rollout.measure, show))
    if t.devices.first():
        print(f"trained {settings.steps} steps; use the model with 'zeggs generate SPEECH --checkpoint {out}'")


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
    from ..zeroeggs import release_files

    if to_torch is not None and (networks or processed):
        raise ValueError("--to-torch writes a checkpoint back; leave --networks and --processed out.")
    prepare_folder(out.parent)
    if to_torch is not None:
        release_files.export(to_torch, out)
    elif networks is None or processed is None:
        raise ValueError("convert needs --networks and --processed, or --to-torch; see 'zeggs convert --help'.")
    else:
        release_files.convert(networks, processed, out)
    print(f"wrote {out}")
