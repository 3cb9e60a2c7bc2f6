"""Styles never seen and speakers never heard, from one example each (strips as in ZeroEGGS Fig. 5 and 6, Sec. 5.1).

    python experiments/07_unseen_styles.py -o runs/unseen [--speech VOICE.wav ...]
    python experiments/07_unseen_styles.py -o runs/unseen --checkpoint RUN --library lib.npz --styles CLIP.bvh ...

Without --styles: oration, which no corpus shows to training, and points anywhere in the box of the synthetic factors.
Every style is made from its own clip and first pose. The strips show examples and what is made of them; the plots show
every example's gauges (gauges.py) against those of the made bodies, one colour for each speech. For errors in the
factors' own units, against baselines, see 03_generalisation.py.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy import stats
from tqdm import tqdm

import gauges
import instrument as ins
import ledger
import truth
from zeggs_jax.motion import bvh
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.stage import plots, poses
from zeggs_jax.stage.drawing import Layout
from zeggs_jax.stage.player import COLOURS
from zeggs_jax.synthetic import styles

Row = dict[str, float]
NAME = "07_unseen_styles"
POINTS = 9  # styles anywhere in the box
SECONDS = 8.0  # of an example
INSTANTS = tuple(np.linspace(2.0, 7.4, 7).tolist())
SHOWN = 2  # styles in the strips
UNITS = {"lean": "degrees", "hand height": "cm", "hands apart": "cm", "hand speed": "cm/s"}  # of what is plotted


def main() -> None:
    parser = ins.parser(__doc__)
    parser.add_argument("--styles", type=Path, nargs="+", default=[], help="clips of styles that training never saw")
    args = parser.parse_args()
    played = ins.tune(args)
    paths = args.styles or made_up(args.out / "examples")
    clips = {path.stem: bvh.read(path) for path in paths}
    made = {name: make(played, path) for name, path in zip(clips, tqdm(paths, desc="styles"), strict=True)}
    shown = {name: gauges.means(clip) for name, clip in clips.items()}
    found = {name: {voice: gauges.means(c, ins.SETTLE) for voice, c in of.items()} for name, of in made.items()}
    rows = agreement(shown, found)
    ledger.tell(ledger.table(["gauge", "speech", "rank correlation", "mean distance"], rows), NAME, args.docs)
    ledger.save(args.out / "unseen_styles.json", {"examples": shown, "made": found})
    draw(args.out / "unseen_styles.png", clips, made, shown, found)


def made_up(folder: Path) -> list[Path]:
    """Clips of the held-out style and of points anywhere."""
    draw = np.random.default_rng(truth.POINT_SEED)
    points = {name: styles.STYLES[name] for name in styles.HELD_OUT}
    points |= {f"unseen {chr(65 + k)}": truth.anywhere(draw) for k in range(POINTS)}
    seeds = range(truth.EXAMPLE_SEED, truth.EXAMPLE_SEED + len(points))
    return [truth.example(folder, name, points[name], SECONDS, seed) for name, seed in zip(points, seeds, strict=True)]


def make(played: ins.Instrument, path: Path) -> dict[str, Clip]:
    """Every speech in the style of a clip, from its first pose."""
    entry = ins.style(played, str(path))
    return {speech: ins.play(played, entry.distribution.mean, speech, entry.start) for speech in played.speeches}


def agreement(shown: Mapping[str, Row], found: Mapping[str, Mapping[str, Row]]) -> list[list[str]]:
    """Of every gauge and speech: rank correlation of made bodies with their examples, and how far they are apart."""
    rows = []
    for gauge in next(iter(shown.values())):
        for voice in next(iter(found.values())):
            there = np.array([shown[name][gauge] for name in shown])
            here = np.array([found[name][voice][gauge] for name in shown])
            rho = float(np.asarray(stats.spearmanr(there, here))[0]) if len(there) > 2 else float("nan")
            rows.append([gauge, voice, f"{rho:+.2f}", f"{np.abs(here - there).mean():.3g}"])
    return rows


def draw(path: Path, clips, made, shown, found) -> None:
    """Strips of the first styles, each example above what is made of it; below, gauges against gauges."""
    voices = list(next(iter(made.values())))
    height = 0.88 * (1 + len(voices[:2]))
    with plots.sheet(path, plots.PAGE, height + 2.0) as figure:
        grid = figure.add_gridspec(2, 1, height_ratios=(height, 1.8))
        strips, points = grid[0].subgridspec(1, SHOWN), grid[1].subgridspec(1, len(UNITS))
        for number, name in enumerate(list(clips)[:SHOWN]):
            axes = figure.add_subplot(strips[number])
            axes.set_title(f"({'abc'[number]}) {_plain(name)}")
            draw_strip(axes, clips[name], {voice: made[name][voice] for voice in voices[:2]})
        for column, gauge in enumerate(UNITS):
            axes = figure.add_subplot(points[column])
            against(axes, [shown[n][gauge] for n in clips], {v: [found[n][v][gauge] for n in clips] for v in voices})
            axes.set_title(f"({'abcdefgh'[SHOWN + column]}) {gauge}, {UNITS[gauge]}")
            axes.set(xlabel="of the example", ylabel="" if column else "of the made body")
            if not column:
                signs = axes.get_legend_handles_labels()
                figure.legend(*signs, title="speech", loc="outside lower center", ncols=len(voices), handlelength=0.8)


def draw_strip(axes, example: Clip, made: Mapping[str, Clip]) -> None:
    """A row of bodies for the example, and one for each speech below."""
    layout = Layout(width=128)
    rows = [("the example", "#7b828c", example)]
    rows += [
        (f"made, \u201c{voice}\u201d", colour, clip)
        for (voice, clip), colour in zip(made.items(), COLOURS, strict=False)
    ]
    poses.bare(axes, len(INSTANTS), len(rows), layout)
    for number, (title, tone, clip) in enumerate(rows):
        last = (len(clip.euler) - 1) * clip.frame_time
        poses.line_up(axes, clip, [min(t, last) for t in INSTANTS], tone, layout, number)
        axes.text(0.12 * layout.width, (number + 0.06) * layout.height, title, va="center", fontsize=6)


def against(axes, there: list[float], here: Mapping[str, list[float]]) -> None:
    """Made against example, one dot for each style; on the line they are alike."""
    every = [*there, *(value for values in here.values() for value in values)]
    ends = [min(every) - 0.06 * np.ptp(every), max(every) + 0.06 * np.ptp(every)]
    axes.plot(ends, ends, color=plots.PALE, linewidth=0.8, zorder=0)
    for (voice, values), colour in zip(here.items(), COLOURS, strict=False):
        axes.scatter(there, values, s=11, color=colour, edgecolors="white", linewidths=0.4, label=voice)
    axes.set(xlim=ends, ylim=ends, aspect="equal")
    axes.locator_params(nbins=4)


def _plain(name: str) -> str:
    """A clip's name without the seed and length that `truth.example` gives it."""
    return name.split("_")[0]


if __name__ == "__main__":
    main()
