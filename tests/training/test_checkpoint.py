"""Checkpoints come back as they went, whole or not at all, and no damage goes unseen."""

import shutil
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.training import checkpoint


class State(NamedTuple):
    step: Any
    params: Any


def make_tree(seed: int = 0) -> State:
    normal = jax.random.normal(jax.random.key(seed), (20, 30))
    half = np.arange(6, dtype=np.float16).reshape(2, 3)
    return State(jnp.int32(7), {"dense": {"weight": normal, "bias": np.ones(3, np.float32)}, "list": [half, half + 1]})


METADATA = {"config": {"hidden": 256, "name": "ü"}, "numbers": [1.5, 2]}


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    checkpoint.save(tmp_path / "model", make_tree(), METADATA)
    return tmp_path / "model"


def assert_same(a, b):
    jax.tree.map(np.testing.assert_array_equal, a, b)
    assert [x.dtype for x in jax.tree.leaves(a)] == [x.dtype for x in jax.tree.leaves(b)]


def test_a_template_gives_its_structure_back(saved):
    tree, metadata = checkpoint.load(saved, make_tree(1))
    assert isinstance(tree, State)
    assert_same(tree, make_tree())
    assert metadata == METADATA


def test_without_a_template_it_is_nested_dicts(saved):
    tree, _ = checkpoint.load(saved)
    assert_same(tree["params"]["dense"], make_tree().params["dense"])
    assert tree["params"]["list"]["1"].dtype == np.float16
    assert int(tree["step"]) == 7


def test_floating_leaves_take_the_dtype_of_the_template(saved):
    wide = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, jnp.result_type(x.dtype, jnp.float16)), make_tree())
    wide.params["list"][0] = jax.ShapeDtypeStruct((2, 3), jnp.float32)
    tree, _ = checkpoint.load(saved, wide)
    assert tree.params["list"][0].dtype == np.float32
    assert tree.step.dtype == np.int32


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p["dense"].update(scale=np.ones(2)), "has no array 'params/dense/scale'"),
        (lambda p: p["dense"].update(bias=np.ones(4)), r"'params/dense/bias' in shape \(3,\), expected \(4,\)"),
        (lambda p: p.pop("list"), "has array 'params/list/0', which"),
    ],
)
def test_the_first_leaf_that_does_not_fit_is_named(saved, change, message):
    template = make_tree()
    change(template.params)
    with pytest.raises(ValueError, match=message):
        checkpoint.load(saved, template)


def files_of(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_every_damaged_byte_is_seen(saved):
    """A bit flipped at several places of every file, the file cut off, the file gone."""
    random, files = np.random.default_rng(0), files_of(saved)
    assert len(files) > 4
    for path in files:
        whole = path.read_bytes()
        for at in {0, len(whole) - 1, *random.integers(len(whole), size=4).tolist()}:
            path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << random.integers(8)]) + whole[at + 1 :])
            with pytest.raises(ValueError, match="damaged"):
                checkpoint.load(saved)
        for cut in (0, len(whole) // 2):
            path.write_bytes(whole[:cut])
            with pytest.raises(ValueError, match="damaged"):
                checkpoint.load(saved)
        path.unlink()
        with pytest.raises(ValueError, match=r"damaged|not a checkpoint"):
            checkpoint.load(saved)
        path.write_bytes(whole)
    assert_same(checkpoint.load(saved, make_tree())[0], make_tree())


def test_what_is_no_checkpoint(tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        checkpoint.load(tmp_path / "nothing")
    (tmp_path / "file").write_text("hello")
    for path in (tmp_path, tmp_path / "file"):
        with pytest.raises(ValueError, match="is not a checkpoint"):
            checkpoint.load(path)


def test_another_format_is_refused(saved, monkeypatch):
    monkeypatch.setattr(checkpoint, "FORMAT", checkpoint.FORMAT + 1)
    with pytest.raises(ValueError, match="has format 1, this version reads 2"):
        checkpoint.load(saved)


def test_the_digest_is_of_the_content(saved, tmp_path):
    shutil.copytree(saved, tmp_path / "copy")
    again = checkpoint.save(tmp_path / "again", make_tree(), METADATA)
    assert checkpoint.digest(saved) == checkpoint.digest(tmp_path / "copy") == again
    other = make_tree()
    other.params["dense"]["bias"] = np.array([1, 1, np.nextafter(np.float32(1), np.float32(2))])
    assert checkpoint.save(tmp_path / "other", other, METADATA) != again
    assert checkpoint.save(tmp_path / "third", make_tree(), METADATA | {"numbers": [1.5, 3]}) != again
    assert checkpoint.tree_digest(other) != checkpoint.tree_digest(make_tree()) == checkpoint.tree_digest(make_tree())


def test_metadata_is_read_without_arrays(saved):
    shutil.rmtree(saved / checkpoint.ARRAYS)
    assert checkpoint.metadata(saved) == METADATA


def test_saving_again_replaces(saved):
    checkpoint.save(saved, make_tree(1), {})
    assert_same(checkpoint.load(saved, make_tree())[0], make_tree(1))
    assert [path.name for path in saved.parent.iterdir()] == ["model"]


def test_a_save_that_fails_leaves_the_old_one(saved):
    with pytest.raises(TypeError):
        checkpoint.save(saved, make_tree(1), {"not JSON": object()})
    assert_same(checkpoint.load(saved, make_tree())[0], make_tree())
    assert [path.name for path in saved.parent.iterdir()] == ["model"]


def test_other_peoples_folders_are_not_replaced(tmp_path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter").write_text("1")
    with pytest.raises(ValueError, match="exists and is not a checkpoint"):
        checkpoint.save(tmp_path / "thesis", make_tree(), {})
    assert (tmp_path / "thesis" / "chapter").read_text() == "1"


def test_empty_arrays_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"array 'a' of shape \(0, 3\): it is empty"):
        checkpoint.save(tmp_path / "model", {"a": np.zeros((0, 3))}, {})


def test_arrays_are_the_same_read_with_orbax_and_without(tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    tree = {"a": {"w": rng.normal(size=(70, 300)).astype(np.float32), "n": np.int32(7)}, "h": np.ones(3, np.float16)}
    checkpoint.save(tmp_path / "c", tree, {})
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "_orbax", None)
        alone, _ = checkpoint.load(tmp_path / "c")
    monkeypatch.setattr(checkpoint, "_by_tensorstore", lambda folder, leaves: None)
    orbax, _ = checkpoint.load(tmp_path / "c")
    for found in (alone, orbax):
        jax.tree.map(np.testing.assert_array_equal, found, tree)
        assert [leaf.dtype for leaf in jax.tree.leaves(found)] == [leaf.dtype for leaf in jax.tree.leaves(tree)]
