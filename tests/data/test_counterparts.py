"""Which recorded clip and style a made clip goes with, by name and by provenance."""

import pytest

from zeggs_jax.data import counterparts as c
from zeggs_jax.data.counterparts import Counterpart

NAMES = ["one", "one__two", "sad/long", "a/same", "b/same"]


@pytest.mark.parametrize(
    ("name", "truth", "style"),
    [
        ("one", "one", None),
        ("one__old", "one", "old"),
        ("one__old__2", "one", "old"),
        ("one__3", "one", None),
        ("one__two", "one__two", None),
        ("one__two__old", "one__two", "old"),
        ("sad/long", "sad/long", None),
        ("long__old", "sad/long", "old"),
        ("same", None, None),
        ("a/same", "a/same", None),
        ("ones", None, None),
        ("audio_one_label_old", "one", "old"),
        ("audio_long_label_a_label_b", None, None),
        ("", None, None),
    ],
)
def test_names(name, truth, style):
    assert c.of_name(name, NAMES) == Counterpart(truth, style)


@pytest.mark.parametrize("speech", ["one.wav", "/x/one.wav", "C:\\x\\one.FLAC", "x/one"])
def test_provenance_names_speech_and_style(speech):
    notes = {"speech": {"name": speech}, "arguments": {"styles": ["clips/old.bvh"]}}
    assert c.of_provenance(notes, NAMES) == Counterpart("one", "old")


@pytest.mark.parametrize("notes", [{}, {"speech": None}, {"speech": {"name": 3}}, {"speech": "x", "arguments": []}])
def test_other_notes_name_nothing(notes):
    assert c.of_provenance(notes, NAMES) == Counterpart(None, None)


@pytest.mark.parametrize("more", [{"styles": ["old", "sad"]}, {"timeline": [{"time": 0}]}, {"pca": [[1, 2.0]]}])
def test_a_blend_and_what_moves_have_no_style(more):
    notes = {"speech": {"name": "one.wav"}, "arguments": {"styles": ["old"], "timeline": None, "pca": []}}
    assert c.of_provenance(notes, NAMES) == Counterpart("one", "old")
    notes["arguments"] |= more
    assert c.of_provenance(notes, NAMES) == Counterpart("one", None)


def test_an_entry_of_a_library_is_called_as_there():
    notes = {"speech": {"name": "one.wav"}, "arguments": {"styles": ["styles/lib.npz:sad/long"]}}
    assert c.of_provenance(notes, NAMES) == Counterpart("one", "sad/long")


def test_a_style_given_by_a_clip_is_that_clips():
    styles = {"one": "old", "sad/long": "sad", "two": None}
    assert c.style_of("one", "two", styles) == "old"
    assert c.style_of("long", "two", styles) == "sad"
    assert c.style_of("happy", "one", styles) == "happy"
    assert c.style_of("two", "one", styles) == "two"
    assert c.style_of(None, "one", styles) == "old"
    assert c.style_of(None, None, styles) is None
