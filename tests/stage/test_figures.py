"""The strip of poses: well-formed, one drawing for each clip and instant, clear about what it cannot draw."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from zeggs_jax.stage import drawing, figures, shapes

SVG = "{http://www.w3.org/2000/svg}"


def test_one_drawing_for_each_clip_and_time(tmp_path, clip):
    figures.pose_strip(tmp_path / "s.svg", [clip, clip], labels=["Old & <tired>", "Happy"], times=[0.0, 0.5, 2.0])
    root = ET.parse(tmp_path / "s.svg").getroot()
    assert root.tag == SVG + "svg"
    assert len(root.findall(SVG + "g")) == 6
    assert [text.text for text in root.findall(SVG + "text")] == ["Old & <tired>", "Happy"]
    known = {gradient.get("id") for gradient in root.iter(SVG + "linearGradient")}
    filled = {path.get("fill")[5:-1] for path in root.iter(SVG + "path") if path.get("fill").startswith("url")}
    assert filled == known


def test_a_strip_needs_no_label_and_picks_its_instants(tmp_path, clip):
    figures.pose_strip(tmp_path / "s.svg", clip, count=4)
    root = ET.parse(tmp_path / "s.svg").getroot()
    assert len(root.findall(SVG + "g")) == 4
    assert not root.findall(SVG + "text")
    assert (tmp_path / "s.svg").stat().st_size < 4 * 40_000


def test_the_figure_is_as_tall_as_its_row_allows(tmp_path, clip):
    used: set = set()
    (drawn,) = figures.row(clip, [0.0], "#c4674a", drawing.Layout(height=200), used)
    heights = [float(word.split(")")[0].split()[1]) for word in drawn.split("translate(")[1:]]
    assert -190 < min(heights) < -130
    assert max(heights) < 12


def test_the_camera_keeps_lengths_and_faces_the_character():
    view = drawing.camera(0.7, 0.2)
    np.testing.assert_allclose(view @ view.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(view) == pytest.approx(1.0)
    np.testing.assert_allclose(drawing.camera(0.0, 0.0), np.eye(3), atol=1e-12)  # +z looks at us, its left on our right


def test_paths_come_back_to_their_points():
    points = np.array([[0.0, 0.0], [3.26, 0.0], [3.26, -1.14], [0.0, 7.0]])
    text = figures.path_of(shapes.hull(points), 1)
    assert text.startswith("M")
    assert text.endswith("z")
    start, steps = text[1:-1].split("l")
    numbers = np.array([float(x) for x in (start + " " + steps).split()]).reshape(-1, 2)
    np.testing.assert_allclose(np.cumsum(numbers, axis=0), shapes.hull(points), atol=0.06)


def test_what_cannot_be_drawn_is_said(tmp_path, clip):
    with pytest.raises(ValueError, match="no clips"):
        figures.pose_strip(tmp_path / "s.svg", [])
    with pytest.raises(ValueError, match="2 labels for 1 clip"):
        figures.pose_strip(tmp_path / "s.svg", clip, labels=["a", "b"])
    with pytest.raises(ValueError, match="from 0 to 2"):
        figures.pose_strip(tmp_path / "s.svg", clip, times=[9.0])
    with pytest.raises(OSError, match="cannot be written"):
        figures.pose_strip(tmp_path / "none" / "s.svg", clip, times=[0.0])
