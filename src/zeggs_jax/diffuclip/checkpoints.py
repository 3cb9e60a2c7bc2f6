"""A GestureDiffuCLIP model on disk: one checkpoint of parameters and scales, with config and skeleton beside them."""

import hashlib
import json
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..data.prepared import skeleton_from_json, skeleton_to_json
from ..data.scale import Scale
from ..training import checkpoint
from ..training.plain import from_dict, to_dict
from .config import DiffuclipConfig
from .model import Model

MODEL = "model"  # of a run's folder


def save_model(path: str | Path, model: Model, dtype: str = "float32") -> str:
    """Write a model to folder `path` and return its digest; dtype 'float16' halves the size of the parameters."""

    def stored(leaf: Any) -> np.ndarray:
        leaf = np.asarray(leaf)
        return leaf.astype(dtype) if leaf.dtype == np.float32 else leaf

    tree = {
        "params": jax.tree.map(stored, model.params),
        "motion_scale": model.motion_scale._asdict(),
        "latent_scale": model.latent_scale._asdict(),
    }
    return checkpoint.save(path, tree, _describe(model))


def load_model(path: str | Path) -> Model:
    """The model in folder `path`: one that `save_model` wrote, or a run of `zeggs diffuclip train` that is finished.

    FileNotFoundError: nothing there; ValueError: not a GestureDiffuCLIP model, unfinished, or damaged.
    """
    path = Path(path)
    if not checkpoint.is_checkpoint(path):
        if not checkpoint.is_checkpoint(path / MODEL):
            what = "is a run that is not finished" if (path / "config.json").exists() else "holds no model"
            raise FileNotFoundError(f"'{path}' {what}; give the folder of a finished 'zeggs diffuclip train'.")
        path = path / MODEL
    tree, metadata = checkpoint.load(path)
    try:
        config = from_dict(DiffuclipConfig, metadata["diffuclip"], f"config of checkpoint '{path}'")
        motion_scale, latent_scale = (Scale(**tree[name]) for name in ("motion_scale", "latent_scale"))
        params, skeleton = tree["params"], skeleton_from_json(metadata["skeleton"])
    except (KeyError, TypeError) as error:
        raise ValueError(f"checkpoint '{path}' is not a GestureDiffuCLIP model: {error} is missing.") from error
    params = jax.tree.map(lambda leaf: leaf.astype(np.float32) if leaf.dtype == np.float16 else leaf, params)
    return Model(config, params, motion_scale, latent_scale, skeleton)


def digest(model: Model) -> str:
    """SHA-256 (hex) of all that a model is; the same wherever it lies."""
    arrays = checkpoint.tree_digest((model.params, model.motion_scale, model.latent_scale))
    return hashlib.sha256((arrays + json.dumps(_describe(model), sort_keys=True)).encode()).hexdigest()


def _describe(model: Model) -> dict[str, Any]:
    return {"diffuclip": to_dict(model.config), "skeleton": skeleton_to_json(model.skeleton)}
