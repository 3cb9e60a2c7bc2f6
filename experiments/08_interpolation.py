"""Between two styles: bodies, posture and hand height in nine steps (ZeroEGGS Fig. 7, Sec. 5.2.1).

    python experiments/08_interpolation.py -o runs/interpolation [--style-a old --style-b oration]
    python experiments/08_interpolation.py -o runs/interpolation --checkpoint RUN --library lib.npz \\
        --style-a OLD.bvh --style-b ORATION.bvh

Both embeddings are means; all steps hear the same speech and start from the same pose, the neutral style's, so that
what differs comes from the embedding alone. What the bodies do is read off directly (gauges.py) and, where they are
known, as factors, and ranked against the steps. Diamonds show the same with the first poses of both styles mixed as the
embeddings are; a dashed line the way between what both example clips show, where those are at hand.
"""

from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

import gauges
import instrument as ins
import ledger
from zeggs_jax.metrics import rhythm
from zeggs_jax.motion import bvh
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.features import Motion
from zeggs_jax.stage import plots, poses
from zeggs_jax.stage.drawing import Layout
from zeggs_jax.zeroeggs import style_space

Row = dict[str, float]
Colour = tuple[float, float, float]
NAME = "08_interpolation"
STEPS = 9
CURVES = ("lean", "hand height")


class Way(NamedTuple):
    """The steps from one style to the other."""

    names: list[str]
    clips: list[Clip]  # of the first speech, all from one first pose
    rows: list[Row]  # measures over all speeches
    mixed: list[Row]  # of the first speech, from first poses mixed as the embeddings are
    examples: list[Row]  # gauges of both example clips, empty where they are not at hand


