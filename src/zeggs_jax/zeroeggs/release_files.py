"""The release's folders on disk, read for conversion, and our checkpoints written back as plain arrays."""

import io
import json
import os
import zipfile
from pathlib import Path

import numpy as np

from . import torch_weights
from .checkpoints import load_model, save_model


def convert(networks: Path, processed: Path, out: Path) -> None:
    """Turns `networks`/*.pt and `processed`/{stats.npz, *.json} into one checkpoint; executes nothing from the pickles.

    Without style_encoder.pt the model is steered by the labels of data_definition.json (the release's v2).

    Raises:
        ValueError, OSError: a file is missing, corrupt, or does not fit the others.
    """
    pickles = {name: networks / f"{name}.pt" for name in torch_weights.NETWORKS}
    blobs = {name: _bytes(path) for name, path in pickles.items() if name != "style_encoder" or path.exists()}
    stats = _arrays(processed / "stats.npz")
    definition = _json(processed / "data_definition.json")
    save_model(out, torch_weights.convert(blobs, stats, definition, _json(processed / "data_pipeline_conf.json")))


def export(checkpoint: Path, out: Path) -> None:
    """Writes a checkpoint's parameters as `<network>/<state_dict name>` arrays in one .npz."""
    model = load_model(checkpoint)
    temporary = out.with_name(f".{out.name}.part")
    with temporary.open("wb") as file:
        np.savez(file, **torch_weights.to_torch(model.params, model.config))  # pyright: ignore[reportArgumentType]
    os.replace(temporary, out)


def _bytes(path: Path) -> bytes:
    if not path.is_file():
        raise FileNotFoundError(f"'{path}' does not exist; the folder must hold the release's networks and statistics.")
    return path.read_bytes()


def _json(path: Path) -> dict:
    try:
        return json.loads(_bytes(path))
    except ValueError as error:
        raise ValueError(f"'{path}' is not valid JSON ({error}); take a fresh copy of it.") from error


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(io.BytesIO(_bytes(path)), allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
    except (ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"'{path}' is not a readable .npz of plain arrays; take a fresh copy of it.") from error
