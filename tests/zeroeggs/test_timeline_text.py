"""Timelines on disk: what is written is read again; a broken file is one sentence that names the line or cue."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.zeroeggs import timeline as tl
from zeggs_jax.zeroeggs import timeline_text as text
from zeggs_jax.zeroeggs.timeline import Cue, Timeline

LONG = Timeline(
    (
        Cue(0.0, (("neutral", 1.0),)),
        Cue(1 / 3, (("old", 0.3), ("my clips/happy one.bvh", 0.7)), 0.1, "linear"),
        Cue(2.5, (("lib.npz:sad", -0.5), ("old", 1.5)), 1e-3, "hard", 1.7),
        Cue(7.0, (("2 fast", 1.0),)),
    )
)


@pytest.mark.parametrize("ending", ["json", "csv"])
def test_what_is_written_is_read_again(tmp_path, ending):
    tl.write(tmp_path / f"a.{ending}", LONG)
    assert tl.read(tmp_path / f"a.{ending}") == LONG
    assert [p.name for p in tmp_path.iterdir()] == [f"a.{ending}"]


names = st.lists(st.text("aé1.+-:/", min_size=1, max_size=4), min_size=1, max_size=3).map(" ".join)


@settings(max_examples=100, deadline=None)
@given(st.dictionaries(names, st.floats(-2, 2), min_size=1, max_size=3))
def test_a_mix_as_text_is_the_mix(mix):
    try:
        written = text.text_of(mix)
    except ValueError:
        assert any(" + " in f" {name} " for name in mix)
    else:
        assert text.mix_of(written) == mix


@pytest.mark.parametrize(
    ("written", "mix"),
    [
        ("old", {"old": 1.0}),
        (" 0.3 old + .7 happy ", {"old": 0.3, "happy": 0.7}),
        ("1.5 old + -0.5 a+b", {"old": 1.5, "a+b": -0.5}),
        ("my clip.bvh", {"my clip.bvh": 1.0}),
    ],
)
def test_mixes_are_read(written, mix):
    assert text.mix_of(written) == mix


@pytest.mark.parametrize("written", ["", "old + happy", "0.5 old + ", "0.5", "0.5 old + 0.5 old", " + "])
def test_what_is_no_mix_is_one_sentence(written):
    with pytest.raises(ValueError, match=r"(is no mix of styles|twice)"):
        text.mix_of(written)


def test_a_name_that_text_cannot_hold_is_not_written(tmp_path):
    odd = Timeline((Cue(0.0, (("a + b", 1.0),)),))
    with pytest.raises(ValueError, match=r"save the timeline as \.json"):
        tl.write(tmp_path / "a.csv", odd)
    assert not list(tmp_path.iterdir())
    tl.write(tmp_path / "a.json", odd)
    assert tl.read(tmp_path / "a.json") == odd


GOOD = {"time": 0, "style": "old"}


@pytest.mark.parametrize(
    ("cues", "told"),
    [
        ([], "has no cues"),
        ([GOOD, {"time": 2, "style": "sad", "curv": "hard"}], "cue 2 of timeline 'a.json' has an unknown key 'curv'"),
        ([{"time": 0}], "cue 1 of timeline 'a.json' has no style"),
        ([{"style": "old"}], "has no time"),
        ([{"time": "0", "style": "old"}], "has the time '0'; give a number"),
        ([{"time": True, "style": "old"}], "has the time True"),
        ([{"time": 0, "style": 3}], "has the style 3"),
        ([{"time": 0, "style": {"old": "1"}}], "has the style {'old': '1'}"),
        ([{"time": 0, "style": {}}], "one style or more"),
        ([{"time": 0, "style": ""}], "one style or more"),
        ([GOOD | {"curve": "round"}], "has the curve 'round'"),
        ([GOOD | {"curve": 3}], "has the curve 3"),
        ([GOOD | {"transition": None}], "has the transition None"),
        ([GOOD, GOOD | {"time": 2}, GOOD | {"time": 2.5}], "cue 3 of timeline 'a.json' is at 2.5 s, within"),
        ([GOOD, "old"], "cue 2 of timeline 'a.json' is 'old'"),
    ],
)
def test_a_bad_cue_in_json_is_one_sentence(tmp_path, cues, told):
    (tmp_path / "a.json").write_text(json.dumps({"cues": cues}))
    with pytest.raises(ValueError, match=told) as caught:
        tl.read(tmp_path / "a.json")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("{", "is not JSON of the form"),
        ("[]", "holds list; expected"),
        ('{"cue": []}', "holds the keys 'cue'"),
        ('{"cues": [{"time": NaN, "style": "old"}]}', "NaN is no number"),
        ('{"cues": [{"time": 0, "time": 1, "style": "old"}]}', "a key comes twice"),
        ("[" * 100_000, "is not JSON"),
    ],
)
def test_broken_json_is_one_sentence(tmp_path, content, told):
    (tmp_path / "a.json").write_text(content)
    with pytest.raises(ValueError, match=told):
        tl.read(tmp_path / "a.json")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("", "has no cues"),
        ("time,style\n", "has no cues"),
        ("time,syle\n0,old\n", "has the column 'syle'"),
        ("time,time,style\n0,0,old\n", "each once"),
        ("time,style\n0,old\nsoon,happy\n", "line 3 of timeline 'a.csv': the time 'soon' is no number"),
        ("time,style\n0,old,hard\n", "line 2 of timeline 'a.csv' has 3 cells for 2 columns"),
        ("time,style\n0,\n", "line 2 of timeline 'a.csv' has no style"),
        ("time,style\n0,old\n\n2,0.5 old + happy\n", "line 4 of timeline 'a.csv': '0.5 old . happy' is no mix"),
        ("time,style\n0,old\n3,sad\n2,old\n", "line 4 of timeline 'a.csv' is at 2 s, after one at 3 s"),
        ("time,style\n0,old\nnan,sad\n", "line 3 of timeline 'a.csv' has the time nan"),
        ('time,style\n0,"old\n', "is not comma-separated"),
    ],
)
def test_a_bad_line_in_csv_is_one_sentence(tmp_path, content, told):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(ValueError, match=told):
        tl.read(tmp_path / "a.csv")


def test_a_csv_of_a_spreadsheet_is_read(tmp_path):
    """Byte-order mark, blanks, empty cells and empty lines."""
    (tmp_path / "a.csv").write_bytes("\ufefftime, style ,curve,\n0, old,,\n,,,\n 2.5 ,1.0 happy,hard,\n".encode())
    with pytest.raises(ValueError, match="has the column ''"):
        tl.read(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_bytes("\ufefftime, style ,curve\r\n0, old,\r\n,,\r\n 2.5 ,1.0 happy,hard\r\n".encode())
    assert tl.read(tmp_path / "a.csv").cues == (
        Cue(0.0, (("old", 1.0),)),
        Cue(2.5, (("happy", 1.0),), curve="hard"),
    )


def test_paths_that_are_no_timeline(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"timeline '.*a\.json' does not exist"):
        tl.read(tmp_path / "a.json")
    for act in (lambda: tl.read(tmp_path / "a.txt"), lambda: tl.write(tmp_path / "a.txt", LONG)):
        with pytest.raises(ValueError, match=r"ends? in \.json or \.csv"):
            act()
    (tmp_path / "b.json").write_bytes(b"\xff\xfe\xff")
    with pytest.raises(ValueError, match="not text in UTF-8"):
        tl.read(tmp_path / "b.json")
    with pytest.raises(OSError, match="cannot write timeline"):
        tl.write(tmp_path / "no folder" / "a.json", LONG)


def test_a_file_stays_whole_when_the_new_one_cannot_be_written(tmp_path):
    tl.write(tmp_path / "a.csv", LONG)
    before = (tmp_path / "a.csv").read_bytes()
    with pytest.raises(ValueError, match=r"as \.json"):
        tl.write(tmp_path / "a.csv", Timeline((Cue(0.0, (("a + b", 1.0),)),)))
    assert (tmp_path / "a.csv").read_bytes() == before