def main() -> None:
    parser = ins.parser(__doc__)
    parser.add_argument("--style-a", default="old", help="a name of the library or a clip")
    parser.add_argument("--style-b", default="oration")
    args = parser.parse_args()
    way = walk(ins.tune(args), [args.style_a, args.style_b])
    found, with_pose = (ins.rank_correlations(range(STEPS), rows) for rows in (way.rows, way.mixed))
    body = [
        [name, *(f"{row[name]:.3g}" for row in way.rows[:: STEPS // 2]), f"{rho:+.2f}",
         f"{way.mixed[0][name]:.3g} .. {way.mixed[-1][name]:.3g}", f"{with_pose[name]:+.2f}"]
        for name, rho in found.items()
    ]  # fmt: skip
    first, last = way.names
    head = [first, "half way", last, "rank correlation", "first pose mixed too", "rank correlation"]
    told = [ledger.table([f"from {first} to {last}", *head], body), ""]
    for what, of in (("one first pose", found), ("first pose mixed too", with_pose)):
        gauged = sum(abs(rho) >= 0.95 for name, rho in of.items() if not name.startswith("factor"))
        known = sum(abs(rho) >= 0.95 for name, rho in of.items() if name.startswith("factor"))
        told.append(f"- {what}: rank correlation of 0.95 and more for {gauged} gauges and {known} factors")
    ledger.tell("\n".join(told), NAME, args.docs)
    measures = way._asdict() | {"clips": None, "rank_correlation": found, "rank_correlation_mixed": with_pose}
    ledger.save(args.out / "interpolation.json", measures)
    draw(args.out / "interpolation.png", way)


def walk(played: ins.Instrument, styles: list[str]) -> Way:
    """All that is made and measured between two styles."""
    ends = [ins.style(played, name) for name in styles]
    steps = list(style_space.line(ends[0].distribution.mean, ends[1].distribution.mean, STEPS))
    rows, clips = ins.sweep(played, steps)
    starts = mixed(ends[0].start, ends[1].start)
    other = [ins.measure(played, [ins.play(played, z, start=start)]) for z, start in zip(steps, starts, strict=True)]
    at_hand = [ins.example(name) for name in styles]
    examples = [gauges.means(bvh.read(clip)) if clip else {} for clip in at_hand]
    return Way([Path(name).stem for name in styles], [made[0] for made in clips], rows, other, examples)


def mixed(first: Motion | None, last: Motion | None) -> list[Motion | None]:
    """First poses on the way from one to the other, as many as steps; none where a style has no pose."""
    if first is None or last is None:
        return [None] * STEPS
    return [jax.tree.map(lambda a, b, w=w: (1.0 - w) * a + w * b, first, last) for w in np.linspace(0.0, 1.0, STEPS)]


def draw(path: Path, way: Way) -> None:
    """Bodies above, posture and hand height over time below, their means over the steps to the right."""
    colours, layout, names = plots.ramp(STEPS), Layout(width=116), way.names
    with plots.sheet(path, plots.PAGE, 4.5) as figure:
        grid = figure.add_gridspec(3, 4, height_ratios=(1.25, 1.0, 1.0))
        strip = figure.add_subplot(grid[0, :])
        strip.set_title(f"(a) from {names[0]} to {names[1]}, one speech")
        poses.bare(strip, STEPS, 1, layout)
        strip.set_ylim(layout.height + 16, 20)
        for k, clip in enumerate(way.clips):
            tone = "#" + "".join(f"{round(255 * c):02x}" for c in colours[k])
            poses.line_up(strip, clip, [ins.typical(clip)], tone, layout, column=k)
            end = {0: names[0], STEPS - 1: names[1]}.get(k, f"{k / (STEPS - 1):.3g}")
            strip.text((k + 0.5) * layout.width, 1.03 * layout.height, end, ha="center", va="center", fontsize=6.5)
        for number, name in enumerate(CURVES):
            over_time = figure.add_subplot(grid[number + 1, :3])
            over_steps = figure.add_subplot(grid[number + 1, 3])
            draw_curves(over_time, name, way.clips, colours)
            draw_means(over_steps, name, way, colours)
            over_time.set_title(f"({'bd'[number]}) {name} over time")
            over_steps.set_title(f"({'ce'[number]}) its mean")
            if not number:
                signs = over_steps.get_legend_handles_labels()
                strip.legend(*signs, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 0.98))
            over_time.set_xlabel("time, s" if number else "")
            over_steps.set_xlabel(f"share of {names[1]}" if number else "")


def draw_curves(axes, name: str, clips: list[Clip], colours: list[Colour]) -> None:
    """One gauge of every step over time, smoothed by a fifth of a second."""
    gauge = None
    for clip, colour in zip(clips, colours, strict=True):
        gauge = gauges.read(clip)[name]
        curve = rhythm.smooth(gauge.curve, 1.0 / clip.frame_time)
        axes.plot(np.arange(len(curve)) * clip.frame_time, curve, color=colour, linewidth=0.9)
    end = len(clips[0].euler) * clips[0].frame_time
    axes.axvspan(0, ins.SETTLE, color=plots.PALE, alpha=0.6, linewidth=0, zorder=0)
    axes.set(xlim=(0, end), ylabel=f"{name}, {gauge.unit}" if gauge else "")


def draw_means(axes, name: str, way: Way, colours: list[Colour]) -> None:
    """The mean of a gauge for each step, from one first pose and from mixed ones; dashed, between the examples."""
    at, values = np.linspace(0.0, 1.0, STEPS), [row[name] for row in way.rows]
    if all(way.examples):
        ends = [gauge[name] for gauge in way.examples]
        axes.plot([0, 1], ends, "--", color=plots.SOFT, linewidth=0.8, label="(c, e)  examples")
    axes.plot(at, values, color=plots.SOFT, linewidth=0.7, zorder=2)
    axes.scatter(at, values, c=colours, s=16, label="one first pose", zorder=3)
    axes.scatter(at, [row[name] for row in way.mixed], s=13, marker="D", facecolors="white", edgecolors=colours,
                 linewidths=0.9, label="first pose mixed too", zorder=2)  # fmt: skip


if __name__ == "__main__":
    main()
