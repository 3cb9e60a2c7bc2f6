"""Settings of `prepare`: what of the release is kept, which rate and pace, which body, which speech features."""

from dataclasses import dataclass, field

from zeggs_jax.data.body import BodyConfig
from zeggs_jax.data.takes import MIN_FRAMES
from zeggs_jax.speech.features import RELEASED, SpeechFeatureConfig

RELEASED_PACE = (0.9, 1.0)


@dataclass(frozen=True)
class PrepareConfig:
    """The defaults mend the release's errors."""

    as_released: bool = False  # its centring, float32 statistics and NaN rules
    rate_hz: float | int | None = None  # resample the motion; None keeps the rate, which all clips must share
    pace: tuple[float, ...] | None = None  # copies of every clip; None: 1.0, or the release's 0.9 and 1.0
    centre: bool = True  # start every clip at the origin, facing +Z
    speech_columns: bool = False  # a std for every speech feature, not one for all as released
    save_trimmed: bool = False  # also write the clips as BVH and WAV under trimmed/
    skip_bad: bool = False  # go on without the clips that cannot be used
    min_frames: int = MIN_FRAMES  # shorter clips cannot be used
    body: BodyConfig = field(default_factory=BodyConfig)  # units, axes and roles of the files' skeleton
    speech: SpeechFeatureConfig = RELEASED

    def __post_init__(self) -> None:
        if self.min_frames < MIN_FRAMES:
            raise ValueError(f"min_frames is {self.min_frames}; velocities and statistics need at least {MIN_FRAMES}.")
        if self.rate_hz is not None and not 0 < self.rate_hz < float("inf"):
            raise ValueError(f"The rate is {self.rate_hz} frames a second; give one above 0.")
        if self.pace is not None and not (self.pace and all(0 < pace < float("inf") for pace in self.pace)):
            raise ValueError(f"The paces are {self.pace}; give at least one, all above 0.")

    @property
    def paces(self) -> tuple[float, ...]:
        """The copies that are made of every clip."""
        return self.pace or (RELEASED_PACE if self.as_released else (1.0,))


MENDED = PrepareConfig()
