"""The page of an evaluation: tables, drawings and players in one file that asks the network for nothing."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from zeggs_jax.stage import charts, player
from zeggs_jax.stage.charts import number
from zeggs_jax.stage.player import COLOURS

TRUTH = "truth"
SLATE = "#64788e"  # what the recorded body wears
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


class Scene(NamedTuple):
    """One speech on the page: the recorded body and the made ones beside it."""

    label: str
    scene: Mapping[str, Any]  # of `player.scene`
    notes: Sequence[str]  # one line for each figure


def colours(groups: Sequence[str]) -> dict[str, str]:
    """What each group wears, everywhere on the page."""
    made = [group for group in groups if group != TRUTH]
    return {TRUTH: SLATE} | {group: COLOURS[k % (len(COLOURS) - 1)] for k, group in enumerate(made)}


def write(path: str | Path, found: Mapping[str, Any], scenes: Sequence[Scene], title: str = "Evaluation") -> None:
    """Write the page of what `metrics.report.report` found (with pictures), and of the players' scenes.

    OSError where the page cannot be written.
    """
    player.save(path, page(found, scenes, title))


def page(found: Mapping[str, Any], scenes: Sequence[Scene], title: str) -> str:
    """The page's text."""
    folder = resources.files("zeggs_jax.stage") / "page"
    fill = {
        "title": escape(title),
        "style": (folder / "report.css").read_text("utf-8"),
        "script": (folder / "report.js").read_text("utf-8"),
        "lead": _lead(found),
        "legend": _legend(found),
        "stages": _stages(scenes),
        "table": _table(found),
        "histograms": _histograms(found),
        "maps": _maps(found),
        "styles": _styles(found),
        "left_out": _left_out(found),
        "provenance": _provenance(found),
        "frame": data("frame", player.page(title, {})),
        "scenes": "".join(data(f"scene{k}", item.scene) for k, item in enumerate(scenes)),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda hole: fill[hole[1]], (folder / "report.html").read_text("utf-8"))


def data(name: str, value: Any) -> str:
    """Data that the page's script reads."""
    text = json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")
    return f'<script type="application/json" id="{name}">{text}</script>\n'


def _swatch(group: str, found: Mapping[str, Any]) -> str:
    return f'<i class="swatch" style="background:{colours(list(found["groups"]))[group]}"></i>{escape(group)}'


def _lead(found: Mapping[str, Any]) -> str:
    groups, settings = found["groups"], found["settings"]
    made = [
        f"<strong>{escape(name)}</strong> ({group['clips']} clips, {_minutes(group['seconds'])})"
        for name, group in groups.items()
        if name != TRUTH
    ]
    own = groups[TRUTH]
    return (
        f"{', '.join(made)} beside {own['clips']} recorded clips of {_minutes(own['seconds'])}: "
        f"{settings['joints']} joints at {settings['rate_hz']:g} frames per second. "
        f"Whiskers are {100 * settings['level']:g}&nbsp;% intervals over clips, drawn {settings['draws']} times."
    )


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f}&nbsp;s" if seconds < 90 else f"{seconds / 60:.1f}&nbsp;min"


def _legend(found: Mapping[str, Any]) -> str:
    return "".join(f"<span>{_swatch(group, found)}</span>" for group in found["groups"])


def _stages(scenes: Sequence[Scene]) -> str:
    if not scenes:
        return '<p class="quiet">No made clip goes with a recorded one, so there is nothing to play side by side.</p>'
    options = "".join(f'<option value="{k}">{escape(item.label)}</option>' for k, item in enumerate(scenes))
    notes = "".join(
        f'<ul class="notes" data-scene="{k}" hidden>'
        + "".join(f"<li>{escape(line)}</li>" for line in item.notes)
        + "</ul>"
        for k, item in enumerate(scenes)
    )
    return (
        '<div class="chooser"><button type="button" id="before" aria-label="Clip before">‹</button>'
        f'<label>Clip <select id="clip">{options}</select></label>'
        '<button type="button" id="after" aria-label="Next clip">›</button></div>'
        f'<iframe id="player" title="Recorded and made bodies side by side"></iframe>{notes}'
    )


def _table(found: Mapping[str, Any]) -> str:
    groups = found["groups"]
    head = "".join(f'<th scope="col" class="figure">{_swatch(group, found)}</th>' for group in groups)
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


def _histograms(found: Mapping[str, Any]) -> str:
    units = {"speed": "cm/s", "acceleration": "cm/s²", "jerk": "cm/s³"}
    worn, parts = colours(list(found["groups"])), []
    for name, item in found.get("histograms", {}).items():
        apart = [
            f"<li>{_swatch(group, found)} {number(entry['value'])}</li>"
            for group, row in found["groups"].items()
            if (entry := row["values"].get(f"hellinger_{name}"))
        ]
        drawn = charts.histogram(item["edges"], item["shares"], TRUTH, worn, units[name])
        parts.append(
            f"<figure><figcaption><b>{name.capitalize()}</b> of the major joints</figcaption>{drawn}"
            f'<ul class="apart"><li class="quiet">Hellinger distance</li>{"".join(apart)}</ul></figure>'
        )
    return "".join(parts)


def _maps(found: Mapping[str, Any]) -> str:
    maps = found.get("maps")
    if not maps:
        return ""
    size = len(maps["rows"][TRUTH])
    used = [
        (y, x) for rows in maps["rows"].values() for y, row in enumerate(rows) for x in range(size) if row[x] != "0"
    ]
    aside = min((min(x, size - 1 - x) for _, x in used), default=0)
    crop = max(aside - 2, 0), min(max((y for y, _ in used), default=size - 1) + 4, size)
    worn, parts = colours(list(found["groups"])), []
    for group, rows in maps["rows"].items():
        entry = found["groups"][group]["values"].get("coverage_dice")
        dice = f" overlap {number(entry['value'])}" if entry else ""
        drawn = charts.coverage(rows, maps["rows"][TRUTH], maps["levels"], worn[group], crop)
        parts.append(f'<figure class="map"><figcaption>{_swatch(group, found)}{dice}</figcaption>{drawn}</figure>')
    return "".join(parts)


def _styles(found: Mapping[str, Any]) -> str:
    """Per style and group how many clips are recognised, and what the others are taken for."""
    groups = found["groups"]
    shown = sorted({clip["style"] for group in groups.values() for clip in group["each"] if "recognised_as" in clip})
    if not shown:
        return '<p class="quiet">Styles could not be recognised; the reason stands under “Left out”.</p>'
    head = "".join(f'<th scope="col" class="figure">{_swatch(group, found)}</th>' for group in groups)
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


def _left_out(found: Mapping[str, Any]) -> str:
    """Notes, then what could not be measured: equal reasons of several clips once."""
    notes = "".join(f"<li>{escape(note)}</li>" for note in found.get("notes", []))
    reasons: dict[tuple[str, str, str], list[str]] = {}
    for item in found["left_out"]:
        reasons.setdefault((item["group"], item["measure"], item["reason"]), []).append(item["clip"])
    rows = "".join(
        f"<tr><td>{_swatch(group, found)}</td><td>{escape(measure.replace('_', ' '))}</td>"
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


def _provenance(found: Mapping[str, Any]) -> str:
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
