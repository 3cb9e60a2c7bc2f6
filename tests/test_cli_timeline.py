"""`zeggs timeline`: files made, edited and shown; one sentence for whatever cannot be played, and no file."""

import json

import pytest

from zeggs_jax.zeroeggs import timeline as t

WORDS = {
    "words": [
        {"text": "good", "start": 0.2, "end": 0.6},
        {"text": "day.", "start": 0.6, "end": 1.0},
        {"text": "How", "start": 3.0, "end": 3.3},
        {"text": "are", "start": 3.3, "end": 3.6},
        {"text": "you?", "start": 3.6, "end": 4.2},
        {"text": "Bye.", "start": 6.2, "end": 7.0},
    ]
}


@pytest.fixture
def place(tmp_path):
    """A timeline of three cues, a transcript of three sentences, and what is neither."""
    lines = t.Timeline((t.Cue(0.0, (("neutral", 1.0),)), t.Cue(2.0, (("old", 1.0),)), t.Cue(5.0, (("sad", 1.0),))))
    t.write(tmp_path / "three.json", lines)
    (tmp_path / "words.json").write_text(json.dumps(WORDS))
    (tmp_path / "overlap.csv").write_text("time,style,transition\n0,neutral,\n1,old,2\n2.5,sad,1\n")
    (tmp_path / "empty.json").write_text("")
    return tmp_path


def test_put_makes_a_timeline_and_edits_it(zeggs, place):
    file = place / "new" / "mine.csv"
    mixed = ("--put", "12.5=0.3 old + 0.7 happy", "--put", "0=neutral", "--transition", 2)
    status, told, _ = zeggs("timeline", file, *mixed)
    assert status == 0
    assert "0.3 old + 0.7 happy" in told
    cues = t.read(file).cues
    assert [(cue.time, cue.mix) for cue in cues] == [
        (0.0, (("neutral", 1.0),)), (12.5, (("old", 0.3), ("happy", 0.7))),
    ]  # fmt: skip
    assert cues[1].transition == 2.0
    assert zeggs("timeline", file, "--put", "12.5=angry", "--curve", "hard", "--intensity", "1.5")[0] == 0
    assert t.read(file).cues[1] == t.Cue(12.5, (("angry", 1.0),), 1.0, "hard", 1.5)


def test_the_flags_are_the_functions(zeggs, place):
    before = t.read(place / "three.json")
    words = ("timeline", place / "three.json", "-o", place / "out.json", "--shift", 1, "--stretch", 2, "--remove", 6)
    assert zeggs(*words)[0] == 0
    assert t.read(place / "out.json") == t.remove(t.stretch(t.shift(before, 1.0), 2.0), 6.0)
    assert t.read(place / "three.json") == before


def test_without_a_flag_it_is_only_shown(zeggs, place):
    before = (place / "three.json").read_bytes(), (place / "three.json").stat().st_mtime_ns
    status, told, _ = zeggs("timeline", place / "three.json")
    assert status == 0
    assert [line.split()[0] for line in told.splitlines()] == ["from", "0.00", "2.00", "5.00"]
    assert before == ((place / "three.json").read_bytes(), (place / "three.json").stat().st_mtime_ns)


def test_a_transcript_gives_each_sentence_its_style(zeggs, place):
    status, told, _ = zeggs(
        "timeline", place / "a.json", "--transcript", place / "words.json", "--styles", "neutral", "happy",
        "--transition", 0.5,
    )  # fmt: skip
    assert status == 0
    assert "How are you?" in told
    assert [cue.mix[0][0] for cue in t.read(place / "a.json").cues] == ["neutral", "happy", "neutral"]
    assert [cue.time for cue in t.read(place / "a.json").cues] == [0.0, 1.75, 4.95]
    one = ("timeline", place / "b.json", "--transcript", place / "words.json", "--styles", "0=neutral", "2=sad")
    assert zeggs(*one)[0] == 0
    assert [cue.mix[0][0] for cue in t.read(place / "b.json").cues] == ["neutral", "sad"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("none.json",), "'{f}/none.json' does not exist; begin one with --put 0=STYLE"),
        (("none.json", "--put", "0=old", "--remove", "3"), "none.json' does not exist"),
        (("none.json", "--put", "3=old"), "the first one must be at 0 s"),
        (("none.txt", "--put", "0=old"), "ends in .json or .csv"),
        ((".", "--put", "0=old"), "ends in .json or .csv"),
        (("words.json", "--put", "0=old"), "expected {{"),
        (("overlap.csv",), "line 4 of timeline 'overlap.csv'"),
        (("empty.json", "--put", "0=old"), "empty.json"),
        (("three.json", "--put", "old"), "--put got 'old'; give TIME=STYLE"),
        (("three.json", "--put", "3="), "give TIME=STYLE"),
        (("three.json", "--put", "x=old"), "'x' is no number"),
        (("three.json", "--put", "nan=old"), "time nan"),
        (("three.json", "--put", "-1=old"), "time -1"),
        (("three.json", "--put", "3=0.5 old + 0.2 sad"), "sum to 0.7"),
        (("three.json", "--put", "2.5=happy"), "within the transition"),
        (("three.json", "--put", "3.5=happy", "--transition", "9"), "within the transition"),
        (("three.json", "--put", "3.5=happy", "--curve", "round"), "smooth, linear, hard"),
        (("three.json", "--put", "3.5=happy", "--intensity=-1"), "intensity -1"),
        (("three.json", "--transition", "2"), "--transition says how a style is put"),
        (("three.json", "--remove", "3"), "the cues are at 0, 2, 5 s"),
        (("three.json", "--remove", "0"), "put another in its place"),
        (("three.json", "--stretch", "0"), "stretched by 0"),
        (("three.json", "--shift", "nan"), "nan"),
        (("three.json", "--styles", "old"), "--transcript and --styles belong together"),
        (("new.json", "--transcript", "{f}/words.json"), "--transcript and --styles belong together"),
        (("three.json", "--transcript", "{f}/words.json", "--styles", "old"), "name another file"),
        (("new.json", "--transcript", "{f}/none.json", "--styles", "old"), "none.json"),
        (("new.json", "--transcript", "{f}/three.json", "--styles", "old"), "three.json"),
        (("new.json", "--transcript", "{f}/words.json", "--styles", "0=old", "7=sad"), "sentence 7"),
        (("new.json", "--transcript", "{f}/words.json", "--styles", "0=old", "sad"), "one form or the other"),
        (("three.json", "-o", "{f}/three.json", "--put", "3.5=old"), "would be written over"),
        (("three.json", "-o", "{f}/empty.json/a.json"), "cannot write to folder"),
    ],
)  # fmt: skip
def test_wrong_timelines_end_in_one_sentence_and_no_file(zeggs, place, words, sentence):
    before = {path: path.read_bytes() for path in place.iterdir()}
    status, _, told = zeggs("timeline", place / words[0], *(word.format(f=place) for word in words[1:]))
    assert (status, told.count("\n")) == (2, 1), told
    assert told.startswith("zeggs: ")
    assert sentence.format(f=place) in told
    assert {path: path.read_bytes() for path in place.iterdir()} == before
