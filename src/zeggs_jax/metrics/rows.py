"""One row of a report: a group's measures with their intervals, those of each clip, and what could not be taken."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Int

from . import bootstrap
from .bootstrap import Interval
from .scores import MEASURES, Sample

Pick = Int[np.ndarray, " N"]  # numbers of clips, drawn again


@dataclass(frozen=True)
class ReportConfig:
    """How sure the intervals are, and what the drawing begins with."""

    level: float = bootstrap.LEVEL
    draws: int = 500
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 < self.level < 1.0 or self.draws < 1:
            raise ValueError(
                f"level {self.level:g} with {self.draws} draws is no interval; take a level in (0, 1) and some draws."
            )


class Row:
    """What is found of one group, and what could not be and why."""

    def __init__(
        self, name: str, samples: Sequence[Sample], config: ReportConfig, left_out: list[dict[str, str]]
    ) -> None:
        self.name, self.samples, self.config, self.left_out = name, samples, config, left_out
        self.values: dict[str, dict[str, float | int | None]] = {}
        self.each: list[dict[str, Any]] = [
            {"name": s.name, "speech": s.speech, "style": s.style, "values": {}} for s in samples
        ]

    @property
    def strata(self) -> list[str | None]:
        """The styles, within which clips are drawn."""
        return [sample.style for sample in self.samples]

    def add(self, measure: str, found: Interval, clips: int) -> None:
        """A measure of the whole group."""
        value, low, high = (None if np.isnan(x) else float(x) for x in found)
        self.values[measure] = {"value": value, "low": low, "high": high, "clips": clips}

    def refuse(self, measure: str, error: ValueError | str, clip: str = "") -> None:
        """Why a measure is not there."""
        self.left_out.append({"group": self.name, "clip": clip, "measure": measure, "reason": str(error)})

    def means(self, found: Mapping[int, Mapping[str, float]]) -> None:
        """Values of clips by the clip's number: kept for each, and every measure's mean over those that have it."""
        config = self.config
        for number, values in found.items():
            self.each[number]["values"] |= {measure: float(value) for measure, value in values.items()}
        for measure in MEASURES:
            if has := [number for number, values in found.items() if measure in values]:
                values, styles = np.array([found[k][measure] for k in has]), [self.strata[k] for k in has]
                self.add(measure, bootstrap.of_mean(values, config.seed, config.level, config.draws, styles), len(has))

    def statistic(
        self,
        measure: str,
        make: Callable[[], Callable[[Pick], float]],
        strata: Sequence[str | None] | None = None,
    ) -> None:
        """A measure of the whole group that is never below zero; `make` prepares what every drawing of clips needs."""
        config, strata = self.config, self.strata if strata is None else strata
        try:
            found = bootstrap.of_statistic(
                make(), len(strata), config.seed, config.level, config.draws, "centred", strata
            )
        except ValueError as error:
            self.refuse(measure, error)
        else:
            self.add(measure, found._replace(low=np.maximum(found.low, 0.0)), len(strata))

    def beside(self, truth: "Row") -> None:
        """To every mean over clips, as "recorded", the truth's mean over the clips of the same speech, one for each."""
        recorded = {clip["name"]: clip["values"] for clip in truth.each}
        for measure, cell in self.values.items():
            paired = [recorded.get(c["speech"], {}).get(measure) for c in self.each if measure in c["values"]]
            if paired and None not in paired:
                cell["recorded"] = float(np.mean(paired))

    def summary(self) -> dict[str, Any]:
        """The row as plain data."""
        seconds = sum(len(sample.motion.positions) / sample.motion.rate_hz for sample in self.samples)
        return {"clips": len(self.samples), "seconds": round(seconds, 3), "values": self.values, "each": self.each}
