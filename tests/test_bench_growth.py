"""How cost grows: every axis is a panel of the figure and lines of the table, and the speeches measured are as told."""

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "experiments"))

import bench_growth
from zeggs_jax.zeroeggs.model import ZeroEggsConfig

ROWS = [
    {"axis": name, "value": value, "s": 0.01 * value, "MB": 700.0 + value, "before_MB": 700.0}
    for name, axis in bench_growth.AXES.items()
    for value in axis.values
]


def test_every_axis_has_its_panel_and_its_lines(tmp_path):
    bench_growth.draw(tmp_path / "growth.svg", ROWS)
    words = {text.text for text in ET.parse(tmp_path / "growth.svg").iter("{http://www.w3.org/2000/svg}text")}
    assert {axis.title for axis in bench_growth.AXES.values()} <= words
    assert {"3600", "128", "2048", "300"} <= words
    assert bench_growth.table(ROWS).count("\n") == len(ROWS) + 1


def test_what_is_told_has_the_length_that_is_asked_for_and_the_paper_s_widths():
    config = ZeroEggsConfig()
    told = bench_growth.told(130)
    assert told.spectrum.shape == (130, config.speech.features)
    assert told.style.shape == (130, config.style_size)
    assert np.ptp(told.style, axis=0).max() == 0.0
    np.testing.assert_array_equal(told.spectrum[60:120], told.spectrum[:60])
    assert len(bench_growth.still(300).pose.root_vel) == 300
