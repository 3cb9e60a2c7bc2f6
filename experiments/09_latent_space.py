"""The style space and its components: scatter, root speed along PC1, hands along PC2 (ZeroEGGS Fig. 8, Sec. 5.2.2).

    python experiments/09_latent_space.py -o runs/latent_space [--checkpoint RUN --library lib.npz]

The paper reads its first component as the velocity of the root and its second as the height of the hands, by eye. Here
each of the first four is moved from -2 to +2 standard deviations from the library's mean, nine steps, every speech, one
first pose; of what the body then does, every gauge (gauges.py) and every known factor is ranked against the steps.
A rank correlation says nothing of the size of a change, so the change stands beside it.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import gauges
import instrument as ins
import ledger
from zeggs_jax.metrics import movement
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.stage import plots, poses
from zeggs_jax.stage.drawing import Layout
from zeggs_jax.stage.player import COLOURS
from zeggs_jax.zeroeggs import library, style_space

NAME = "09_latent_space"
STEPS = tuple(np.linspace(-2.0, 2.0, 9).tolist())
SHOWN = (0, 2, 4, 6, 8)  # of the steps, in the figure
COMPONENTS = 4


def main() -> None:
    args = ins.parser(__doc__).parse_args()
    played = ins.tune(args)
    points = library.points(played.library)
    components = style_space.principal(points)
    count = min(COMPONENTS, len(components.std))
    tables, clips = [], []
    for number in range(1, count + 1):
        ways = [style_space.move(components, components.mean, {number: step}) for step in STEPS]
        rows, made = ins.sweep(played, ways, f"PC{number}")
        tables.append(rows)
        clips.append(made)
    found = [ins.rank_correlations(STEPS, rows) for rows in tables]
    share = np.asarray(components.share, float).tolist()
    ledger.tell(report(found, tables, share), NAME, args.docs)
    ledger.save(
        args.out / "latent_space.json",
        {"steps": STEPS, "share": share, "rank_correlation": found, "measures": tables, "clips": len(points)},
    )
    places = np.asarray((points - components.mean) @ components.axes[:2].T / components.std[:2])
    labels = [entry.style for entry in played.library.entries]
    draw(args.out / "latent_space.png", places, labels, share, clips, found, tables)


def report(found: Sequence[dict[str, float]], tables: Sequence[list[dict[str, float]]], share: list[float]) -> str:
    """The table for docs/RESULTS.md."""
    head = ["from -2 to +2 standard deviations", *(f"PC{k + 1} ({100 * share[k]:.0f} %)" for k in range(len(found)))]
    body = []
    for name in found[0]:
        cells = [f"{rho[name]:+.2f} ({rows[0][name]:.3g} .. {rows[-1][name]:.3g})"
                 for rho, rows in zip(found, tables, strict=True)]  # fmt: skip
        body.append([name, *cells])
    lines = [ledger.table(head, body), ""]
    for k, rho in enumerate(found):
        best = strongest(rho, tables[k])
        lines.append(f"- PC{k + 1} moves most of all gauges: {best}, rank correlation {rho[best]:+.2f}")
    return "\n".join(lines)


def strongest(rho: dict[str, float], rows: list[dict[str, float]]) -> str:
    """The gauge with the largest rank correlation; of equal ones that which changes most against its size."""
    names = [name for name in rho if not name.startswith("factor")]
    change = {name: abs(rows[-1][name] - rows[0][name]) / (abs(rows[len(rows) // 2][name]) + 1e-9) for name in names}
    return max(names, key=lambda name: (round(abs(rho[name]), 2), change[name]))


def draw(
    path: Path,
    places: np.ndarray,
    labels: list[str],
    share: list[float],
    clips: list[list[list[Clip]]],
    found: list[dict[str, float]],
    tables: list[list[dict[str, float]]],
) -> None:
    """The figure: (a) the space, (b) root speed along PC1, (c) hands along PC2, (d) bodies, (e) rank correlations."""
    with plots.sheet(path, plots.PAGE, 5.7) as figure:
        grid = figure.add_gridspec(2, 12, height_ratios=(1.0, 0.95))
        space = figure.add_subplot(grid[0, :5])
        space.set_title("(a) styles of the library")
        plots.scatter(space, places, labels, share[:2])
        speeds = figure.add_subplot(grid[0, 5:8])
        speeds.set_title("(b) root speed along PC1")
        samples = [np.concatenate([gauges.read(c, ins.SETTLE)["root speed"].curve for c in clips[0][k]]) for k in SHOWN]
        plots.ridges(speeds, samples, [_signed(STEPS[k]) for k in SHOWN], "root speed, cm/s")
        speeds.set_ylabel("PC1, standard deviations")
        hands = figure.add_subplot(grid[0, 8:])
        hands.set_title("(c) hands along PC2")
        draw_hands(hands, [clips[1][k][0] for k in (0, 4, 8)], [STEPS[k] for k in (0, 4, 8)])
        draw_bodies(figure.add_subplot(grid[1, :8]), clips)
        table = figure.add_subplot(grid[1, 8:])
        table.set_title("(e) rank correlations", pad=14)
        names = list(found[0])
        values = np.array([[rho[name] for rho in found] for name in names])
        change = np.array([[abs(rows[-1][name] - rows[0][name]) for rows in tables] for name in names])
        fade = np.sqrt(change / (change.max(axis=1, keepdims=True) + 1e-12))
        plots.heat(table, values, [n.removeprefix("factor: ").replace("_", " ") for n in names],
                   [f"PC{k + 1}" for k in range(len(found))], fade)  # fmt: skip
        gauged = sum(not name.startswith("factor") for name in names)
        if gauged < len(names):
            table.axhline(gauged - 0.5, color=plots.INK, linewidth=0.8)
            for label in table.get_yticklabels()[gauged:]:  # the factors
                label.set_fontstyle("italic")


def draw_bodies(axes, clips: list[list[list[Clip]]]) -> None:
    """One body for each step of PC1, and below of PC2, in the frame nearest to the clip's mean pose."""
    layout = Layout(width=150)
    axes.set_title("(d) bodies along PC1 and PC2")
    poses.bare(axes, len(SHOWN), 2, layout)
    axes.set_ylim(2 * layout.height + 14, 25)
    for row in range(2):
        for column, k in enumerate(SHOWN):
            clip = clips[row][k][0]
            poses.line_up(axes, clip, [ins.typical(clip)], COLOURS[row + 1], layout, row, column)
            place = ((column + 0.5) * layout.width, (row + 1.01) * layout.height)
            name = f"PC{row + 1} {_signed(STEPS[k])}" if STEPS[k] else "mean"
            axes.text(*place, name, ha="center", va="center", fontsize=6)


