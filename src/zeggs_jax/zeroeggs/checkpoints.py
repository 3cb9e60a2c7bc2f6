"""A Model on disk: parameters and scales as arrays, config and skeleton as metadata of one checkpoint."""

import hashlib
import json
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..data.prepared import skeleton_from_json, skeleton_to_json
from ..data.scale import Scale, Scales
from ..motion.skeleton import Skeleton
from ..training import checkpoint, keep
from ..training.plain import from_dict, to_dict
from .config import ZeroEggsConfig
from .model import Model, Params, check_params


def save_model(path: str | Path, model: Model, dtype: str = "float32") -> str:
    """Write a model to folder `path` and return its digest; dtype 'float16' halves the size of the parameters."""
    params = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), model.params)
    tree = {"params": params, "scales": model.scales._asdict()}
    return checkpoint.save(path, tree, describe(model.config, model.skeleton))


def load_model(path: str | Path) -> Model:
    """The model in folder `path`: one that `save_model` wrote, a checkpoint of a training run, or a whole run.

    Of a run, the newest checkpoint is taken (RUN/checkpoints/best is the one with the lowest validation loss), and of
    a checkpoint the averaged parameters, where training kept them. They are float32 numpy arrays. FileNotFoundError:
    nothing there; ValueError: damaged, not a model, or parameters that do not fit the stored config.
    """
    path = newest(path)
    tree, metadata = checkpoint.load(path)
    try:
        config = from_dict(ZeroEggsConfig, metadata["model"], f"config of checkpoint '{path}'")
        scales = Scales(**{name: Scale(**part) for name, part in tree["scales"].items()})
        skeleton = skeleton_from_json(metadata["skeleton"])
        params: Params = tree.get("average", tree["params"])
    except (KeyError, TypeError) as error:
        raise ValueError(f"checkpoint '{path}' is not a ZeroEGGS model: {error} is missing.") from error
    params = jax.tree.map(lambda leaf: np.asarray(leaf, np.float32), params)
    try:
        check_params(params, config)
    except ValueError as error:
        raise ValueError(f"checkpoint '{path}' is of another config: {error}") from error
    return Model(config, params, scales, skeleton)


def digest(model: Model) -> str:
    """SHA-256 (hex) of all that a model is: parameters, scales, config and skeleton; the same wherever it lies."""
    arrays = checkpoint.tree_digest({"params": model.params, "scales": model.scales._asdict()})
    described = json.dumps(describe(model.config, model.skeleton), sort_keys=True)
    return hashlib.sha256((arrays + described).encode()).hexdigest()


def newest(path: str | Path) -> Path:
    """`path` itself, or the newest checkpoint of the training run there."""
    path = Path(path)
    if (path / "checkpoints").is_dir() and not checkpoint.is_checkpoint(path):
        found = keep.checkpoints(path)
        if not found:
            raise ValueError(f"run '{path}' has no finished checkpoint yet: let it train longer.")
        return found[-1]
    return path


def describe(config: ZeroEggsConfig, skeleton: Skeleton) -> dict[str, Any]:
    """The metadata of a model's checkpoint; a setting that came late is in it only where it is used.

    So a model's digest stays what it was, and libraries made before are still this model's.
    """
    model = to_dict(config)
    if config.speech.lookahead is None:
        del model["speech"]["lookahead"]
    return {"model": model, "skeleton": skeleton_to_json(skeleton)}
