"""The release's folders: converted, loaded and exported bit for bit; missing or hostile files leave nothing behind."""

import json
import os
import re

import jax
import numpy as np
import pytest

from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs import release_files
from zeggs_jax.zeroeggs.checkpoints import load_model
from zeggs_jax.zeroeggs.torch_weights import NETWORKS, to_torch

NAMES = ("Hips", "Spine2", "Head", "LeftHand", "RightHand")
DEFINITION = {"dt": 0.02, "bone_names": NAMES, "parents": [-1, 0, 1, 1, 1], "label_names": ["Happy", "Old", "Sad"]}


@pytest.fixture(params=["attn", "label"])
def released(request, tmp_path, torch_file):
    """The two folders as the release lays them out, and the arrays in its networks."""
    labels = tuple(DEFINITION["label_names"]) if request.param == "label" else ()
    style = m.StyleEncoderConfig(request.param, hidden=12, size=4)
    speech = m.SpeechEncoderConfig(features=9, hidden=6, size=5, kernel=5)
    config = m.ZeroEggsConfig(len(NAMES), DEFINITION["dt"], labels, speech, style, m.DecoderConfig(16, 2))
    rng = np.random.default_rng(0)
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))
    arrays = to_torch(jax.tree.map(lambda a: rng.normal(size=a.shape).astype(np.float32), shapes), config)
    networks, processed = tmp_path / "networks", tmp_path / "processed"
    networks.mkdir()
    processed.mkdir()
    for name in NETWORKS:
        state = {key.removeprefix(f"{name}/"): a for key, a in arrays.items() if key.startswith(f"{name}/")}
        if state:
            (networks / f"{name}.pt").write_bytes(torch_file.network(state))
    sizes = {"audio_input": 9, "anim_input": config.vector_size + 3, "anim_output": config.vector_size}
    stats = {f"{key}_{part}": rng.uniform(0.5, 2.0, n) for key, n in sizes.items() for part in ("mean", "std")}
    np.savez(processed / "stats.npz", **stats)
    (processed / "data_definition.json").write_text(json.dumps(DEFINITION))
    (processed / "data_pipeline_conf.json").write_text("{}")
    return networks, processed, arrays, stats


def test_converted_loaded_and_exported_bit_for_bit(released, tmp_path):
    networks, processed, arrays, stats = released
    release_files.convert(networks, processed, tmp_path / "checkpoint")
    model = load_model(tmp_path / "checkpoint")
    assert model.skeleton.names == NAMES
    assert model.config.style.kind == ("attn" if (networks / "style_encoder.pt").exists() else "label")
    np.testing.assert_array_equal(model.scales.speech.std, stats["audio_input_std"].astype(np.float32))
    np.testing.assert_array_equal(model.scales.pose_out.mean, stats["anim_output_mean"].astype(np.float32))
    release_files.export(tmp_path / "checkpoint", tmp_path / "out.npz")
    with np.load(tmp_path / "out.npz") as exported:
        assert set(exported.files) == set(arrays)
        for name, array in arrays.items():
            assert exported[name].dtype == array.dtype
            assert exported[name].tobytes() == array.tobytes()


@pytest.mark.parametrize("file", ["decoder.pt", "speech_encoder.pt", "stats.npz", "data_definition.json"])
def test_a_missing_file_is_named_in_one_sentence(released, tmp_path, file):
    for folder in released[:2]:
        (folder / file).unlink(missing_ok=True)
    with pytest.raises(FileNotFoundError) as caught:
        release_files.convert(*released[:2], tmp_path / "checkpoint")
    assert re.fullmatch(rf"'[^\n]*{re.escape(file)}' [^\n]*\.", str(caught.value))
    assert not (tmp_path / "checkpoint").exists()


@pytest.mark.parametrize("file", ["stats.npz", "data_definition.json", "decoder.pt"])
def test_a_damaged_file_is_named(released, tmp_path, file):
    folder = next(folder for folder in released[:2] if (folder / file).exists())
    (folder / file).write_bytes(b"damaged")
    with pytest.raises(ValueError, match=re.escape(file)):
        release_files.convert(*released[:2], tmp_path / "checkpoint")
    assert not (tmp_path / "checkpoint").exists()


def test_a_hostile_decoder_is_refused_and_nothing_is_written(released, tmp_path, torch_file):
    """It would make a file if what it asks for were run."""
    call = torch_file.Call(torch_file.Global(os.system.__module__, "system"), (f"touch {tmp_path / 'run'}",))
    (released[0] / "decoder.pt").write_bytes(torch_file.archive(call))
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ValueError, match=r"decoder\.pt"):
        release_files.convert(*released[:2], tmp_path / "checkpoint")
    assert sorted(tmp_path.rglob("*")) == before
