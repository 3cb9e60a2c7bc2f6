"""The style space's promises beside what 12_control.py found of them, and its tables, as Markdown."""

from collections.abc import Sequence

import numpy as np

import ledger
import sweeps
import transitions
from control import Found

FACTORS, RHO, RECOGNISED = 4, 0.8, 0.9  # what is asked for


def promises(found: Found) -> list[Found]:
    """What is asked of a style space, what is found, and whether that is enough."""
    lines = [_walks(kind, what, found[kind]) for kind, what in (("interpolation", "pairs"), ("intensity", "styles"))]
    lines += [_component(row) for row in found["components"][:2]]
    lines.append(_samples(found["samples"]))
    if "recognition" in found:
        of = found["recognition"]
        told = f"{of['accuracy']:.0%} of {of['clips']} clips (truth itself {of['truth']:.0%}), "
        told += f"both of {of['pairs']:.0%} of {of['number of pairs']} pairs"
        asked = f"one speech in two styles: at least {RECOGNISED:.0%} recognised"
        lines.append(_line(asked, told, of["accuracy"] >= RECOGNISED))
        lines += [_part(part, of["kinds"][transitions.DEFAULT]) for part, of in found["timeline"].items()]
    return lines


def _walks(kind: str, what: str, rows: Sequence[Found]) -> Found:
    known = any(row["differ"] for row in rows)
    counts = [len(row["steady"] if known else row["moving"]) for row in rows]
    kept = sum(count >= FACTORS for count in counts)
    asked = f"{kind}: at least {FACTORS} {'known factors' if known else 'direct measures'} follow the steps (>= 0.95)"
    told = f"{kept} of {len(rows)} {what}; median {np.median(counts):g}, least {min(counts)}"
    return _line(asked, told, kept == len(rows))


def _component(row: Found) -> Found:
    direct = [item for item in row["ranks"].items() if not item[0].startswith(sweeps.FACTOR)]
    name, rho = max(direct, key=lambda item: abs(item[1]))
    asked = f"component {row['number']}: rank correlation with a direct measure of at least {RHO}"
    return _line(asked, f"{rho:+.2f} with {name}", abs(rho) >= RHO)


def _samples(rows: Sequence[Found]) -> Found:
    told = ", ".join(f"{row['hands_cm']:.3g} cm at {row['temperature']:g}" for row in rows)
    met = rows[0]["hands_cm"] == rows[0]["diversity"] == 0.0 and rows[0]["grows"]
    return _line(f"samples of each of {rows[0]['styles']} styles differ more with temperature, not at 0", told, met)


def _part(part: str, of: Found) -> Found:
    asked = f"transitions ({transitions.DEFAULT}): peak acceleration of {part} within the truth's 95th percentile"
    told = f"{of['within']:.0%} of {of['transitions']}; {of['within own']:.0%} within that of their two styles"
    return _line(asked, told, of["within"] == 1.0)


def _line(asked: str, told: str, met: bool) -> Found:
    return {"asked": asked, "found": told, "met": bool(met)}


def tables(found: Found) -> str:
    """Everything as Markdown."""
    lines = [[row["asked"], row["found"], "yes" if row["met"] else "**no**"] for row in promises(found)]
    parts = [ledger.table(["asked", "found", "met"], lines)]
    for kind, what in (("interpolation", "pair"), ("intensity", "style")):
        parts.append(_walk_table(what, f"{kind}: steady of the known factors that differ", found[kind]))
    body = [_component_row(row) for row in found["components"]]
    parts.append(ledger.table(["component", "variance", "direct measures, from -2 to 2 std", "known factors"], body))
    body = [[f"{r['temperature']:g}", f"{r['hands_cm']:.2f}", f"{r['diversity']:.2f}"] for r in found["samples"]]
    parts.append(ledger.table(["temperature", "hands of two samples apart, cm", "diversity of statistics"], body))
    if "timeline" in found:
        parts.append(_timeline(found["timeline"]))
    return "\n\n".join(parts)


def _walk_table(what: str, title: str, rows: Sequence[Found]) -> str:
    """One line for each; the worst first."""
    ordered = sorted(rows, key=lambda row: len(row["steady"]))
    body = [[r["name"], f"{len(r['steady'])} of {len(r['differ'])}", ", ".join(r["steady"])] for r in ordered]
    return ledger.table([what, title, "which"], body)


def _component_row(row: Found) -> list[str]:
    strong = sorted((item for item in row["ranks"].items() if abs(item[1]) >= RHO), key=lambda item: -abs(item[1]))
    direct, factors = [], []
    for name, rho in strong:
        begin, end = row["ends"][name]
        text = f"{name.removeprefix(sweeps.FACTOR)} {rho:+.2f} ({begin:.3g} to {end:.3g})"
        (factors if name.startswith(sweeps.FACTOR) else direct).append(text)
    return [str(row["number"]), f"{row['share']:.0%}", ", ".join(direct), ", ".join(factors)]


def _timeline(found: Found) -> str:
    body = []
    for part, of in found.items():
        body.append([part, "truth, every 2 s", "", f"p99 {of['p99'] / 100:.1f}", "95%", "", "", ""])
        body[-1][2] = f"p95 {of['p95'] / 100:.1f}"
        for kind, r in of["kinds"].items():
            peaks = [f"{r[key] / 100:.1f}" for key in ("median", "largest")]
            worst = f"{r['largest over own']:.2f} ({r['worst']})"
            shares = [f"{r['within']:.0%}", f"{r['within own']:.0%}", worst, f"{r['steady within own']:.0%}"]
            body.append(["", kind, *peaks, *shares])
    head = [
        "peak acceleration of",
        "transition",
        "median, m/s^2",
        "largest",
        "within p95",
        "within p95 of its two styles",
    ]
    return ledger.table([*head, "largest over that", "6 s later, within p95 of its style"], body)
