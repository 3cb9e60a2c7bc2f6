"""Reads a network that PyTorch saved, without PyTorch and without running anything that the file contains.

A .pt file is a zip archive of a pickle and raw little-endian storages. The pickle is read with a fixed list
of opcodes and names: network classes become empty stand-ins, tensors become numpy arrays, every other name is
refused.
"""

import io
import pickle
import pickletools
import re
import zipfile
from collections import OrderedDict
from typing import Any, BinaryIO

import numpy as np

STORAGES = {
    "FloatStorage": "<f4",
    "DoubleStorage": "<f8",
    "HalfStorage": "<f2",
    "LongStorage": "<i8",
    "IntStorage": "<i4",
    "BoolStorage": "?",
}
OPCODES = set(  # what PyTorch writes in any protocol; no INST, OBJ, EXT, NEWOBJ_EX, DUP, POP
    """
    PROTO FRAME STOP MARK GLOBAL STACK_GLOBAL REDUCE BUILD NEWOBJ BINPERSID
    MEMOIZE PUT BINPUT LONG_BINPUT GET BINGET LONG_BINGET
    NONE NEWTRUE NEWFALSE BININT BININT1 BININT2 LONG1 BINFLOAT BINUNICODE SHORT_BINUNICODE
    EMPTY_TUPLE TUPLE TUPLE1 TUPLE2 TUPLE3 EMPTY_LIST APPEND APPENDS
    EMPTY_DICT SETITEM SETITEMS EMPTY_SET ADDITEMS
    """.split()  # noqa: SIM905
)
NETWORK_CLASS = re.compile(r"(modules|__main__|torch\.nn\.modules\.\w+)\.[A-Za-z]\w*")
MAX_DEPTH = 32


def read(file: bytes | BinaryIO, name: str = "the file") -> dict[str, np.ndarray]:
    """The parameters and buffers in a .pt file, under their state_dict names.

    Args:
        file: the file's bytes, or the file opened for reading; a whole saved module or a saved state_dict.
        name: what to call it in an error.

    Raises:
        ValueError: not such an archive, cut off, or a pickle that asks for a name which no network needs.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(file) if isinstance(file, bytes) else file) as archive:
            return _state(_Reader(archive).load())
    except _Refused as refusal:
        raise ValueError(f"'{name}' was refused: {refusal}; expected a network saved by PyTorch.") from refusal
    except Exception as error:  # a broken pickle can fail in any way; nothing of it has been run
        reason = str(error) or type(error).__name__
        raise ValueError(f"'{name}' is not a network saved by PyTorch as a zip archive ({reason}).") from error


class _Refused(Exception):
    """What the file contains and no network needs."""


class _Module:
    """Stands in for every network class; holds what the pickle says of it and does nothing."""

    def __init__(self, *ignored: Any) -> None:
        pass


class _Reader(pickle.Unpickler):
    """An unpickler that knows the names below, and no others."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        pickles = [entry for entry in archive.namelist() if re.fullmatch(r"[^/]+/data\.pkl", entry)]
        if len(pickles) != 1:
            raise _Refused(f"it holds {len(pickles)} files called data.pkl")
        self._archive, self._root = archive, pickles[0].removesuffix("data.pkl")
        self._storages: dict[str, np.ndarray] = {}
        self._names: dict[str, Any] = {  # classes of this file alone: what it does to them, no other file sees
            "collections.OrderedDict": OrderedDict,
            "__builtin__.set": set,
            "builtins.set": set,
            "torch._utils._rebuild_tensor_v2": type("Tensor", (_Tensor,), {}),
            "torch._utils._rebuild_parameter": type("Parameter", (_Parameter,), {}),
            **{f"torch.{kind}": kind for kind in STORAGES},
        }
        self._network_class = type("Module", (_Module,), {})
        if self._root + "byteorder" in archive.namelist() and self._bytes("byteorder") != b"little":
            raise _Refused("its numbers are not little-endian")
        content = self._bytes("data.pkl")
        _check_opcodes(content)
        super().__init__(io.BytesIO(content))

    def find_class(self, module: str, name: str) -> Any:
        """The stand-in for a name in the pickle."""
        full = f"{module}.{name}"
        if full in self._names:
            return self._names[full]
        if NETWORK_CLASS.fullmatch(full):
            return self._network_class
        raise _Refused(f"it asks for '{full}'")

    def persistent_load(self, pid: Any) -> np.ndarray:
        """One storage, as a flat array."""
        tag, kind, key, _, count = pid
        if tag != "storage" or kind not in STORAGES or not re.fullmatch(r"\d{1,9}", key):
            raise _Refused(f"it asks for the storage {pid!r}")
        if key not in self._storages:
            self._storages[key] = np.frombuffer(self._bytes(f"data/{key}"), STORAGES[kind])
        if self._storages[key].size != count:
            raise _Refused(f"storage {key} holds {self._storages[key].size} numbers and claims {count}")
        return self._storages[key]

    def _bytes(self, entry: str) -> bytes:
        info = self._archive.getinfo(self._root + entry)
        if info.compress_type != zipfile.ZIP_STORED:
            raise _Refused(f"its entry '{info.filename}' is compressed")
        return self._archive.read(info)


