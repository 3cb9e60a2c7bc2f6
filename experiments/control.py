"""Rows of 12_control.py summed up: what walks, components, samples, styles and transitions show, as plain numbers."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

import instrument
import ledger
import sweeps
from zeggs_jax.metrics import recognition
from zeggs_jax.synthetic import styles

Found = dict[str, Any]


def summary(rows: Sequence[ledger.Row]) -> Found:
    """Everything that is found, for JSON; what needs the truth is left out where there is none."""
    by = ledger.grouped(rows, "kind")
    found: Found = {
        "interpolation": [interpolation(row) for row in by["interpolation"]],
        "intensity": [intensity(row) for row in by["intensity"]],
        "components": [component(row) for row in by["component"]],
        "samples": samples(by["samples"]),
    }
    if "real" in by:
        found["recognition"] = recognised(by["performance"], by["real"])
        found["timeline"] = timelines(by["timeline"], by["real peaks"])
    return found


def interpolation(row: ledger.Row) -> Found:
    """Which known factors, and which direct measures, go steadily from one style to another."""
    way = sweeps.towards(styles.STYLES[row["a"]], styles.STYLES[row["b"]]) if _factors(row) else {}
    return {"name": f"{row['a']} to {row['b']}", **_steady(row, way)}


def intensity(row: ledger.Row) -> Found:
    """The same from the centre to twice the style; the way is from what the centre shows to the style's factors."""
    centre = _factors(row)
    way = sweeps.towards(centre, styles.STYLES[row["style"]]) if centre else {}
    return {"name": row["style"], **_steady(row, way)}


def _factors(row: ledger.Row) -> list[float]:
    """What the first step shows of each factor; empty where they are not known."""
    return [value for name, value in row["shown"][0].items() if name.startswith(sweeps.FACTOR)]


def _steady(row: ledger.Row, way: dict[str, float]) -> Found:
    ranks = instrument.rank_correlations(range(len(row["shown"])), row["shown"])
    return {"differ": list(way), "steady": sweeps.steady(ranks, way), "moving": sweeps.moving(ranks), "ranks": ranks}


def component(row: ledger.Row) -> Found:
    """What a component moves: rank correlations of all measures, and where they begin and end."""
    ranks = instrument.rank_correlations(range(len(row["shown"])), row["shown"])
    ends = {name: (value, row["shown"][-1][name]) for name, value in row["shown"][0].items()}
    return {"number": row["number"], "share": row["share"], "ranks": ranks, "ends": ends}


def samples(rows: Sequence[ledger.Row]) -> list[Found]:
    """By temperature: how much samples of one style differ, mean over styles; and whether it grows for every one."""
    grows = all(bool(np.all(np.diff([r["hands_cm"] for r in of]) > 0)) for of in ledger.grouped(rows, "style").values())
    found = []
    for temperature, of in ledger.grouped(rows, "temperature").items():
        means = {column: ledger.mean(of, column) for column in ("diversity", "hands_cm")}
        found.append({"temperature": temperature, "styles": len(of), "grows": grows, **means})
    return found


def recognised(made: Sequence[ledger.Row], real: Sequence[ledger.Row]) -> Found:
    """How often a style is recognised among all, how often both of two styles of one speech are, and what is taken."""
    clips = [(row["speech"], name) for row in made for name in row["rows"]]
    names = [name for _, name in clips]
    ours, theirs = (
        np.array(rows) for rows in ([x for row in made for x in row["rows"].values()], [r["row"] for r in real])
    )
    found = recognition.judge(theirs, [row["style"] for row in real], ours, names)
    right = dict(zip(clips, found.right, strict=True))
    pairs = [right[a] and right[b] for a in right for b in right if a[0] == b[0] and a[1] < b[1]]
    taken = [f"{name} for {other}" for name, other in zip(names, found.recognised, strict=True) if name != other]
    return {
        "accuracy": found.accuracy, "truth": found.truth, "chance": found.chance, "clips": len(clips),
        "pairs": float(np.mean(pairs)), "number of pairs": len(pairs), "taken": taken,
    }  # fmt: skip


def timelines(made: Sequence[ledger.Row], real: Sequence[ledger.Row]) -> Found:
    """By part of the body and kind of transition: its peaks against the 95th percentile of the truth's."""
    parts = list(real[0]["peaks"])
    found: Found = {}
    for part in parts:
        peaks = {row["style"]: np.array(row["peaks"][part]) for row in real}
        p95, p99 = np.percentile(np.concatenate(list(peaks.values())), (95, 99)).tolist()
        own = {name: float(np.percentile(values, 95)) for name, values in peaks.items()}
        found[part] = {
            "p95": p95, "p99": p99, "styles": own,
            "kinds": {kind: _kind(made, kind, part, p95, own) for kind in made[0]["peaks"]},
        }  # fmt: skip
    return found


def _kind(rows: Sequence[ledger.Row], kind: str, part: str, p95: float, own: dict[str, float]) -> Found:
    """`own`: the truth's 95th percentile by style; a transition's bound is the larger one of its two styles."""
    found = np.array([peak for row in rows for peak in row["peaks"][kind][part]])
    bound = np.array([max(own[a], own[b]) for row in rows for a, b in pairwise(row["order"])])
    names = [f"{a} to {b}" for row in rows for a, b in pairwise(row["order"])]
    steady = np.array([peak for row in rows for peak in row["steady"][kind][part]])
    kept = np.array([own[name] for row in rows for name in row["order"]])
    return {
        "transitions": len(found),
        "median": float(np.median(found)),
        "largest": float(found.max()),
        "within": float((found <= p95).mean()),
        "within own": float((found <= bound).mean()),
        "largest over own": float((found / bound).max()),
        "worst": names[int((found / bound).argmax())],
        "steady within own": float((steady <= kept).mean()),
    }
