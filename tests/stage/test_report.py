"""The page of an evaluation: whole, offline, safe from what names hold, drawings that say what the figures say."""

import json
import re
from html.parser import HTMLParser

import pytest

from zeggs_jax.stage import charts, legend, player, report
from zeggs_jax.stage.player import Figure
from zeggs_jax.stage.report import Scene

NASTY = '</script><script>alert("x")</script>&'
ROWS = ("truth", "ours", NASTY)


def cell(value, low=None, high=None, clips=3):
    return {"value": value, "low": low, "high": high, "clips": clips}


def group(values, styles=("old", "sad", "old")):
    each = [
        {"name": f"c{k}", "speech": f"c{k}", "style": s, "values": {}, "recognised_as": "old"}
        for k, s in enumerate(styles)
    ]
    return {"clips": 3, "seconds": 30.0, "values": values, "each": each}


@pytest.fixture
def found():
    grid = ["000", "090", "099"]
    return {
        "settings": {"level": 0.95, "draws": 100, "seed": 0, "rate_hz": 30.0, "joints": 75, "feature_net": None},
        "measures": {
            "jerk": {"unit": "cm/s^3", "better": "as the truth", "text": "mean jerk", "ideal": None},
            "ape": {"unit": "cm", "better": "low", "text": "error", "ideal": None},
        },
        "groups": {
            "truth": group({"jerk": cell(1000.0, 900.0, 1100.0)}),
            "ours": group({"jerk": cell(1200.0, 1150.0, 1300.0), "ape": cell(4.0)}),
            NASTY: group({"jerk": cell(12345.6, 12000.0, 13000.0), "ape": cell(9.0, 8.0, 10.0, 2)}),
        },
        "best": {"jerk": ["ours"], "ape": ["ours"]},
        "left_out": [{"group": "ours", "clip": f"c{k}", "measure": "skate", "reason": "no <feet>."} for k in range(6)],
        "notes": ["mind <this>."],
        "provenance": {"zeggs_jax": "1", "models": {"ours": "abc"}},
        "histograms": {"speed": {"edges": [0.0, 1.0, 2.0], "shares": {key: [0.5, 0.3, 0.2] for key in ROWS}}},
        "maps": {"cell_cm": 2.0, "side_cm": 6.0, "levels": 9, "rows": dict.fromkeys(ROWS, grid)},
    }  # fmt: skip


class Seen(HTMLParser):
    """Tags, attributes and texts of a page, and whether every tag is closed."""

    VOID = ("meta", "link", "br", "input", "line", "rect", "circle")

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.texts, self.attributes = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


@pytest.fixture(scope="module")
def scene(clip, speech):
    return player.scene([Figure("truth", clip, speech, legend.SLATE), Figure("ours", clip, speech, "#c4674a")])


@pytest.fixture
def page(found, scene):
    return report.page(found, [Scene(f"c0 {NASTY}", scene, ["truth", f"{NASTY} APE 4 cm"])], f"Test {NASTY}")


def test_it_is_one_whole_file_that_asks_for_nothing(page):
    seen = Seen(page)
    assert not seen.open
    assert not re.search(r"\{\{\w+\}\}", page)
    outside = [v for k, v in seen.attributes if k in ("src", "href") and not v.startswith(("#", "data:"))]
    assert not outside
    assert "default-src 'none'" in page
    assert "https://" not in page.replace("http://www.w3.org", "")


def test_names_cannot_break_out_of_it(page):
    assert "<script>alert" not in page
    seen = Seen(page)
    assert seen.tags.count("script") == 3  # the player's page, one scene, the script
    assert any(NASTY in text for text in seen.texts)


def test_the_player_takes_the_scenes_place(page):
    """What the script does when a clip is chosen."""
    frame = json.loads(re.search(r'id="frame">(.*?)</script>', page)[1])
    hole = '<script type="application/json" id="scene">{}</script>'
    assert frame.count(hole) == 1
    assert hole.split("{}")[0] in (report.resources.files("zeggs_jax.stage") / "page" / "report.js").read_text()
    scene = json.loads(re.search(r'id="scene0">(.*?)</script>', page)[1])
    assert [figure["colour"] for figure in scene["figures"]] == [legend.SLATE, "#c4674a"]
    assert [figure["track"] for figure in scene["figures"]] == [0, 0]


def test_the_table_says_what_was_found(page):
    assert page.count('class="figure best"') == 2
    assert "<b>12\u202f346</b><small>12\u202f000 … 13\u202f000</small>" in page
    assert "<small>of 2</small>" in page
    assert "taken for old 1" in page
    assert "c0, c1, c2, c3 and 2 more" in page
    assert "mind &lt;this&gt;." in page


def test_without_partners_pictures_or_styles_there_is_still_a_page(found):
    for name in ("histograms", "maps"):
        del found[name]
    for row in found["groups"].values():
        row["each"] = []
    text = report.page(found | {"left_out": [], "notes": []}, [], "Bare")
    assert not Seen(text).open
    assert "nothing to play" in text
    assert "every measure was taken" in text


def test_groups_wear_colours_of_their_own():
    worn = legend.colours(["truth", "a", "b"])
    assert len(set(worn.values())) == 3


def places(drawn):
    return [float(x) for x in re.findall(r'cx="([\d.]+)"', drawn)]


def test_dots_stand_in_the_order_of_values_whatever_the_unit():
    cells = {"truth": cell(5.0, 4.0, 6.0), "a": cell(1.0, 0.5, 2.0), "b": cell(9.0), "c": cell(4.0)}
    worn = legend.colours(list(cells))
    a, b, c = places(charts.interval(cells, "truth", worn))
    assert a < c < b
    larger = {n: {k: v and (v * 100.0 if k != "clips" else v) for k, v in entry.items()} for n, entry in cells.items()}
    assert places(charts.interval(larger, "truth", worn)) == [a, b, c]


def test_one_value_alone_has_a_place():
    (x,) = places(charts.interval({"a": cell(0.0)}, "truth", {"a": "#000000"}))
    assert x == 120.0


def test_a_map_covers_what_its_digits_say():
    drawn = charts.coverage(["090", "090", "000"], ["000", "090", "000"], 9, "#000000", (0, 3))
    assert "M1 1h1v1h-1z" in drawn
    assert "M1 2h1v1h-1z" in drawn
    edge = re.search(r'class="edge" d="([^"]*)"', drawn)[1]
    assert sorted(edge.split("M")[1:]) == sorted(["1 1h1", "1 2h1", "1 1v1", "2 1v1"])


TEXTS = {
    0: "0",
    None: "",
    1234.5: "1\u202f234",
    0.0123: "0.012",
    3e-5: "3e-5",
    0.5: "0.5",
    12.345: "12.3",
    -0.2: "-0.2",
}


@pytest.mark.parametrize(("value", "text"), TEXTS.items())
def test_numbers_have_three_digits(value, text):
    assert charts.number(value) == text


def test_ticks_are_round_and_inside():
    assert charts.ticks(43.0) == pytest.approx([0, 10, 20, 30, 40])
    assert charts.ticks(0.9) == pytest.approx([0, 0.2, 0.4, 0.6, 0.8])
