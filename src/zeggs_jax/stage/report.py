"""The page of an evaluation: tables, drawings and players in one file that asks the network for nothing."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from zeggs_jax.stage import charts, player, tables
from zeggs_jax.stage.charts import number
from zeggs_jax.stage.legend import TRUTH, colours, swatch


class Scene(NamedTuple):
    """One speech on the page: the recorded body and the made ones beside it."""

    label: str
    scene: Mapping[str, Any]  # of `player.scene`
    notes: Sequence[str]  # one line for each figure


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
        "table": tables.table(found),
        "histograms": _histograms(found),
        "maps": _maps(found),
        "styles": tables.styles(found),
        "left_out": tables.left_out(found),
        "provenance": tables.provenance(found),
        "frame": data("frame", player.page("Truth beside generated", {})),
        "scenes": "".join(data(f"scene{k}", item.scene) for k, item in enumerate(scenes)),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda hole: fill[hole[1]], (folder / "report.html").read_text("utf-8"))


def data(name: str, value: Any) -> str:
    """Data that the page's script reads."""
    text = json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")
    return f'<script type="application/json" id="{name}">{text}</script>\n'


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
    return "".join(f"<span>{swatch(group, found)}</span>" for group in found["groups"])


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


def _histograms(found: Mapping[str, Any]) -> str:
    units = {"speed": "cm/s", "acceleration": "cm/s²", "jerk": "cm/s³"}
    worn, parts = colours(list(found["groups"])), []
    for name, item in found.get("histograms", {}).items():
        apart = [
            f"<li>{swatch(group, found)} {number(entry['value'])}</li>"
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
        parts.append(f'<figure class="map"><figcaption>{swatch(group, found)}{dice}</figcaption>{drawn}</figure>')
    return "".join(parts)
