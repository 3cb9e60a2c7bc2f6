"""All settings of a training run, typed and frozen: what `zeggs train --config` reads and RUN/config.json holds."""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ..data.windows import WindowConfig
from ..training.plain import from_dict
from .config import ZeroEggsConfig

LOWEST = {
    "steps": 1, "accumulate": 1, "log_every": 1, "checkpoint_every": 1, "keep": 1, "keep_every": 0,
    "validate_every": 0, "validate_clips": 1, "sample_every": 0,
}  # fmt: skip


@dataclass(frozen=True)
class TrainConfig:
    """The defaults are the paper's, as released (v1); every count is of updates."""

    model: ZeroEggsConfig = field(default_factory=ZeroEggsConfig)  # joints and frame time come from the corpus
    windows: WindowConfig = field(default_factory=WindowConfig)
    steps: int = 160_000
    learning_rate: float = 1e-4
    decay: float = 0.995  # of the learning rate, after each 1,000 updates
    eps: float = 1e-5
    clip_norm: float | None = None  # gradients longer than this are shortened to it; None: never, as released
    ema: float | None = None  # decay of the average of the parameters, which the model then is; None: no average
    kl_limit: float = 0.2
    kl_middle: float = 7500.0  # update at which the annealing of the divergence would reach 1/2
    kl_slope: float = 0.005  # per update
    seed: int = 1234
    accumulate: int = 1  # parts that a batch is worked through in: less memory, the same update
    remat: bool = False  # compute the decoder's frames again in the backward pass: less memory, the same update
    matmul: Literal["float32", "bfloat16"] = "float32"  # what matrix products round their operands to
    resident: bool = False  # the whole corpus lies on the device and batches are gathered there: for GPUs with room
    log_every: int = 10
    checkpoint_every: int = 5000
    keep: int = 3  # newest checkpoints that stay
    keep_every: int = 0  # checkpoints of multiples of this stay for good; 0: none
    keep_best: bool = True  # also the one with the lowest validation loss, as checkpoints/best
    validate_every: int = 1000  # 0: never
    validate_clips: int = 16  # windows of the split 'valid', the same ones every time
    sample_every: int = 5000  # 0: never
    explode: float | None = 100.0  # stop at a loss this many times the usual one; None: never
    speech_columns: bool = False  # a std for every speech feature; used when the corpus still has to be prepared

    def __post_init__(self) -> None:
        for name, low in LOWEST.items():
            if getattr(self, name) < low:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be at least {low}.")
        if not 0 <= self.seed < 2**32:
            raise ValueError(f"seed is {self.seed}; it must be at least 0 and below 2**32.")
        for name in ("learning_rate", "eps", "clip_norm"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise ValueError(f"{name} is {value}; it must be above 0 and finite.")
        if not 0 < self.decay <= 1:
            raise ValueError(f"decay is {self.decay}; it must be above 0 and at most 1.")
        if self.ema is not None and not 0 <= self.ema < 1:
            raise ValueError(f"ema is {self.ema}; it must be at least 0 and below 1.")
        if self.explode is not None and not 1 < self.explode < math.inf:
            raise ValueError(f"explode is {self.explode}; it must be above 1 and finite, or null.")
        if self.windows.batch % self.accumulate:
            raise ValueError(
                f"accumulate is {self.accumulate}; it must be a number that divides the batch of {self.windows.batch}."
            )


def read_config(path: str | Path) -> TrainConfig:
    """TrainConfig from a JSON file; keys left out keep their defaults, an unknown key is a ValueError."""
    try:
        return from_dict(TrainConfig, json.loads(Path(path).read_text(encoding="utf-8")), f"'{path}'")
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"'{path}' is not JSON ({error}); write the settings as one JSON object.") from error
