"""Rows of 15_diffuclip.py summed up as plain numbers, as tables in Markdown and as a figure."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import guided
import instrument
import ledger
import paired
import recognised
from zeggs_jax.stage import plots

Found = dict[str, Any]
MEASURES = (
    ("fgd", "FGD", "{:.2f}"), ("srgr", "SRGR", "{:.3f}"), ("sc", "SC", "{:.3f}"),
    ("right", "right gesture within 0.5 s", "{:.1%}"), ("right, trained words", "of trained words", "{:.1%}"),
    ("right, synonyms", "of held-out synonyms", "{:.1%}"), ("chance", "another would have counted", "{:.1%}"),
)  # fmt: skip


def summary(rows: Sequence[ledger.Row]) -> Found:
    """What the rows show, for JSON; parts that were not done are left out."""
    by = ledger.grouped(rows, "kind")
    ways: dict[str, Callable[[dict[str, list[ledger.Row]]], Found]] = {
        "codes": lambda of: {key: value for key, value in of["codes"][0].items() if key not in ("job", "kind")},
        "sra": recognition, "paired": performances, "guidance": guidance, "changes": changes, "halves": halves,
    }  # fmt: skip
    needs = {"sra": "judges", "changes": "true peaks", "paired": "instruments"}
    return {name: way(by) for name, way in ways.items() if name in by and needs.get(name, name) in by}


def spread(values: Sequence[float]) -> Found:
    """Mean and standard deviation over samplings."""
    return {"mean": float(np.mean(values)), "sd": float(np.std(values)), "count": len(values)}


def recognition(by: dict[str, list[ledger.Row]]) -> Found:
    """SRA of every kind of prompt, by sampling; what is recognised without one; what the judges are worth."""
    found: Found = {"judges": by["judges"][0]["judges"], "head": by["judges"][0]["head"], "kinds": {}}
    for kind, of in ledger.grouped(by["sra"], "prompt").items():
        right = [np.equal(row["made"], row["seen"]) for row in of]
        each = dict(zip(of[0]["made"], np.mean(right, axis=0).tolist(), strict=True))
        wrong = Counter((a, b) for row in of for a, b in zip(row["made"], row["seen"], strict=True) if a != b)
        taken = [f"{a} for {b} ({count})" for (a, b), count in wrong.most_common(3)]
        found["kinds"][kind] = {**spread([r.mean() for r in right]), "styles": each, "taken": taken}
    seen = Counter(name for row in by.get("unprompted", []) for name in row["seen"])
    return found | {"chance": 1.0 / len(by["sra"][0]["made"]), "no prompt": dict(seen.most_common())}


def performances(by: dict[str, list[ledger.Row]]) -> Found:
    """FGD, SRGR, SC and right gestures by condition."""
    row = by["instruments"][0]
    found: Found = {"accuracy": row["accuracy"], "alarms": row["alarms"], "net": row["net"], "conditions": {}}
    for condition, of in ledger.grouped(by["paired"], "condition").items():
        have = [name for name, *_ in MEASURES if name in of[0]]
        found["conditions"][condition] = {name: spread([row[name] for row in of]) for name in have}
        names = sorted(of[0]["meanings"])
        found["conditions"][condition] |= {
            "meanings": {name: float(np.mean([row["meanings"][name] for row in of])) for name in names},
            "words": of[0]["words"],
        }
    return found


def guidance(by: dict[str, list[ledger.Row]]) -> Found:
    """By style: its factor at every scale, and the rank correlation with the scale, 1 where it grows as it should."""
    found: Found = {}
    for style, of in ledger.grouped(by["guidance"], "style").items():
        read, sign = np.array([row["read"] for row in of]), of[0]["sign"]
        each = [sign * _rank(row) for row in read]
        found[style] = {
            "factor": of[0]["factor"], "sign": sign, "read": read.mean(axis=0).tolist(),
            "rank": sign * _rank(read.mean(axis=0)), "each": spread(each),
        }  # fmt: skip
    return found


def _rank(read: np.ndarray) -> float:
    return instrument.rank_correlations(guided.SCALES, [{"read": float(x)} for x in read])["read"]


def changes(by: dict[str, list[ledger.Row]]) -> Found:
    """By part of the body: peaks where the prompt changes, and where it does not, against the truth's."""
    found: Found = {}
    for part, peaks in by["true peaks"][0]["peaks"].items():
        p95 = float(np.percentile(peaks, 95))
        sides = {side: [x for row in by["changes"] for x in row[side][part]] for side in ("peaks", "steady")}
        found[part] = {"p95": p95, "median": float(np.median(peaks)), "changes": len(sides["peaks"])} | {
            side: {"within": float(np.mean(np.array(values) <= p95)), "median": float(np.median(values))}
            for side, values in sides.items() if values
        }  # fmt: skip
    return found