def draw_hands(axes, clips: list[Clip], steps: list[float]) -> None:
    """Paths of both hands seen from the front, in cm from between the shoulders, over the mean upper body."""
    colours = plots.ramp(len(clips))
    for clip, colour, step in zip(clips, colours, steps, strict=True):
        motion = movement.of(clip)
        body = movement.in_heading(motion).positions[round(ins.SETTLE * motion.rate_hz) :]
        skeleton = motion.skeleton
        arms = [skeleton.path(skeleton.role(hand)) for hand in ("left_hand", "right_hand")]
        centre = body[:, [arm[-3] for arm in arms]].mean(axis=(0, 1))
        head = skeleton.path(skeleton.role("head"))
        if step == steps[len(steps) // 2]:
            for chain in (head, *(arm[-4:] for arm in arms)):
                mean = body[:, chain].mean(axis=0) - centre
                axes.plot(mean[:, 0], mean[:, 1], color=plots.PALE, linewidth=5, zorder=0)
            crown = body[:, head[-1]].mean(axis=0) - centre
            axes.plot(crown[0], crown[1] + 8, "o", color=plots.PALE, markersize=15, zorder=0)
        for number, arm in enumerate(arms):
            path = body[:, arm[-1]] - centre
            axes.plot(path[:, 0], path[:, 1], color=colour, linewidth=0.6, alpha=0.85,
                      label=None if number else _signed(step))  # fmt: skip
    axes.set(xlabel="to its left, cm", ylabel="height above the shoulders, cm", aspect="equal")
    axes.set_aspect("equal", adjustable="datalim")
    legend = axes.legend(title="PC2", loc="upper right", handlelength=1.0, borderaxespad=0.0)
    for line in legend.get_lines():
        line.set_linewidth(1.6)


def _signed(value: float) -> str:
    return f"{value:+g}".replace("-", "\u2212") if value else "0"


if __name__ == "__main__":
    main()
