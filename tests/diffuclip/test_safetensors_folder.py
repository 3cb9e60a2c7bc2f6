"""Weights in safetensors: the reference package's files, shards, half precision; broken folders told in a sentence."""

import json

import jax
import numpy as np
import pytest

from zeggs_jax.diffuclip import safetensors_folder as folder

KINDS = {np.dtype("f4"): "F32", np.dtype("f2"): "F16", np.dtype("f8"): "F64", np.dtype("i8"): "I64"}


def write(path, arrays, kinds=None):
    """A safetensors file by the published format."""
    header, at, raw = {"__metadata__": {"format": "pt"}}, 0, b""
    for name, array in arrays.items():
        kind = (kinds or {}).get(name, KINDS.get(array.dtype, "BF16"))
        raw += array.tobytes()
        header[name] = {"dtype": kind, "shape": list(array.shape), "data_offsets": [at, len(raw)]}
        at = len(raw)
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + raw)


@pytest.fixture
def arrays():
    draw = np.random.default_rng(0)
    return {"a.weight": draw.normal(size=(3, 4)).astype("f4"), "b.bias": draw.normal(size=5).astype("f4")}


def name_of(path):
    return ".".join(path)


LIKE = {
    "a": {"weight": jax.ShapeDtypeStruct((3, 4), np.float32)},
    "b": {"bias": jax.ShapeDtypeStruct((5,), np.float32)},
}


def test_leaves_come_by_name(tmp_path, arrays):
    write(tmp_path / "model.safetensors", arrays)
    found = folder.load(tmp_path, LIKE, name_of)
    np.testing.assert_array_equal(found["a"]["weight"], arrays["a.weight"])
    np.testing.assert_array_equal(found["b"]["bias"], arrays["b.bias"])


def test_files_of_the_package_are_read(tmp_path, arrays):
    numpy_files = pytest.importorskip("safetensors.numpy")
    numpy_files.save_file(arrays, tmp_path / "model.safetensors")
    found = folder.load(tmp_path, LIKE, name_of)
    np.testing.assert_array_equal(found["a"]["weight"], arrays["a.weight"])


def test_shards_are_joined_and_a_missing_one_is_named(tmp_path, arrays):
    for k, (name, array) in enumerate(arrays.items()):
        write(tmp_path / f"model-{k}.safetensors", {name: array})
    index = {"weight_map": {name: f"model-{k}.safetensors" for k, name in enumerate(arrays)}}
    (tmp_path / "model.safetensors.index.json").write_text(json.dumps(index))
    found = folder.load(tmp_path, LIKE, name_of)
    np.testing.assert_array_equal(found["b"]["bias"], arrays["b.bias"])
    (tmp_path / "model-1.safetensors").unlink()
    with pytest.raises(FileNotFoundError, match=r"model-1\.safetensors' is missing"):
        folder.places(tmp_path)


@pytest.mark.parametrize(("kind", "bits"), [("F16", "f2"), ("BF16", "u2"), ("F64", "f8")])
def test_other_precisions_become_float32(tmp_path, kind, bits):
    values = np.array([1.0, -2.5, 0.15625], np.float32)  # exact in 8 bits of mantissa
    stored = (values.view(np.uint32) >> 16).astype(bits) if kind == "BF16" else values.astype(bits)
    write(tmp_path / "model.safetensors", {"x": stored}, {"x": kind})
    found = folder.read(folder.places(tmp_path)["x"])
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, values)


def test_integers_are_refused(tmp_path):
    write(tmp_path / "model.safetensors", {"x": np.arange(3)})
    with pytest.raises(ValueError, match="of type I64"):
        folder.read(folder.places(tmp_path)["x"])


def test_what_does_not_fit_is_named(tmp_path, arrays):
    write(tmp_path / "model.safetensors", arrays)
    with pytest.raises(ValueError, match=r"no tensor 'c\.bias'"):
        folder.load(tmp_path, {"c": {"bias": LIKE["b"]["bias"]}}, name_of)
    with pytest.raises(ValueError, match=r"'a\.weight' in .* is of shape \(3, 4\), expected \(5,\)"):
        folder.load(tmp_path, {"a": {"weight": LIKE["b"]["bias"]}}, name_of)


def test_folders_that_hold_no_such_model(tmp_path, arrays):
    with pytest.raises(FileNotFoundError, match=r"no config\.json"):
        folder.config(tmp_path, "t5")
    with pytest.raises(FileNotFoundError, match=r"neither model\.safetensors nor"):
        folder.places(tmp_path)
    (tmp_path / "config.json").write_text('{"model_type": "gpt2"}')
    with pytest.raises(ValueError, match="a model of type 'gpt2', expected 't5'"):
        folder.config(tmp_path, "t5")
    assert folder.config(tmp_path, "gpt2") == {"model_type": "gpt2"}
    (tmp_path / "config.json").write_text("[1]")
    with pytest.raises(ValueError, match="damaged"):
        folder.config(tmp_path)


@pytest.mark.parametrize("cut", [4, 30, -1])
def test_files_cut_off_are_told(tmp_path, arrays, cut):
    path = tmp_path / "model.safetensors"
    write(path, arrays)
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(ValueError, match=r"model\.safetensors' is damaged or of another format"):
        folder.places(tmp_path)
