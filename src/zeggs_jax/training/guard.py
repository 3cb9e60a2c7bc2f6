"""When a run must stop: a number that is not finite, or a loss far above the usual one.

Usual is the median of the last logged losses (record.py). They are in RUN/log.jsonl, so that a resumed run judges as
one that was never stopped; before 5 lines are logged nothing is far.
"""

import math
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

ENOUGH = 5  # log lines


def find_fault(
    values: Mapping[str, float], log: Sequence[Mapping[str, Any]], explode: float | None = None
) -> str | None:
    """What is wrong with an update's numbers ("loss" and its terms), half a sentence that names the term, or None."""
    wrong = [name for name, value in values.items() if not math.isfinite(value)]
    if wrong:
        return f"'{next((name for name in wrong if name != 'loss'), 'loss')}' is not finite"
    if explode is None or len(log) < ENOUGH:
        return None
    usual = _usual(log, "loss")
    if not 0 < usual * explode < values["loss"]:
        return None
    grown = {name: value - _usual(log, name) for name, value in values.items() if name in log[-1]}
    term = max((name for name in grown if name not in ("loss", "gradient")), key=grown.__getitem__, default="loss")
    return (
        f"the loss is {values['loss']:.3g}, more than {explode:g} times the usual {usual:.3g}; most of it comes from "
        f"'{term}'"
    )


def _usual(log: Sequence[Mapping[str, Any]], name: str) -> float:
    return median(line[name] for line in log if line.get(name) is not None)
