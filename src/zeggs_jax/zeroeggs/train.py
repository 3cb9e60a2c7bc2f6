"""Training of ZeroEGGS (Sec. 4): speech, a style example and the first pose in, closed loop, Eq. 2 out.

RUN holds config.json, log.jsonl (every term of Eq. 2), valid.jsonl, tensorboard/, samples/step_*, and checkpoints:
step_* and best; `load_model(RUN)` reads the newest. The same call on the same folder goes on from there, with the
numbers of a run that was never stopped.
"""

import dataclasses
import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np
import optax
from jax.sharding import Mesh

from ..data import windows
from ..data.augment import mirror_of
from ..data.body import AS_IS
from ..data.prepared import Prepared, load
from ..data.scale import Scales
from ..nn import compiled
from ..speech.features import SpeechFeatureConfig
from ..training import checkpoint, devices, keep, loop
from ..training.optimiser import radam, stepped_rate
from ..training.plain import from_dict
from ..training.plain import to_dict as to_dict  # what `zeggs train --print-config` writes
from ..training.step import TrainState, begin, make_step
from .checkpoints import describe
from .encoders import ENCODERS
from .model import Model, Params, check_params, init
from .objective import Setting, loss_fn
from .run_folder import check_same, write_json
from .run_folder import prepared as prepared  # what `train` trains on, made if need be
from .run_folder import prepared_once as prepared_once
from .settings import TrainConfig
from .settings import read_config as read_config
from .validation import NOBODY, Observers, Sampler, Validation, can_validate


def train(
    folder: str | Path,
    out: str | Path,
    config: TrainConfig,
    progress: bool = True,
    observers: Observers = NOBODY,
    initial: Model | None = None,
) -> TrainState:
    """Train on the prepared corpus in `folder` (see `run_folder.prepared`), writing the run to folder `out`.

    Goes on where the run in `out` stopped, on any number of devices and processes; a new run begins with the parameters
    of `initial`, a model trained on the same arrays, or else with drawn ones.

    Raises:
        ValueError: the run was started with other settings, on another corpus, or has done more updates; the labels are
            not the corpus's styles; `initial` is of another config or corpus; the devices cannot share the batch; the
            loss is no longer finite or explodes.
        OSError: a file cannot be written.
        KeyboardInterrupt: after Ctrl-C, with all work saved.
    """
    compiled.keep()
    arrays, out = load(folder), Path(out)
    config, mesh = fit_config(config, arrays), devices.mesh()
    devices.check_batch(config.windows.batch, mesh, config.accumulate)
    windows.batch(arrays, config.seed, 0, config.windows, resident=config.resident)  # refuses what the corpus has not
    corpus = hashlib.sha256((Path(folder) / "manifest.json").read_bytes()).hexdigest()
    metadata = {**describe(config.model, arrays.skeleton), "training": to_dict(config), "corpus": corpus}
    devices.check_same(json.dumps(metadata, sort_keys=True).encode(), "corpus or settings")
    mirror = mirror_of(arrays.skeleton, arrays.across) if arrays.across else None
    setting, transform = Setting(config, arrays.scales, arrays.skeleton.parents, mirror), optimiser(config)
    params = None if initial is None else _params(initial, config, arrays)
    state = devices.replicate(_start(out, config, transform, arrays.scales, metadata, params), mesh)
    if devices.first():
        write_json(out / "config.json", to_dict(config))

    def batch(k: int) -> Any:
        made = windows.batch(arrays, config.seed, k, config.windows, share=devices.share(), resident=config.resident)
        return devices.split(made, mesh)

    packed = _on_device(arrays, mesh) if config.resident else None
    task = loop.Task(
        make_step(loss_fn(setting), transform, config.seed, config.accumulate, config.ema, packed),
        batch,
        lambda path, state: checkpoint.save(path, _tree(state, arrays.scales), metadata),
        _validation(arrays, setting, observers, progress),
        Sampler(arrays, setting, observers.show),
    )
    plan = loop.Plan(**{name: getattr(config, name) for name in loop.Plan._fields if name != "title"})
    return loop.fit(state, task, out, plan, progress)


