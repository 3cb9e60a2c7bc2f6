"""One self-contained page that shows a live stream: it talks to the server that it came from, and to nobody else."""

from __future__ import annotations

from collections.abc import Sequence

from zeggs_jax.motion.bvh import Clip
from zeggs_jax.stage import player

SCRIPTS = ("motion", "view", "webgl", "canvas", "live")


def page(clip: Clip, styles: Sequence[str], style: str, title: str = "Live gestures") -> str:
    """The page's text. It shows the first frame of `clip` until frames come, and offers `styles`; `style` is on."""
    figure = player.pack_figure(player.Figure("", clip, colour=player.COLOURS[0]), 1.0 / clip.frame_time)
    kept = ("parents", "offsets", "parts", "centre", "stature", "floor", "facing", "frameTime", "unit")
    scene = {name: figure[name] for name in kept} | {"colour": player.COLOURS[0]}
    scene["turns"] = player.rounded(player.continuous(clip)[0])
    scene["place"] = player.rounded(clip.positions[0, 0])
    return player.page(title, scene | {"styles": list(styles), "style": style}, "live", SCRIPTS)
