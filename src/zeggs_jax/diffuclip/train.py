"""Training in stages: codes, gestures, joint, prompts, denoiser, video; one command, each stage resumable.

RUN holds config.json, takes/ (what the corpus was read to), a folder for each stage (log.jsonl, tensorboard/,
checkpoints/), and at the end model/. The same call on the same folder goes on where it was stopped.
"""

import dataclasses
import json
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax

from ..motion.skeleton import Skeleton
from ..nn import compiled
from ..training import checkpoint, keep, loop
from ..training.plain import from_dict, to_dict
from ..training.step import TrainState
from . import representation, run_folder, takes
from .checkpoints import MODEL, save_model
from .config import DiffuclipConfig, StageConfig
from .model import Model, Params, encode_takes
from .stages import codes, denoiser, gestures, joint, prompts, video
from .stages.stage import Make, Material, Stage

STAGES: dict[str, tuple[str, Make]] = {
    "codes": ("codes", codes.stage),
    "gestures": ("joint", gestures.stage),
    "joint": ("joint", joint.stage),
    "prompts": ("prompts", prompts.stage),
    "denoiser": ("denoiser", denoiser.stage),
    "video": ("prompts", video.stage),
}
"""Each stage's name, the component that it trains (a later one replaces it), and how it is made."""


def read_config(path: str | Path) -> DiffuclipConfig:
    """Settings from a JSON file, strictly; what it leaves out is the paper's. ValueError, OSError: one sentence."""
    path = Path(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"settings '{path}' are not JSON ({error}); start from --print-config.") from error
    return from_dict(DiffuclipConfig, data, f"settings '{path}'")


def train(
    corpus: str | Path,
    out: str | Path,
    config: DiffuclipConfig,
    progress: bool = True,
    initial: Model | None = None,
    only: Sequence[str] = tuple(STAGES),
) -> Model:
    """Train all stages on a corpus folder (see `takes.gather`), writing to folder `out`, and return the model.

    With `initial`, the components of a finished model of the same skeleton are taken over and the stages in `only` are
    trained again (an ablation trains the denoiser alone).

    Raises:
        ValueError: the run was started with other settings or another corpus; a corpus that does not fit; a loss that
            is no longer finite; `only` without a stage that the model needs.
        OSError: a file cannot be read or written.
        KeyboardInterrupt: after Ctrl-C, with all work saved.
    """
    compiled.keep()
    out = Path(out)
    read, skeleton, body = takes.gather(corpus, out, config)
    config = dataclasses.replace(config, joints=len(skeleton), body=body)
    _check_stages(only, initial, config, skeleton)
    seen = run_folder.seen(read, initial, config, only)
    for name in only:
        if found := keep.checkpoints(out / name):
            run_folder.check_same(found[-1], seen[name], out / name)
    run_folder.write_json(out / "config.json", to_dict(config))
    with loop.stop_requested() as stop:  # also while nothing is updated: what raises in a compiler may be lost there
        model = _train(read, skeleton, out, config, seen, stop, progress, initial)
    save_model(out / MODEL, model)
    return model


def _train(
    read: Sequence[takes.Take],
    skeleton: Skeleton,
    out: Path,
    config: DiffuclipConfig,
    seen: dict[str, dict[str, Any]],
    stop: threading.Event,
    progress: bool,
    initial: Model | None,
) -> Model:
    """The stages that `seen` names, one after the other; the other components are those of `initial`."""
    motion_scale = representation.scale([take.motion for take in read if take.split == "train"], skeleton)
    params: dict[str, Params] = {}
    material = Material(read, motion_scale, skeleton)
    if initial is not None:
        params, material = dict(initial.params), material._replace(motion_scale=initial.motion_scale)
    for number, name in enumerate(STAGES):
        component, make = STAGES[name]
        if name in seen:
            stage = make(config, material, params)
            _heed(stop, name)
            title = f"{number + 1}/{len(STAGES)} {name}"
            params[component] = _run(stage, name, title, out / name, config, seen[name], progress)
            _heed(stop, name)
        if name == "codes":
            if progress:
                print("encoding the corpus", file=sys.stderr)
            z_scale, encoded = encode_takes(params["codes"], config, material.motion_scale, read)
            z_scale = z_scale if initial is None else initial.latent_scale
            material = material._replace(encoded=encoded, latent_scale=z_scale)
    assert material.latent_scale is not None
    return Model(config, params, material.motion_scale, material.latent_scale, skeleton)


def _heed(stop: threading.Event, name: str) -> None:
    if stop.is_set():
        raise KeyboardInterrupt(f"stopped at stage '{name}'; resume with the same command")


def _run(
    stage: Stage, name: str, title: str, folder: Path, config: DiffuclipConfig, seen: dict[str, Any], progress: bool
) -> Params:
    """Train one stage from where it is, and what the model keeps of it."""
    settings: StageConfig = getattr(config, f"learn_{name}")
    key = jax.random.fold_in(jax.random.key(config.seed), list(STAGES).index(name))
    found = keep.checkpoints(folder)
    if found:
        tree, _ = checkpoint.load(found[-1], jax.eval_shape(stage.begin, key)._asdict())
        state = TrainState(**tree)
    else:
        state = stage.begin(key)
    if int(state.step) < settings.steps:
        task = loop.Task(
            stage.step,
            stage.batch,
            lambda path, state: checkpoint.save(path, state._asdict(), seen),
            stage.validate,
        )
        plan = loop.Plan(
            settings.steps,
            settings.log_every,
            settings.checkpoint_every,
            keep=1,
            validate_every=settings.checkpoint_every,
            keep_best=False,
            title=title,
        )
        state = loop.fit(state, task, folder, plan, progress)
    return stage.finish(state)


def _check_stages(only: Sequence[str], initial: Model | None, config: DiffuclipConfig, skeleton: Skeleton) -> None:
    for name in only:
        if name not in STAGES:
            raise ValueError(f"'{name}' is no stage; choose of {', '.join(STAGES)}.")
    if initial is None and set(only) != set(STAGES):
        missing = next(name for name in STAGES if name not in only)
        raise ValueError(f"stage '{missing}' is left out but no model is given to take its part from; train them all.")
    if initial is not None and initial.skeleton.names != skeleton.names:
        raise ValueError(
            f"the initial model has another skeleton ({len(initial.skeleton)} joints) than the corpus ({len(skeleton)} "
            "joints); give a model that was trained on this body."
        )
