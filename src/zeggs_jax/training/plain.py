"""Frozen dataclasses as plain data for JSON and back: unknown keys and values of another type are refused."""

import dataclasses
import difflib
import types
import typing
from typing import Any, TypeVar

T = TypeVar("T")


def to_dict(config: Any) -> dict[str, Any]:
    """A config as plain dicts, lists, numbers and strings, ready for JSON."""
    return {f.name: _plain(getattr(config, f.name)) for f in dataclasses.fields(config)}


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return to_dict(value)
    return list(value) if isinstance(value, tuple) else value


def from_dict(kind: type[T], data: Any, where: str = "config") -> T:
    """Builds the frozen dataclass `kind` from what `to_dict` wrote; keys left out keep their defaults.

    Raises:
        ValueError: an unknown key (the nearest one is named) or a value of another type.
    """
    if not isinstance(data, dict):
        raise ValueError(f"{where} is {data!r}; expected a table with the fields of {kind.__name__}.")
    hints = typing.get_type_hints(kind)
    for key in data:
        if key not in hints:
            near = difflib.get_close_matches(str(key), list(hints), n=1, cutoff=0.0)[0]
            raise ValueError(f"{where} has an unknown key '{key}'; the nearest known one is '{near}'.")
    return kind(**{key: _read(hints[key], value, f"{where}.{key}") for key, value in data.items()})


def _read(hint: Any, value: Any, where: str) -> Any:
    if dataclasses.is_dataclass(hint):
        return from_dict(typing.cast(type, hint), value, where)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is types.UnionType:  # T | None, float | int
        if type(value) in arguments:
            return value
        return _read(next(kind for kind in arguments if kind is not type(None)), value, where)
    if origin is typing.Literal:
        if value in arguments:
            return value
        raise ValueError(f"{where} is {value!r}; expected one of {', '.join(map(repr, arguments))}.")
    if origin is tuple and isinstance(value, list | tuple):
        if Ellipsis not in arguments and len(value) != len(arguments):
            raise ValueError(f"{where} has {len(value)} values; expected {len(arguments)}.")
        return tuple(_read(arguments[0], item, f"{where}[{i}]") for i, item in enumerate(value))
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if origin is None and isinstance(value, hint) and not (isinstance(value, bool) and hint is not bool):
        return value
    raise ValueError(f"{where} is {value!r}; expected {getattr(hint, '__name__', hint)}.")
