"""What a notebook shows in place: the player, a strip of poses, a table, and sliders that move what they stand above.

Nothing here imports the notebook's packages; only `Sliders` needs ipywidgets (the extra `notebook`), when it is made.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any

from zeggs_jax.motion.bvh import Clip
from zeggs_jax.stage import figures as drawn
from zeggs_jax.stage import player
from zeggs_jax.stage.drawing import Layout
from zeggs_jax.stage.player import Figure as Figure

FRAME = "width:100%;height:{height}px;border:0;border-radius:14px;display:block"
CELL = "padding:.2em .9em;text-align:{side};font-variant-numeric:tabular-nums"


class Shown:
    """HTML that a notebook displays as the result of a cell."""

    def __init__(self, content: str) -> None:
        self.html = content

    def _repr_html_(self) -> str:
        return self.html

    def __repr__(self) -> str:
        return f"<{len(self.html):,} characters of HTML, for a notebook>"


def show(figures: Sequence[Figure], height: int = 420, title: str = "Gestures", playing: bool = False) -> Shown:
    """The player's page in a frame of `height` pixels: figures side by side, with their speech.

    It stays in the notebook when that is saved, and asks the network for nothing. `playing` starts it at once and
    repeats it. Raises what `player.write` raises for the same figures.
    """
    page = player.page(title, {**player.scene(figures), "playing": playing})
    style = FRAME.format(height=height)
    source = html.escape(page, quote=True)
    return Shown(f'<iframe srcdoc="{source}" style="{style}" title="{html.escape(title)}" allow="autoplay"></iframe>')


def poses(
    clips: Sequence[Clip], labels: Sequence[str] = (), times: Sequence[float] = (), count: int = 7, height: int = 150
) -> Shown:
    """A grid of poses (see `figures.pose_strip`): a row of `height` pixels for each clip, a column for each time."""
    drawn.check(clips, labels, times)
    layout = Layout(height=height, width=round(0.65 * height))
    return Shown(drawn.strip(clips, labels, times, count, layout))


def table(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> Shown:
    """Rows of text and numbers under named columns; four digits of numbers. ValueError for a row of another length."""
    for row in rows:
        if len(row) != len(columns):
            raise ValueError(f"a row of {len(row)} values does not fit the {len(columns)} columns {list(columns)}.")
    head = "".join(_cell("th", name, rows[0][k] if rows else name) for k, name in enumerate(columns))
    body = "".join("<tr>" + "".join(_cell("td", value, value) for value in row) + "</tr>" for row in rows)
    return Shown(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")


def _cell(tag: str, value: Any, like: Any) -> str:
    side = "left" if isinstance(like, str) else "right"
    text = html.escape(value if isinstance(value, str) else f"{value:,}" if isinstance(value, int) else f"{value:.4g}")
    return f'<{tag} style="{CELL.format(side=side)}">{text}</{tag}>'


class Sliders:
    """Sliders, and below them what `draw` makes of their values: anew whenever one is let go, or `set` by code.

    `draw` gets {key: value} of all of them. `screen` is the widget below, whose `value` is the HTML on show.
    """

    def __init__(
        self,
        keys: Sequence[Hashable],
        draw: Callable[[dict[Any, float]], Shown],
        label: str = "component {}",
        reach: float = 3.0,
    ) -> None:
        import ipywidgets

        self.draw, self.screen = draw, ipywidgets.HTML()
        self.knobs = {
            key: ipywidgets.FloatSlider(
                0.0, min=-reach, max=reach, step=0.1, description=label.format(key), continuous_update=False,
                readout_format="+.1f", style={"description_width": "9em"}, layout={"width": "32em"},
            )
            for key in keys
        }  # fmt: skip
        self.widget = ipywidgets.VBox([*self.knobs.values(), self.screen])
        self._listen(True)
        self._redraw()

    @property
    def values(self) -> dict[Any, float]:
        """Where the sliders stand."""
        return {key: knob.value for key, knob in self.knobs.items()}

    def set(self, values: Mapping[Any, float]) -> None:
        """Moves some of the sliders, as by hand, and draws once; KeyError for a slider that is not there."""
        self._listen(False)
        try:
            for key, value in values.items():
                self.knobs[key].value = value
        finally:
            self._listen(True)
        self._redraw()

    def _listen(self, on: bool) -> None:
        for knob in self.knobs.values():
            (knob.observe if on else knob.unobserve)(self._redraw, names="value")

    def _redraw(self, change: Any = None) -> None:
        self.screen.value = self.draw(self.values).html

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        return self.widget._repr_mimebundle_(**kwargs)