def halves(by: dict[str, list[ledger.Row]]) -> Found:
    """Shares of halves that are recognised as their own prompt, and as the other half's."""
    found: Found = {}
    for seam, of in ledger.grouped(by["halves"], "seam").items():
        pairs = [np.array([[row["asked"], row["seen"]] for row in one["rows"]]) for one in of]  # [pairs, 2, half]
        own = np.array([(p[:, 0] == p[:, 1]).mean(axis=0) for p in pairs])
        both = [(p[:, 0] == p[:, 1]).all(axis=1).mean() for p in pairs]
        other = np.array([(p[:, 0, ::-1] == p[:, 1]).mean(axis=0) for p in pairs])
        found[str(seam)] = {
            "upper": spread(own[:, 0].tolist()), "lower": spread(own[:, 1].tolist()), "both": spread(both),
            "upper as lower's": spread(other[:, 0].tolist()), "lower as upper's": spread(other[:, 1].tolist()),
        }  # fmt: skip
    return found


def tables(found: Found) -> str:
    """All that was found, as Markdown."""
    ways = {"codes": _codes, "sra": _sra, "paired": _paired, "guidance": _guidance, "changes": _changes}
    ways["halves"] = _halves
    return "\n\n".join(way(found[name]) for name, way in ways.items() if name in found)


def told(of: Found, form: str = "{:.1%}") -> str:
    """Mean and deviation; a single one without."""
    return form.format(of["mean"]) + (f" ± {form.format(of['sd'])}" if of["count"] > 1 else "")


def _codes(of: Found) -> str:
    errors = [[name.removesuffix("_cm"), f"{value:.2f} cm"] for name, value in of.items() if name.endswith("_cm")]
    names = [name.removesuffix("_perplexity") for name in of if name.endswith("_perplexity")]
    books = [[name, f"{of[f'{name}_perplexity']:.0f}", f"{of[f'{name}_used']:g}"] for name in names]
    sizes = ", ".join(f"{name} {size:,}" for name, size in of["parameters"].items())
    return (
        f"{ledger.table(['reconstruction of valid clips', 'mean distance'], errors)}\n\n"
        f"{ledger.table(['codebook', 'perplexity', 'codes in use'], books)}\n\nParameters: {sizes}."
    )


def _sra(of: Found) -> str:
    body = [[kind, told(row), "; ".join(row["taken"])] for kind, row in of["kinds"].items()]
    judge = of["judges"]["whole"]
    body += [["chance", f"{of['chance']:.1%}", ""], ["truth", f"{judge['own']:.1%}", ""]]
    seen = ", ".join(f"{name} {count}" for name, count in of["no prompt"].items())
    styles = len(judge["styles"])
    return (
        f"{ledger.table(['prompt', 'SRA', 'most often mistaken'], body)}\n\nSRA: {styles} styles, each asked for once "
        f"in every sampling, 10 s each; text prompts through the head '{of['head']}'. Truth: {judge['clips']} clips, "
        f"each by centroids made without it. Without a prompt motion is taken for: {seen}."
    )


def _paired(of: Found) -> str:
    body = [
        [name, *(told(row[key], form) if key in row else "" for key, _, form in MEASURES)]
        for name, row in of["conditions"].items()
    ]
    words = next(iter(of["conditions"].values()))["words"]
    head = ["", *(title for _, title, _ in MEASURES)]
    return (
        f"{ledger.table(head, body)}\n\n{words} words have gestures of their own. "
        f"The recogniser of meanings is right about {of['accuracy']:.1%} of such words of clips that it was not made "
        f"from, and takes {of['alarms']:.1%} of the others for one. The truth's FGD is that between halves of all "
        "valid clips, which no motion can be expected to fall far below; FGD's net: "
        f"{of['net']}; SRGR: share of elbows and hands within 10 cm of the truth's; SC only compares within one model."
    )


