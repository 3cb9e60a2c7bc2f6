"""Plots: whole files of the kinds asked for, one dot for each clip, names in reach; bodies fill their pieces."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from zeggs_jax.stage import drawing, plots, poses

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def styled() -> tuple[np.ndarray, list[str]]:
    draw = np.random.default_rng(0)
    named = [np.array(at) + 0.1 * draw.normal(size=(5, 2)) for at in ((0.0, 0.0), (2.0, 1.0))]
    return np.concatenate([*named, draw.normal(size=(4, 2))]), ["old"] * 5 + ["happy"] * 5 + [f"r{k}" for k in range(4)]


def test_the_map_names_styles_and_marks_but_not_clips_that_are_alone(tmp_path, styled):
    points, labels = styled
    plots.space(tmp_path / "s.svg", points, labels, (0.5, 0.25), {"mine": (1.0, 0.5)})
    root = ET.parse(tmp_path / "s.svg").getroot()
    words = [text.text for text in root.iter(SVG + "text")]
    assert {"old", "happy", "mine"} <= set(words)
    assert not {"r0", "r1"} & set(words)
    assert any("50 % of variance" in (word or "") for word in words)


def test_a_picture_is_small_and_whole_and_the_same_every_time(tmp_path, styled):
    for name in ("a", "b"):
        plots.space(tmp_path / f"{name}.png", *styled)
    first = (tmp_path / "a.png").read_bytes()
    assert first.startswith(b"\x89PNG")
    assert first == (tmp_path / "b.png").read_bytes()
    assert len(first) < 200_000
    assert len(list(tmp_path.iterdir())) == 2


def test_what_cannot_be_drawn_is_said(tmp_path, styled):
    points, labels = styled
    with pytest.raises(ValueError, match=r"14 points and 3 labels"):
        plots.space(tmp_path / "s.png", points, labels[:3])
    with pytest.raises(ValueError, match="finite"):
        plots.space(tmp_path / "s.png", points * np.nan, labels)
    with pytest.raises(ValueError, match=r"ends in \.png"):
        plots.space(tmp_path / "s.jpg", points, labels)
    with pytest.raises(OSError, match="cannot be written"):
        plots.space(tmp_path / "none" / "s.svg", points, labels)
    assert not list(tmp_path.iterdir())


def test_a_cut_keeps_the_side_it_is_asked_for():
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    for level, side, area in ((0.5, 1.0, 3.0), (0.5, -1.0, 1.0), (0.0, 1.0, 4.0)):
        x, y = poses.cut(square, level, side).T
        assert abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0 == pytest.approx(area)


def test_bodies_stand_in_their_columns(tmp_path, clip):
    layout = drawing.Layout(height=100, width=80)
    with plots.sheet(tmp_path / "p.png", 2.0, 1.0) as figure:
        axes = figure.add_subplot()
        poses.bare(axes, 2, 1, layout)
        poses.line_up(axes, clip, [0.0, 1.0], "#c4674a", layout)
        corners = [np.concatenate([p.vertices for p in drawn.get_paths()]) for drawn in axes.collections]
    assert len(corners) == 2
    for column, points in enumerate(corners):
        assert abs(points[:, 0].mean() - (column + 0.5) * 80) < 20
        assert 85 < points[:, 1].max() < 105
