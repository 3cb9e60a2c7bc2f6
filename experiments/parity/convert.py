"""Golden case `convert`: networks saved whole by the release, read without torch, bit for bit."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from zeggs_jax.zeroeggs import torch_pickle, torch_weights

from .golden import Row, read_arrays, read_case
from .left_out import leave_out

STAGE = "convert"


def check(golden: Path, reference: Path | None) -> Iterator[Row]:
    """Each network against its state_dict; all as our parameters and back; sizes; the published files."""
    folder = golden / STAGE
    sizes = read_case(folder)["sizes"]
    stored = read_arrays(folder / "state_dicts.npz")
    found = {}
    for network in torch_weights.NETWORKS:
        path = folder / f"{network}.pt"
        if path.exists():
            read = torch_pickle.read(path.read_bytes(), path.name)
            ours = {f"{network}/{name}": array for name, array in read.items()}
            expected = {name: array for name, array in stored.items() if name.startswith(f"{network}/")}
            yield Row(STAGE, f"{network}.pt", _different(ours, expected), 0.0)
            found |= ours
        else:
            leave_out(STAGE, path.name, "not in this set")
    if not found:
        raise ValueError(f"'{folder}' holds none of the networks that its case.json describes.")
    if {name.split("/")[0] for name in found} == set(torch_weights.NETWORKS):
        config = torch_weights.infer_config(found)
        back = torch_weights.to_torch(torch_weights.from_torch(found, config), config)
        yield Row(STAGE, "there and back", _different(back, stored), 0.0)
        speech = [config.speech.features, config.speech.hidden, config.speech.size]
        style = [config.vector_size + 3, config.style.hidden, config.style.size]
        decoder = [config.decoder.hidden, config.decoder.layers]
        expected = sizes["speech"] + sizes["style"] + [sizes["decoder_hidden"], sizes["layers"]]
        yield Row(STAGE, "sizes", float(speech + style + decoder != expected), 0.0)
    else:
        leave_out(STAGE, "there and back, sizes", "need all three networks")
    if reference is not None:
        yield from _published(reference)
    else:
        leave_out(STAGE, "published networks and statistics", "need --reference")


def _published(reference: Path) -> Iterator[Row]:
    """The release's own speech encoders and statistics."""
    for version in ("v1", "v2"):
        path = reference / version / "speech_encoder.pt"
        state = torch_pickle.read(path.read_bytes(), path.name)
        count = sum(array.size for array in state.values())
        yield Row(STAGE, f"{version}/speech_encoder.pt, parameters", abs(count - 136448), 0.0)
        stats = read_arrays(reference / version / "stats.npz")
        scales = torch_weights.read_scales(stats, torch_weights.ZeroEggsConfig())
        for key, ours in zip(("audio_input", "anim_input", "anim_output"), scales, strict=True):
            errors = [np.abs(a - stats[f"{key}_{part}"].astype(np.float32)).max() for part, a in ours._asdict().items()]
            yield Row(STAGE, f"{version}/stats.npz, {key}", float(max(errors)), 0.0)


def _different(ours: dict[str, np.ndarray], expected: dict[str, np.ndarray]) -> float:
    """How many arrays are missing, unexpected or not the same bits."""
    same = [
        name in ours and ours[name].dtype == array.dtype and np.array_equal(ours[name], array)
        for name, array in expected.items()
    ]
    return float(same.count(False) + len(set(ours) - set(expected)))
