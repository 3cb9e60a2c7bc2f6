"""PyTorch's files read without PyTorch: what is in them comes out, and nothing that they ask for is run."""

import contextlib
import os
import re
import struct
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from zeggs_jax.zeroeggs import torch_pickle

A, B = np.arange(6, dtype=np.float32).reshape(2, 3), np.array([0.5, -2.0], np.float32)


@pytest.fixture(scope="session")
def good(torch_file) -> bytes:
    return torch_file.network({"layer0.weight": A, "layer0.bias": B, "layer1.deep.weight": A.T.copy()})


def refused(file: bytes, says: str = "bad.pt") -> None:
    """Reading gives one sentence that names the file."""
    with pytest.raises(ValueError, match=says) as caught:
        torch_pickle.read(file, "bad.pt")
    assert re.fullmatch(r"'bad\.pt' .*\.", str(caught.value))


def test_what_is_in_comes_out(good):
    state = torch_pickle.read(good)
    assert list(state) == ["layer0.weight", "layer0.bias", "layer1.deep.weight"]
    np.testing.assert_array_equal(state["layer0.weight"], A)
    np.testing.assert_array_equal(state["layer1.deep.weight"], A.T)
    assert all(array.dtype == np.float32 and array.flags.writeable for array in state.values())


def test_strides_and_offsets(torch_file):
    parameters = {
        "transposed": torch_file.tensor(0, (3, 2), (1, 3), count=6),
        "part": torch_file.tensor(0, (2,), (3,), offset=1, count=6),
        "number": torch_file.tensor(0, (), (), offset=5, count=6),
        "none": torch_file.tensor(0, (0, 3), (3, 1), count=6),
    }
    state = torch_pickle.read(torch_file.archive(torch_file.module(parameters), [A]))
    np.testing.assert_array_equal(state["transposed"], A.T)
    np.testing.assert_array_equal(state["part"], [1, 4])
    assert state["number"] == 5
    assert state["none"].shape == (0, 3)


def test_a_saved_state_dict_and_an_open_file(torch_file, tmp_path):
    path = tmp_path / "state.pt"
    path.write_bytes(torch_file.archive({"weight": torch_file.tensor(0, (2, 3))}, [A]))
    with path.open("rb") as file:
        np.testing.assert_array_equal(torch_pickle.read(file)["weight"], A)


def test_buffers_count_unless_they_are_not_persistent(torch_file):
    one, two = torch_file.tensor(0, (2, 3)), torch_file.tensor(0, (2, 3))
    kept = torch_file.Call(torch_file.Global("__builtin__", "set"), (["two"],))
    module = torch_file.module(_buffers={"one": one, "two": two}, _non_persistent_buffers_set=kept)
    assert list(torch_pickle.read(torch_file.archive(module, [A]))) == ["one"]