def _on_device(arrays: Prepared, mesh: Mesh) -> windows.Piece:
    """The packed corpus on every device; ValueError where there is no room for it."""
    packed = windows.pack(arrays)
    try:
        return jax.block_until_ready(devices.replicate(packed, mesh))
    except jax.errors.JaxRuntimeError as error:
        size = sum(x.nbytes for x in packed) / 1e9
        raise ValueError(f"the corpus of {size:.1f} GB does not fit on the device: leave out resident.") from error


def optimiser(config: TrainConfig) -> optax.GradientTransformation:
    """The release's RAdam with its learning-rate steps; with `clip_norm` on gradients of that length at most."""
    steps = radam(stepped_rate(config.learning_rate, config.decay), eps=config.eps)
    return steps if config.clip_norm is None else optax.chain(optax.clip_by_global_norm(config.clip_norm), steps)


def fit_config(config: TrainConfig, corpus: Prepared) -> TrainConfig:
    """The config with the corpus's joints, frame time, speech features, way of reading bodies and parts of the body."""
    model = config.model
    if model.labels and model.labels != corpus.styles:
        raise ValueError(
            f"the config has labels {', '.join(model.labels)}; the corpus has styles {', '.join(corpus.styles)}: "
            "they must be the same, in this order."
        )
    speech = dataclasses.replace(model.speech, features=corpus.speech.shape[1])
    joints = len(corpus.skeleton)
    heard = from_dict(SpeechFeatureConfig, corpus.config.get("speech", {}), f"config of '{corpus.folder}'")
    style = model.style if model.labels else ENCODERS[model.style.kind].fit(model.style, corpus.skeleton)
    model = dataclasses.replace(
        model, joints=joints, frame_time=corpus.frame_time, features=heard, speech=speech, style=style,
        body=corpus.body or AS_IS,
    )  # fmt: skip
    return dataclasses.replace(config, model=model)


def _validation(arrays: Prepared, setting: Setting, observers: Observers, progress: bool) -> Validation | None:
    if setting.config.validate_every == 0:
        return None
    if can_validate(arrays, setting.config.windows):
        return Validation(arrays, setting, observers.judge)
    if progress and devices.first():
        frames = setting.config.windows.window
        print(f"no clip of the split 'valid' holds a window of {frames} frames: nothing is validated.", file=sys.stderr)
    return None


def _params(initial: Model, config: TrainConfig, arrays: Prepared) -> Params:
    """The parameters of a model that sees what this corpus's arrays show, as this config has them."""
    check_params(initial.params, config.model)
    same = jax.tree.map(lambda a, b: np.array_equal(a, b), initial.scales, arrays.scales)
    if not all(jax.tree.leaves(same)):
        raise ValueError(
            f"the initial model scales its inputs otherwise than '{arrays.folder}'; give one trained on these arrays."
        )
    return initial.params


def _start(
    out: Path,
    config: TrainConfig,
    transform: optax.GradientTransformation,
    scales: Scales,
    metadata: dict[str, Any],
    params: Params | None,
) -> TrainState:
    """The state of the run's newest checkpoint, or the first one of a new run."""

    def new() -> TrainState:
        drawn = init(jax.random.key(config.seed), config.model) if params is None else params
        return begin(drawn, transform, config.ema is not None)

    found = keep.checkpoints(out)
    if not found:
        return new()
    check_same(found[-1], metadata, out)
    tree, _ = checkpoint.load(found[-1], _tree(jax.eval_shape(new), scales))
    state = TrainState(*(tree[name] for name in TrainState._fields))
    if int(state.step) > config.steps:
        raise ValueError(
            f"run '{out}' has done {int(state.step)} updates, {config.steps} are asked for: ask for more, or choose "
            "another folder."
        )
    return state


def _tree(state: TrainState, scales: Scales) -> dict[str, Any]:
    return {**state._asdict(), "scales": scales._asdict()}