def _check_opcodes(content: bytes) -> None:
    for opcode, argument, _ in pickletools.genops(content):
        if opcode.name not in OPCODES:
            raise _Refused(f"its pickle uses {opcode.name}")
        if opcode.name.endswith("PUT") and not 0 <= int(argument or 0) <= len(content):
            raise _Refused("its pickle is malformed")


class _Tensor:
    """A tensor's numbers: a strided view of its storage, copied."""

    def __init__(self, storage: Any, offset: int, shape: tuple, strides: tuple, *ignored: Any) -> None:
        numbers = (offset, *shape, *strides)
        if not isinstance(storage, np.ndarray) or any(type(n) is not int or n < 0 for n in numbers):
            raise _Refused("a tensor in it is malformed")
        last = offset + sum((n - 1) * step for n, step in zip(shape, strides, strict=True))
        count = int(np.prod(shape, dtype=object))
        if count > storage.size or (count > 0 and last >= storage.size):
            raise _Refused("a tensor in it reaches beyond its storage")
        steps = [step * storage.itemsize for step in strides]
        start = storage[offset:] if count else storage[:0]
        self.array = np.lib.stride_tricks.as_strided(start, shape, steps, writeable=False).copy()


class _Parameter:
    """A tensor that is trained."""

    def __init__(self, tensor: Any, *ignored: Any) -> None:
        self.array = _array(tensor, "a parameter")


def _array(tensor: Any, name: str) -> np.ndarray:
    array = getattr(tensor, "array", None)
    if not isinstance(tensor, _Tensor | _Parameter) or not isinstance(array, np.ndarray):
        raise _Refused(f"{name} in it is not a tensor")
    return array


def _state(root: Any) -> dict[str, np.ndarray]:
    """The state_dict of a stand-in module, or a saved state_dict itself."""
    if isinstance(root, dict):
        return {str(name): _array(tensor, f"'{name}'") for name, tensor in root.items()}
    state: dict[str, np.ndarray] = {}
    _collect(root, "", 0, state)
    if not state:
        raise _Refused("it holds no network")
    return state


def _collect(module: Any, prefix: str, depth: int, state: dict[str, np.ndarray]) -> None:
    if not isinstance(module, _Module) or depth > MAX_DEPTH:
        raise _Refused("it holds no network")
    parts = vars(module)
    for kind in ("_parameters", "_buffers"):
        for name, tensor in parts.get(kind, {}).items():
            if tensor is not None and name not in parts.get("_non_persistent_buffers_set", ()):
                state[prefix + name] = _array(tensor, f"'{prefix + name}'")
    for name, child in parts.get("_modules", {}).items():
        if child is not None:
            _collect(child, f"{prefix}{name}.", depth + 1, state)
