"""The networks' configuration: typed, frozen and complete, written as a dict and read back strictly."""

import dataclasses
import difflib
import types
import typing
from dataclasses import dataclass, field
from typing import Any, TypeVar

from ..data.body import AS_IS, BodyConfig
from ..motion import pose
from ..speech.features import SpeechFeatureConfig
from . import encoders
from .decoder import DecoderConfig
from .speech_encoder import SpeechEncoderConfig
from .style_encoder import StyleEncoderConfig

T = TypeVar("T")


@dataclass(frozen=True)
class ZeroEggsConfig:
    """Sizes of the whole of Fig. 2; the defaults are the paper's, as released (v1).

    `labels` names the styles of a model that is steered by labels (style kind 'label', the release's v2: an
    embedding is one-hot); it is empty when styles come from examples.
    """

    joints: int = 75
    frame_time: float = 0.016667  # s; the release reads it from BVH text, so it is not 1/60
    labels: tuple[str, ...] = ()
    speech: SpeechEncoderConfig = field(default_factory=SpeechEncoderConfig)
    style: StyleEncoderConfig = field(default_factory=StyleEncoderConfig)
    decoder: DecoderConfig = field(default_factory=DecoderConfig)
    features: SpeechFeatureConfig = field(default_factory=SpeechFeatureConfig)  # what the model hears
    body: BodyConfig = AS_IS  # how files of the model's body are read: units, axes and roles, as in training

    def __post_init__(self) -> None:
        encoders.check(self.style.kind)
        if bool(self.labels) != (self.style.kind == encoders.LABEL):
            raise ValueError(
                f"the style kind is '{self.style.kind}' and there are {len(self.labels)} labels; "
                "give labels with kind 'label', and only with it."
            )
        for part in (self, self.speech, self.style, self.decoder):
            for name, value in vars(part).items():
                if type(value) is int and value < 1:
                    raise ValueError(f"{type(part).__name__}.{name} is {value}; sizes are at least 1.")
        for name, dropout in (
            ("SpeechEncoderConfig.dropout", self.speech.dropout),
            ("StyleEncoderConfig.dropout", self.style.dropout),
            ("StyleEncoderConfig.block_dropout", self.style.block_dropout),
        ):
            if not 0 <= dropout < 1:
                raise ValueError(f"{name} is {dropout}; it must be at least 0 and below 1.")
        if self.speech.kernel % 2 == 0:
            raise ValueError(f"SpeechEncoderConfig.kernel is {self.speech.kernel}; it must be odd.")
        width, heads = self.style.outputs, self.style.heads
        if self.style.kind == "attn" and width % heads:
            raise ValueError(f"the style encoder is {width} wide, which its {heads} heads do not divide.")

    @property
    def vector_size(self) -> int:
        """Numbers in a pose vector: 6 of the root, 15 of every joint."""
        return pose.size(self.joints)

    @property
    def style_size(self) -> int:
        """Numbers in a style embedding."""
        return len(self.labels) or self.style.size


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
