"""A feature net as the arrays of its file, with seed, hash of the data and hash of the weights, and back."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from .feature_net import FeatureNet, FeatureNetConfig

FORMAT = 1


def pack(net: FeatureNet) -> dict[str, np.ndarray]:
    """The arrays of the net's file: `numpy.savez(path, **pack(net))`."""
    header = {
        "format": FORMAT,
        "config": asdict(net.config),
        "joints": net.joints,
        "spread": net.spread,
        "data_hash": net.data_hash,
        "error": net.error,
        "fingerprint": net.fingerprint,
    }
    leaves = {f"params/{path}": np.asarray(leaf) for path, leaf in _flat(net.params).items()}
    return {"header": np.array(json.dumps(header)), "mean": net.mean, **leaves}


def unpack(arrays: Mapping[str, np.ndarray]) -> FeatureNet:
    """The net from the arrays of its file.

    Raises:
        ValueError: not such a file, of another format, or weights that are not those it was written with.
    """
    if "header" not in arrays or "mean" not in arrays:
        raise ValueError(
            "these arrays are no feature net: 'header' or 'mean' is missing; train one with feature_net.train."
        )
    header = json.loads(str(arrays["header"]))
    if header.get("format") != FORMAT:
        raise ValueError(
            f"the feature net is of format {header.get('format')}, this version reads {FORMAT}; train it anew."
        )
    params: dict[str, Any] = {}
    for path in sorted(name for name in arrays if name.startswith("params/")):
        *folders, leaf = path.split("/")[1:]
        place = params
        for folder in folders:
            place = place.setdefault(folder, {})
        place[leaf] = np.asarray(arrays[path])
    net = FeatureNet(
        FeatureNetConfig(**header["config"]),
        tuple(header["joints"]),
        np.asarray(arrays["mean"]),
        float(header["spread"]),
        params,
        header["data_hash"],
        float(header["error"]),
    )
    if net.fingerprint != header["fingerprint"]:
        raise ValueError("the feature net's weights are not those that it was written with; take an unchanged file.")
    return net


def _flat(tree: Any, path: str = "") -> dict[str, np.ndarray]:
    if not isinstance(tree, Mapping):
        return {path: np.asarray(tree)}
    return {name: leaf for key, item in tree.items() for name, leaf in _flat(item, f"{path}/{key}".lstrip("/")).items()}