FORBIDDEN = [
    ("os", "system"),
    ("posix", "system"),
    ("nt", "system"),
    ("subprocess", "Popen"),
    ("builtins", "eval"),
    ("__builtin__", "eval"),
    ("builtins", "exec"),
    ("builtins", "getattr"),
    ("builtins", "__import__"),
    ("copyreg", "_reconstructor"),
    ("copy_reg", "_reconstructor"),
    ("functools", "partial"),
    ("operator", "attrgetter"),
    ("pickle", "loads"),
    ("numpy", "load"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("torch", "load"),
    ("torch.hub", "load"),
    ("torch._utils", "_rebuild_tensor_v2.__globals__"),
    ("torch.nn.modules", "os"),
    ("torch.nn.modules.module", "torch.os.system"),
    ("modules", "os.system"),
    ("modules.os", "system"),
    ("collections", "OrderedDict.__init__.__globals__"),
    ("zeggs_jax.zeroeggs.torch_pickle", "io"),
]


@pytest.mark.parametrize(("module", "name"), FORBIDDEN)
def test_every_other_name_is_refused(torch_file, tmp_path, module, name):
    flag = tmp_path / "flag"
    call = torch_file.Call(torch_file.Global(module, name), (f"touch {flag}",))
    refused(torch_file.archive(call), "was refused: it asks for")
    nested = torch_file.module({"weight": torch_file.tensor(0, (2, 3))}, hooks={"deep": [call]})
    refused(torch_file.archive(nested, [A]), "was refused: it asks for")
    stacked = b"\x80\x04" + torch_file.pickled(module) + torch_file.pickled(name) + b"\x93(X\x01\x00\x00\x00atR."
    refused(torch_file.archive(stacked), "was refused: it asks for")
    assert not flag.exists()


@pytest.mark.parametrize(
    "pickle",
    [
        b"\x80\x02ios\nsystem\n.",
        b"\x80\x02(cos\nsystem\no.",
        b"\x80\x02\x82\x01.",
        b"\x80\x04\x83\x00\x00.",
        b"P0\n.",
    ],
    ids=["INST", "OBJ", "EXT1", "EXT2", "PERSID"],
)
def test_opcodes_that_no_network_needs_are_refused(torch_file, pickle):
    refused(torch_file.archive(pickle))


def test_a_call_of_a_network_class_does_nothing(torch_file):
    refused(
        torch_file.archive(torch_file.Call(torch_file.Global("modules", "Decoder"), ("rm",))),
        "holds no network|not a",
    )


@pytest.mark.parametrize(
    ("shape", "strides", "offset"),
    [
        ((100, 3), (3, 1), 0),
        ((2, 3), (3, 1), 5),
        ((2, 3), (-3, 1), 3),
        ((2, 3), (3, 1), -1),
        ((1 << 30, 1 << 30), (0, 0), 0),
        ((1 << 30,), (0,), 0),
        ((2, 3), (3,), 0),
        (("2", 3), (3, 1), 0),
        ((True, 3), (3, 1), 0),
    ],
)
def test_tensors_stay_inside_their_storage(torch_file, shape, strides, offset):
    tensor = torch_file.tensor(0, shape, strides, offset, count=6)
    refused(torch_file.archive(torch_file.module({"w": tensor}), [A]))


def test_a_tensor_of_something_else(torch_file):
    rebuild = torch_file.Global("torch._utils", "_rebuild_tensor_v2")
    for storage in ("text", torch_file.Global("torch", "FloatStorage"), [1.0 and 1]):
        call = torch_file.Call(rebuild, (storage, 0, (1,), (1,), False, None))
        refused(torch_file.archive(torch_file.module({"w": call})))
    refused(torch_file.archive(torch_file.module({"w": 3})), "not a tensor")


def test_storages_must_be_what_they_claim(torch_file):
    wrong = [
        torch_file.tensor(0, (2, 3), count=7),
        torch_file.tensor(3, (2, 3)),
        torch_file.tensor("../data.pkl", (2, 3)),
        torch_file.tensor(0, (2, 3), kind="ShortStorage"),
    ]
    for tensor in wrong:
        refused(torch_file.archive(torch_file.module({"w": tensor}), [A]))
    module = torch_file.module({"w": torch_file.tensor(0, (2, 3))})
    refused(torch_file.archive(module, [A], byteorder=b"big"), "little-endian")
    refused(torch_file.archive(module, [A], compression=zipfile.ZIP_DEFLATED), "compressed")


def test_one_file_cannot_change_how_the_next_is_read(torch_file, good):
    for name in ("_rebuild_tensor_v2", "_rebuild_parameter"):
        kind = torch_file.pickled(torch_file.Global("torch._utils", name))
        ordered = torch_file.pickled(torch_file.Global("collections", "OrderedDict"))
        attribute = b"(N}(X\x08\x00\x00\x00__init__" + ordered + b"utb"  # sets an attribute of the class
        refused(torch_file.archive(b"\x80\x02" + kind + attribute + b"."))
    np.testing.assert_array_equal(torch_pickle.read(good)["layer0.weight"], A)


def test_a_network_inside_itself(torch_file):
    module = torch_file.module(children={"a": torch_file.Global("x", "y")})
    pickle = torch_file.pickled(module).replace(b"cmodules\nDecoder\n)\x81", b"cmodules\nDecoder\n)\x81q\x00")
    refused(torch_file.archive(b"\x80\x02" + pickle.replace(b"cx\ny\n", b"h\x00") + b"."), "holds no network")


def test_a_memo_index_of_gigabytes(torch_file):
    refused(torch_file.archive(b"\x80\x02Nr" + struct.pack("<I", 0x7FFFFFFF) + b"."), "malformed")


@pytest.mark.parametrize(
    "bad", [b"", b"PK\x03\x04", b"\x80\x02}.", os.urandom(300)], ids=["empty", "cut", "bare", "noise"]
)
def test_files_that_are_no_archive(bad):
    refused(bad)


def test_archives_without_a_network(torch_file):
    refused(torch_file.archive(b""))
    refused(torch_file.archive(b"\x80\x02N."), "holds no network")
    refused(torch_file.archive(3), "holds no network")
    refused(torch_file.archive({"epoch": 3}), "not a tensor")
    refused(torch_file.archive(torch_file.module(), root="a/b"), "0 files called data.pkl")


def test_a_file_cut_anywhere(good):
    for end in range(0, len(good), 37):
        refused(good[:end])


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_damaged_pickle_gives_an_error_or_numbers(torch_file, data):
    module = torch_file.module({"w": torch_file.tensor(0, (2, 3)), "b": torch_file.tensor(0, (6,))})
    pickle = bytearray(b"\x80\x02" + torch_file.pickled(module) + b".")
    for _ in range(data.draw(st.integers(1, 3))):
        pickle[data.draw(st.integers(0, len(pickle) - 1))] = data.draw(st.integers(0, 255))
    file = torch_file.archive(bytes(pickle), [A])
    with contextlib.suppress(ValueError):  # any other error fails
        assert all(isinstance(array, np.ndarray) for array in torch_pickle.read(file).values())


@pytest.mark.parametrize("version", ["v1", "v2"])
def test_the_published_speech_encoder(version, shared):
    path = shared / "reference" / version / "speech_encoder.pt"
    state = torch_pickle.read(path.read_bytes(), path.name)
    shapes = {name: array.shape for name, array in state.items()}
    assert shapes["layer0.weight"] == (64, 81, 1)
    assert sum(array.size for array in state.values()) == 136_448


def test_against_pytorch(tmp_path):
    torch = pytest.importorskip("torch")
    network = torch.nn.Sequential(torch.nn.Linear(3, 4), torch.nn.GRU(4, 5, 2), torch.nn.LayerNorm(5))
    torch.save(network, tmp_path / "network.pt")
    torch.save(network.state_dict(), tmp_path / "state.pt")
    expected = {name: tensor.numpy() for name, tensor in network.state_dict().items()}
    for file in ("network.pt", "state.pt"):
        state = torch_pickle.read((tmp_path / file).read_bytes())
        assert list(state) == list(expected)
        assert all(np.array_equal(state[name], expected[name]) for name in expected)
