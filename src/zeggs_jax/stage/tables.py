"""The tables of a report's page: measures, styles recognised, what was left out, where all comes from."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from zeggs_jax.stage import charts
from zeggs_jax.stage.charts import number
from zeggs_jax.stage.legend import TRUTH, colours, swatch

SECTIONS = {
    "Like the recorded motion as a whole": (
        "fgd", "frechet_postures", "frechet_velocities", "hellinger_speed", "hellinger_acceleration", "hellinger_jerk",
    ),
    "Style and variety": ("recognised", "diversity", "multimodality", "l1"),
    "Like the recorded clip of the same speech": ("ape", "ave", "pck", "canonical", "coverage_dice", "coverage_area"),
    "In time with the speech": (
        "energy", "energy_chance", "beat_consistency", "beat_consistency_chance", "beat_alignment",
        "beat_alignment_chance", "stress", "stress_chance",
    ),
    "How it moves": ("speed", "acceleration", "jerk", "skate", "floating", "sunk"),
}  # fmt: skip
ARROWS = {"low": "↓ lower is better", "high": "↑ higher is better", "as the truth": "≈ nearest to the truth is best"}


def table(found: Mapping[str, Any]) -> str:
    """Measures by subject, a column for each group, the best marked, values and intervals drawn."""
    groups = found["groups"]
    head = "".join(f'<th scope="col" class="figure">{swatch(group, found)}</th>' for group in groups)
    body = ""
    for section, measures in SECTIONS.items():
        rows = "".join(
            _row(measure, found) for measure in measures if any(measure in g["values"] for g in groups.values())
        )
        if rows:
            body += f'<tbody><tr><th colspan="{len(groups) + 2}" class="section">{section}</th></tr>{rows}</tbody>'
    return (
        f'<table class="measures"><thead><tr><th scope="col">Measure</th>{head}'
        f'<th scope="col">Values and intervals</th></tr></thead>{body}</table>'
    )


def _row(measure: str, found: Mapping[str, Any]) -> str:
    groups, about = found["groups"], found["measures"][measure]
    cells = {name: group["values"][measure] for name, group in groups.items() if measure in group["values"]}
    best = found["best"].get(measure, [])
    columns = ""
    for name in groups:
        if (cell := cells.get(name)) is None:
            columns += '<td class="figure quiet">–</td>'
            continue
        spread = "" if cell["low"] is None else f"<small>{number(cell['low'])} … {number(cell['high'])}</small>"
        few = "" if cell["clips"] == groups[name]["clips"] else f"<small>of {cell['clips']}</small>"
        mark = ' best" title="best of the made groups' if name in best else ""
        columns += f'<td class="figure{mark}"><b>{number(cell["value"])}</b>{spread}{few}</td>'
    unit = f' <span class="unit">{escape(_unit(about["unit"]))}</span>' if about["unit"] else ""
    drawn = charts.interval(cells, TRUTH, colours(list(groups)))
    way = ARROWS.get(about["better"], "read beside the one above")
    sign = way[0] if way[0] in "↓↑≈" else "·"
    return (
        f'<tr><th scope="row"><span title="{way}">{sign}</span> {measure.replace("_", " ")}'
        f"{unit}<small>{escape(about['text'])}</small></th>{columns}<td>{drawn}</td></tr>"
    )


def _unit(text: str) -> str:
    return "" if text in ("share", "r") else text.replace("^2", "²").replace("^3", "³")


def styles(found: Mapping[str, Any]) -> str:
    """Per style and group how many clips are recognised, and what the others are taken for."""
    groups = found["groups"]
    shown = sorted({clip["style"] for group in groups.values() for clip in group["each"] if "recognised_as" in clip})
    if not shown:
        return '<p class="quiet">Styles could not be recognised; the reason stands under “Left out”.</p>'
    head = "".join(f'<th scope="col" class="figure">{swatch(group, found)}</th>' for group in groups)
    rows = ""
    for style in shown:
        rows += f'<tr><th scope="row">{escape(style)}</th>'
        for group in groups.values():
            seen = [
                clip["recognised_as"] for clip in group["each"] if clip["style"] == style and "recognised_as" in clip
            ]
            others = sorted({name for name in seen if name != style}, key=lambda name: (-seen.count(name), name))
            text = ", ".join(f"{escape(name)} {seen.count(name)}" for name in others)
            mistaken = f"<small>taken for {text}</small>" if others else ""
            share = f"<b>{seen.count(style)}</b> of {len(seen)}" if seen else "–"
            rows += f'<td class="figure{"" if seen else " quiet"}">{share}{mistaken}</td>'
        rows += "</tr>"
    return (
        f'<table class="styles"><thead><tr><th scope="col">Style</th>{head}</tr></thead><tbody>{rows}</tbody></table>'
    )


def left_out(found: Mapping[str, Any]) -> str:
    """Notes, then what could not be measured: equal reasons of several clips once."""
    notes = "".join(f"<li>{escape(note)}</li>" for note in found.get("notes", []))
    reasons: dict[tuple[str, str, str], list[str]] = {}
    for item in found["left_out"]:
        reasons.setdefault((item["group"], item["measure"], item["reason"]), []).append(item["clip"])
    rows = "".join(
        f"<tr><td>{swatch(group, found)}</td><td>{escape(measure.replace('_', ' '))}</td>"
        f"<td>{escape(_few(clips))}</td>"
        f"<td>{escape(reason)}</td></tr>"
        for (group, measure, reason), clips in reasons.items()
    )
    table = (
        '<table class="left"><thead><tr><th scope="col">Group</th><th scope="col">Measure</th>'
        f'<th scope="col">Clips</th><th scope="col">Why</th></tr></thead><tbody>{rows}</tbody></table>'
        if rows
        else '<p class="quiet">Nothing: every measure was taken of every clip.</p>'
    )
    return (f'<ul class="plain">{notes}</ul>' if notes else "") + table


def _few(clips: Sequence[str]) -> str:
    """The first four names, and how many more there are."""
    return ", ".join(filter(None, clips[:4])) + (f" and {len(clips) - 4} more" if len(clips) > 4 else "")


def provenance(found: Mapping[str, Any]) -> str:
    """Versions, seeds and hashes."""
    origin = found.get("provenance", {})
    net = found["settings"]["feature_net"]
    facts = {key.replace("_", " "): value for key, value in origin.items() if not isinstance(value, Mapping | list)}
    facts |= {"seed": found["settings"]["seed"]}
    if net:
        facts |= {
            "feature net": f"{net['fingerprint']} ({net['features']} features of {net['frames'] / net['rate_hz']:g} s; "
            f"seed {net['seed']}; decodes to {net['error_cm']:.2f} cm)",
            "trained on data": net["data_hash"],
        }
    rows = "".join(f"<dt>{escape(str(key))}</dt><dd>{escape(str(value))}</dd>" for key, value in facts.items())
    lists = "".join(
        f"<details><summary>{escape(key.replace('_', ' '))} ({len(value)})</summary><dl>"
        + "".join(f"<dt>{escape(str(k))}</dt><dd>{escape(str(v))}</dd>" for k, v in value.items())
        + "</dl></details>"
        for key, value in origin.items()
        if isinstance(value, Mapping)
    )
    return f"<dl>{rows}</dl>{lists}"
