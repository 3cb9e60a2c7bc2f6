"""The networks' configuration: typed, frozen and complete."""

from dataclasses import dataclass, field

from ..data.body import AS_IS, BodyConfig
from ..motion import pose
from ..speech.features import SpeechFeatureConfig
from . import encoders
from .decoder import DecoderConfig
from .speech_encoder import SpeechEncoderConfig
from .style_encoder import StyleEncoderConfig


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
                if type(value) is int and value < 1 and name != "lookahead":
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
        if not 0 <= self.speech.ahead < self.speech.kernel:
            raise ValueError(
                f"SpeechEncoderConfig.lookahead is {self.speech.lookahead}; a kernel of {self.speech.kernel} frames "
                f"sees 0 to {self.speech.kernel - 1} ahead."
            )
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
