"""Between two styles: bodies, posture and hand height in nine steps (ZeroEGGS Fig. 7, Sec. 5.2.1).

    python experiments/08_interpolation.py -o runs/interpolation [--style-a old --style-b oration]
    python experiments/08_interpolation.py -o runs/interpolation --checkpoint RUN --library lib.npz \\
        --style-a OLD.bvh --style-b ORATION.bvh

Both embeddings are means; all steps hear the same speech and start from the same pose, the neutral style's, so that
what differs comes from the embedding alone. What the bodies do is read off directly (gauges.py) and, where they are
known, as factors, and ranked against the steps. Diamonds show the same with the first poses of both styles mixed as the
embeddings are; a dashed line, where both styles are synthetic, the way between their true factors.
"""

from pathlib import Path

import jax
import numpy as np

import gauges
import instrument as ins
import ledger
from zeggs_jax.metrics import rhythm
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.features import Motion
from zeggs_jax.stage import plots, poses
from zeggs_jax.stage.drawing import Layout
from zeggs_jax.synthetic.styles import STYLES
from zeggs_jax.zeroeggs import style_space

Row, Colour = dict[str, float], tuple[float, float, float]
STEPS = 9
CURVES = ("lean", "hand height")
TRUE = {"lean": "lean", "hand height": "hand_height"}  # gauges that a factor stands behind, up to an offset


def main() -> None:
    parser = ins.parser(__doc__)
    parser.add_argument("--style-a", default="old", help="a name of the library or a clip")
    parser.add_argument("--style-b", default="oration")
    args = parser.parse_args()
    played = ins.tune(args)
    ends = [ins.style(played, name) for name in (args.style_a, args.style_b)]
    names = [Path(name).stem for name in (args.style_a, args.style_b)]
    way = style_space.line(ends[0].distribution.mean, ends[1].distribution.mean, STEPS)
    rows, clips = ins.sweep(played, list(way))
    starts = mixed(ends[0].start, ends[1].start)
    mixed_rows = [ins.measure(played, [ins.play(played, z, start=start)]) for z, start in zip(way, starts, strict=True)]
    found, with_pose = (ins.rank_correlations(range(STEPS), of) for of in (rows, mixed_rows))
    body = [
        [name, *(f"{row[name]:.3g}" for row in rows[:: STEPS // 2]), f"{rho:+.2f}",
         f"{mixed_rows[0][name]:.3g} .. {mixed_rows[-1][name]:.3g}", f"{with_pose[name]:+.2f}"]
        for name, rho in found.items()
    ]  # fmt: skip
    head = [names[0], "half way", names[1], "rank correlation", "first pose mixed too", "rank correlation"]
    print(ledger.table([f"from {names[0]} to {names[1]}", *head], body))
    steady = {kind: sum(abs(rho) >= 0.95 for name, rho in found.items() if name.startswith("factor") == known)
              for kind, known in (("gauges", False), ("factors", True))}  # fmt: skip
    print(f"rank correlation of 0.95 and more: {steady['gauges']} gauges, {steady['factors']} factors")
    with_mixed = {"rank_correlation": with_pose, "measures": mixed_rows}
    ledger.save(
        args.out / "interpolation.json",
        {
            "styles": names,
            "rank_correlation": found,
            "measures": rows,
            "steady": steady,
            "first_pose_mixed": with_mixed,
        },
    )
    draw(args.out / "interpolation.png", names, [made[0] for made in clips], rows, mixed_rows, played.ruler is not None)


def mixed(first: Motion | None, last: Motion | None) -> list[Motion | None]:
    """First poses on the way from one to the other, as many as steps; none where a style has no pose."""
    if first is None or last is None:
        return [None] * STEPS
    return [jax.tree.map(lambda a, b, w=w: (1.0 - w) * a + w * b, first, last) for w in np.linspace(0.0, 1.0, STEPS)]


def draw(path: Path, names: list[str], clips: list[Clip], rows: list[Row], mixed_rows: list[Row], known: bool) -> None:
    """Bodies above, posture and hand height over time below, their means over the steps to the right."""
    colours, layout = plots.ramp(STEPS), Layout(width=116)
    with plots.sheet(path, plots.PAGE, 4.5) as figure:
        grid = figure.add_gridspec(3, 4, height_ratios=(1.25, 1.0, 1.0))
        strip = figure.add_subplot(grid[0, :])
        strip.set_title(f"(a) from {names[0]} to {names[1]}, one speech")
        poses.bare(strip, STEPS, 1, layout)
        strip.set_ylim(layout.height + 16, 20)
        for k, clip in enumerate(clips):
            tone = "#" + "".join(f"{round(255 * c):02x}" for c in colours[k])
            poses.line_up(strip, clip, [ins.typical(clip)], tone, layout, column=k)
            end = {0: names[0], STEPS - 1: names[1]}.get(k, f"{k / (STEPS - 1):.3g}")
            strip.text((k + 0.5) * layout.width, 1.03 * layout.height, end, ha="center", va="center", fontsize=6.5)
        for number, name in enumerate(CURVES):
            over_time = figure.add_subplot(grid[number + 1, :3])
            over_steps = figure.add_subplot(grid[number + 1, 3])
            draw_curves(over_time, name, clips, colours)
            draw_means(over_steps, name, names, rows, mixed_rows, colours, known)
            over_time.set_title(f"({'bd'[number]}) {name} over time")
            over_steps.set_title(f"({'ce'[number]}) its mean")
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


def draw_means(
    axes, name: str, names: list[str], rows: list[Row], mixed_rows: list[Row], colours: list[Colour],
    known: bool,
) -> None:  # fmt: skip
    """The mean of a gauge for each step; the line between the true factors, moved and scaled to the ends, dashed."""
    at, values = np.linspace(0.0, 1.0, len(rows)), [row[name] for row in rows]
    if known and all(style in STYLES for style in names):
        first, last = (getattr(STYLES[style], TRUE[name]) for style in names)
        degrees = np.degrees if name == "lean" else float
        straight = np.array([degrees(first), degrees(last)])
        axes.plot([0, 1], straight - straight.mean() + np.mean([values[0], values[-1]]), "--", color=plots.SOFT,
                  linewidth=0.8, label="true factors", zorder=1)  # fmt: skip
    axes.plot(at, values, color=plots.SOFT, linewidth=0.7, zorder=2)
    axes.scatter(at, values, c=colours, s=16, zorder=3)
    axes.scatter(at, [row[name] for row in mixed_rows], s=13, marker="D", facecolors="white", edgecolors=colours,
                 linewidths=0.9, label="first pose mixed too", zorder=2)  # fmt: skip
    axes.legend(loc="best", handlelength=1.6)


if __name__ == "__main__":
    main()
