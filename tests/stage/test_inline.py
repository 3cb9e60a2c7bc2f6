"""What notebooks show: a page in a frame, grids of poses, tables, sliders that redraw once for every move."""

import html
import json
import re

import pytest

from zeggs_jax.stage import inline, player
from zeggs_jax.stage.inline import Figure


def scene_of(shown):
    """The scene of the page within the frame, as a browser would read it."""
    (source,) = re.findall(r'srcdoc="([^"]*)"', shown.html)
    (found,) = re.findall(r'<script type="application/json" id="scene">(.*?)</script>', html.unescape(source), re.S)
    return json.loads(found)


def test_a_frame_holds_the_whole_page_of_the_player(clip, tmp_path):
    figure = Figure('<b>"quoted" & bold</b>', clip)
    scene = scene_of(inline.show([figure]))
    assert scene == {**player.scene([figure]), "playing": False}
    assert scene["figures"][0]["label"] == figure.label
    assert scene_of(inline.show([figure], playing=True))["playing"]


def test_it_is_one_element_and_calls_for_nothing(clip):
    shown = inline.show([Figure("one", clip)], height=300, title='"><script>')
    assert shown._repr_html_() == shown.html
    assert shown.html.count("<iframe") == shown.html.count("</iframe>") == 1
    assert shown.html.count('"') == 2 * len(re.findall(r'\w="', shown.html))  # no quote ends an attribute early
    assert "height:300px" in shown.html
    assert not re.findall(r"https?://(?!www\.w3\.org)", shown.html)
    assert len(repr(shown)) < 80


def test_nobody_to_show_is_refused(clip):
    with pytest.raises(ValueError, match="no figures"):
        inline.show([])
    with pytest.raises(ValueError, match="1 labels for 2 clips"):
        inline.poses([clip, clip], labels=["one"])


def test_a_grid_has_a_row_for_each_clip_and_a_column_for_each_time(clip):
    drawn = inline.poses([clip, clip], labels=["a < b", "c"], times=[0.0, 0.5, 1.0], height=100).html
    assert 'height="200"' in drawn
    assert "a &lt; b" in drawn
    assert drawn.count("<g transform") == 6


def test_a_table_shows_what_it_is_given():
    shown = inline.table(["name & kind", "value"], [["<old>", 12345], ["new", 0.123456]]).html
    assert re.findall(r"<t[hd] [^>]*>([^<]*)<", shown) == [
        "name &amp; kind",
        "value",
        "&lt;old&gt;",
        "12,345",
        "new",
        "0.1235",
    ]
    assert "<tbody></tbody>" in inline.table(["nothing"], []).html
    with pytest.raises(ValueError, match="a row of 1 values does not fit the 2 columns"):
        inline.table(["a", "b"], [["only one"]])


def test_sliders_redraw_once_for_every_move():
    pytest.importorskip("ipywidgets")
    drawn = []

    def draw(values):
        drawn.append(values)
        return inline.Shown(str(values))

    panel = inline.Sliders([1, "two"], draw, label="number {}")
    assert drawn == [{1: 0.0, "two": 0.0}]
    panel.knobs[1].value = 2.0
    assert drawn[1:] == [{1: 2.0, "two": 0.0}]
    panel.set({1: -1.0, "two": 0.5})
    assert drawn[2:] == [{1: -1.0, "two": 0.5}]
    assert panel.screen.value == str(panel.values)
    assert panel.knobs["two"].description == "number two"
    with pytest.raises(KeyError):
        panel.set({3: 1.0})
    panel.knobs[1].value = 1.0
    assert drawn[-1] == {1: 1.0, "two": 0.5}  # still listening
