"""A training run's folder: which corpus and which settings it belongs to, so that it resumes only with those."""

import json
from pathlib import Path
from typing import Any

from ..data import prepare as preparation
from ..data.prepared import MANIFEST
from ..training import checkpoint, devices
from ..training.plain import to_dict
from .settings import TrainConfig

FREE = {
    "steps", "log_every", "checkpoint_every", "keep", "keep_every", "keep_best", "validate_every", "validate_clips",
    "sample_every", "explode", "resident", "accumulate", "remat",
}  # fmt: skip
"""Settings that a resumed run may change: none changes what an update is; the last two change its rounding."""


def prepared(corpus: str | Path, out: str | Path, speech_columns: bool = False) -> Path:
    """The folder of arrays to train on: `corpus` if it is prepared, else OUT/prepared, made if need be.

    ValueError when that was made of another corpus or of files that have changed since, as their hashes tell, or
    with the other `speech_columns`; and all errors of data/prepare.py.
    """
    corpus, folder = Path(corpus), Path(out) / "prepared"
    if (corpus / MANIFEST).exists():
        return corpus
    config = preparation.PrepareConfig(speech_columns=speech_columns)
    if not (folder / MANIFEST).exists():
        preparation.prepare(corpus, folder, config)
        return folder
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        made, source = manifest["config"]["speech_columns"], manifest["source"]
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(
            f"'{folder / MANIFEST}' is damaged: delete '{folder}', and the same command prepares the corpus again."
        ) from error
    if made != speech_columns:
        raise ValueError(
            f"run '{out}' prepared its corpus with speech_columns = {made}, now it is {speech_columns}: resume "
            "with the same settings, or choose another folder."
        )
    if manifest.get("made_of") != preparation.made_of(corpus, config):
        raise ValueError(
            f"run '{out}' was started on a corpus '{source}', and '{corpus}' is another one or has changed "
            f"since: name the first one as it was, '{folder}' to go on with its arrays, or another -o."
        )
    return folder


def prepared_once(corpus: str | Path, out: str | Path, speech_columns: bool = False) -> Path:
    """`prepared`, by the first process of a run while the others wait for it."""
    made: list[Path] = []
    devices.first_does(lambda: made.append(prepared(corpus, out, speech_columns)))
    return made[0] if made else prepared(corpus, out, speech_columns)


def check_same(checkpoint_path: Path, given: dict[str, Any], out: Path) -> None:
    """ValueError naming the first setting in which the run's newest checkpoint differs from what is `given`."""
    started = checkpoint.metadata(checkpoint_path)
    before, now = _flat(started.get("training", {})), _flat(given["training"])
    lacked = {"speech_columns": now["speech_columns"], "windows.mirror": 0.0, "windows.pace": 0.0}
    before = _flat(to_dict(TrainConfig())) | lacked | before  # what the versions did that lacked a setting
    for name in [*now, *before]:
        if before.get(name) != now.get(name) and name not in FREE:
            raise ValueError(
                f"run '{out}' was started with {name} = {before.get(name)}, now it is {now.get(name)}: resume with "
                "the same settings, or choose another folder."
            )
    if started.get("corpus") != given["corpus"]:
        raise ValueError(
            f"run '{out}' was started on another corpus: resume with the same one, or choose another folder."
        )


def _flat(config: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat = {}
    for name, value in config.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return flat


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a JSON file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial_file = path.with_name(f".{path.name}.partial")
    partial_file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    partial_file.replace(path)