def _guidance(of: Found) -> str:
    body = [
        [style, f"{row['factor']} {'+' if row['sign'] > 0 else '-'}", *(f"{x:.3g}" for x in row["read"]),
         f"{row['rank']:+.2f}", told(row["each"], "{:.2f}")]
        for style, row in of.items()
    ]  # fmt: skip
    ranks = [row["rank"] for row in of.values()]
    head = ["prompt", "factor", *(f"s = {scale:g}" for scale in guided.SCALES), "rank correlation", "of each sampling"]
    high = sum(rank >= 0.9 for rank in ranks)
    return (
        f"{ledger.table(head, body)}\n\nRank correlation of 0.9 and more: {high} of {len(ranks)} styles, median "
        f"{np.median(ranks):.2f}."
    )


def _changes(of: Found) -> str:
    body = [
        [part, f"{row['p95']:,.0f} cm/s²", str(row["changes"]),
         *(text for side in ("peaks", "steady") if side in row
           for text in (f"{row[side]['within']:.0%}", f"{row[side]['median']:,.0f} cm/s²"))]
        for part, row in of.items()
    ]  # fmt: skip
    head = [
        "peak acceleration",
        "truth's 95th percentile",
        "changes",
        "within it",
        "median",
        "no change: within",
        "median",
    ]
    return ledger.table(head, body)


def _halves(of: Found) -> str:
    columns = ("upper", "lower", "both", "upper as lower's", "lower as upper's")
    names = {"own": "Eq. 19 to the letter", "0.0": "without its gradient (fast)"}
    body = [[names.get(seam, seam), *(told(row[c]) for c in columns)] for seam, row in of.items()]
    return ledger.table(["prompts for upper and lower body", *columns], body)


def draw(path: Path, found: Found) -> None:
    """Styles recognised by kind of prompt; the factor against the scale; right gestures by condition."""
    panels = [name for name in ("sra", "guidance", "paired") if name in found]
    if not panels:
        return
    with plots.sheet(path, plots.PAGE, 2.3) as figure:
        every = figure.subplots(1, len(panels), squeeze=False)[0]
        for letter, axes, name in zip("abc", every, panels, strict=False):
            {"sra": _draw_sra, "guidance": _draw_guidance, "paired": _draw_paired}[name](axes, letter, found[name])


def _draw_sra(axes: Any, letter: str, of: Found) -> None:
    rows = of["kinds"]
    _bars(axes, {_short(name): row for name, row in rows.items()})
    axes.axvline(of["judges"]["whole"]["own"], color=plots.SOFT, linestyle="--", linewidth=0.8)
    axes.axvline(of["chance"], color=plots.SOFT, linestyle=":", linewidth=0.8)
    axes.set(title=f"({letter}) style recognised", xlim=(0, 1.02), xlabel="share (dashes: truth, dots: chance)")


def _draw_paired(axes: Any, letter: str, of: Found) -> None:
    rows = {_short(name): row["right"] for name, row in of["conditions"].items()}
    _bars(axes, rows)
    axes.set(title=f"({letter}) right gesture", xlim=(0, 1.02), xlabel="share, within 0.5 s")


def _bars(axes: Any, rows: dict[str, Found]) -> None:
    colours = [plots.COLOURS[1] if "ZeroEGGS" in name else plots.COLOURS[0] for name in rows]
    axes.barh(range(len(rows)), [row["mean"] for row in rows.values()], color=colours, height=0.6,
              xerr=[row["sd"] for row in rows.values()], error_kw={"linewidth": 0.8, "ecolor": plots.INK})  # fmt: skip
    axes.set_yticks(range(len(rows)), list(rows))
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)


def _short(name: str) -> str:
    if name == recognised.BRIDGE:
        return "ZeroEGGS, text"
    known = {paired.SILENT: "no transcript", paired.TEXT: "text prompt", paired.MOTION: "motion prompt"}
    changes = {"text, ": "", "held-out ": "new ", "paraphrase, not": "one, not", ", motion prompt": ""}
    short = name
    for old, new in changes.items():
        short = short.replace(old, new)
    return known.get(name, short)


def _draw_guidance(axes: Any, letter: str, of: Found) -> None:
    for k, (style, row) in enumerate(of.items()):
        read = row["sign"] * np.array(row["read"])
        way = max(float(np.ptp(read)), 1e-9)
        line = {"color": plots.COLOURS[k % len(plots.COLOURS)], "linestyle": ("-", "--")[k // len(plots.COLOURS)]}
        axes.plot(guided.SCALES, (read - read[0]) / way, label=f"{style}: {row['factor']}", linewidth=0.9, **line)
    axes.set(title=f"({letter}) prompted factor", xlabel="guidance scale s", ylabel="change, of its range")
    axes.legend(fontsize=4.5, loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
