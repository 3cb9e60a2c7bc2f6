"""A run's folder: what the result of each stage depends on, so that it goes on only with the same."""

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..training import checkpoint
from ..training.plain import to_dict
from .config import DiffuclipConfig
from .model import Model
from .stages.stage import Take

READS = {
    "codes": ("codes", "parts", "body", "frame_time"),
    "gestures": ("joint",),
    "joint": ("joint",),
    "prompts": ("prompts",),
    "denoiser": ("denoiser", "diffusion"),
    "video": ("prompts",),
}
"""The settings that a stage depends on, beside its own and those of the stages before it."""
FREE = ("log_every", "checkpoint_every")
LATER = {"prompts": ("grounded",)}
"""What only generation reads."""


def seen(
    read: Sequence[Take], initial: Model | None, config: DiffuclipConfig, only: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """For each stage of `only` all that decides its result: what it reads, its settings, the stages before it."""
    so_far: dict[str, Any] = {"motions": _motions(read, initial)}
    found = {}
    for name in READS:
        if name in only:
            so_far = so_far | {name: _settings(config, name)}
            found[name] = so_far
        if name == "codes":
            so_far = so_far | {"words": _words(read)}  # the codes do not read them
    return found


def _settings(config: DiffuclipConfig, name: str) -> dict[str, Any]:
    """What decides the result of a stage."""
    plain = to_dict(config)
    own = {key: value for key, value in plain[f"learn_{name}"].items() if key not in FREE}
    for room, keys in LATER.items():
        plain[room] = {key: value for key, value in plain[room].items() if key not in keys}
    return {"seed": config.seed, f"learn_{name}": own, **{key: plain[key] for key in READS[name]}}


def check_same(path: Path, seen: dict[str, Any], folder: Path) -> None:
    """ValueError naming the first thing in which a stage's checkpoint differs from what is asked for now."""
    before, now = _flat(checkpoint.metadata(path)), _flat(json.loads(json.dumps(seen)))
    for name in [*now, *before]:
        if before.get(name) != now.get(name):
            other = name in ("motions", "words")
            what = "on another corpus" if other else f"with {name} = {before.get(name)}, now {now.get(name)}"
            raise ValueError(
                f"'{folder}' was trained {what}: resume with the same corpus and settings, or choose another folder."
            )


def _flat(values: Any, prefix: str = "") -> dict[str, Any]:
    if not isinstance(values, dict):
        return {prefix.removesuffix("."): values}
    return {name: leaf for key, value in values.items() for name, leaf in _flat(value, f"{prefix}{key}.").items()}


def _motions(read: Sequence[Take], initial: Model | None) -> str:
    """A hash of the motions that are learnt from, and of the model that is gone on from."""
    sha = hashlib.sha256(b"" if initial is None else checkpoint.tree_digest(initial.params).encode())
    for take in read:
        sha.update(f"{take.name} {take.split}".encode())
        sha.update(take.motion.tobytes())
    return sha.hexdigest()


def _words(read: Sequence[Take]) -> str:
    """A hash of what was said, how it sounds, and how the motions are described."""
    sha = hashlib.sha256()
    for take in read:
        sha.update(repr((take.words, take.captions)).encode())
        sha.update(take.rhythm.tobytes())
    return sha.hexdigest()


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a JSON file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    os.replace(partial, path)
