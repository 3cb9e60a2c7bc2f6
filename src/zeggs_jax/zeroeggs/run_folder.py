"""A training run's folder: which corpus and which settings it belongs to, so that it resumes only with those."""

import json
from pathlib import Path
from typing import Any

from ..data import corpus as corpora
from ..data import prepare as preparation
from ..training import checkpoint, devices
from .config import to_dict
from .settings import TrainConfig

FREE = {
    "steps", "log_every", "checkpoint_every", "keep", "keep_every", "keep_best", "validate_every", "validate_clips",
    "sample_every", "explode", "accumulate", "remat",
}  # fmt: skip
"""Settings that a resumed run may change: none changes what an update is; the last two change its rounding."""


def prepared(corpus: str | Path, out: str | Path, speech_columns: bool = False) -> Path:
    """The folder of arrays to train on: `corpus` if it is prepared, else OUT/prepared, made if need be.

    OUT/prepared/source.json keeps what it was made from. ValueError when that is another corpus, files that have
    changed since, or arrays made with the other `speech_columns`; and all errors of data/prepare.py.
    """
    corpus, folder = Path(corpus), Path(out) / "prepared"
    manifest, note = folder / "manifest.json", folder / "source.json"
    if (corpus / "manifest.json").exists():
        return corpus
    source = _source(corpus)
    if not manifest.exists():
        write_json(note, source)  # before the manifest: arrays without a source are never taken for finished
        preparation.prepare(corpus, folder, preparation.PrepareConfig(speech_columns=speech_columns))
    elif note.exists():
        before = json.loads(note.read_text(encoding="utf-8"))
        if before != source:
            raise ValueError(
                f"run '{out}' was started on corpus '{before['path']}', now '{source['path']}' is given (or its files "
                "changed); name the first one or another -o."
            )
        made = json.loads(manifest.read_text(encoding="utf-8"))["config"]["speech_columns"]
        if made != speech_columns:
            raise ValueError(
                f"run '{out}' prepared its corpus with speech_columns = {made}, now it is {speech_columns}: resume "
                "with the same settings, or choose another folder."
            )
    return folder


def prepared_once(corpus: str | Path, out: str | Path, speech_columns: bool = False) -> Path:
    """`prepared`, by the first process of a run while the others wait for it."""
    devices.first_does(lambda: prepared(corpus, out, speech_columns))
    return prepared(corpus, out, speech_columns)


def _source(corpus: Path) -> dict[str, Any]:
    """Where a corpus lies, and size (bytes) and time of change (ns) of each of its files."""
    files = {corpus / "info.csv", corpus / "corpus.csv"}
    for entry in corpora.find(corpus):
        files |= {entry.bvh, entry.wav, entry.wav.with_suffix(".csv")}
    stats = {path.relative_to(corpus).as_posix(): path.stat() for path in sorted(files) if path.exists()}
    return {
        "path": str(corpus.resolve()),
        "files": {name: [stat.st_size, stat.st_mtime_ns] for name, stat in stats.items()},
    }


def check_same(checkpoint_path: Path, given: dict[str, Any], out: Path) -> None:
    """ValueError naming the first setting in which the run's newest checkpoint differs from what is `given`."""
    started = checkpoint.metadata(checkpoint_path)
    before, now = _flat(started.get("training", {})), _flat(given["training"])
    usual = _flat(to_dict(TrainConfig()))  # what the versions did that lacked a setting
    before = usual | {"speech_columns": now["speech_columns"]} | before
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
