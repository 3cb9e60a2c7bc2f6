"""The ZEGGS download after it is cut (`clean/`), and all that is wrong in its table at once."""

import pytest

from zeggs_jax.data import corpus, release

from .test_corpus import INFO, summary, touch

CUT = ("001_Neutral_0_x_1_0", "001_Neutral_0_mirror_x_1_0", "067_Speech_2_x_1_0")
ROWS = """a.wav,09:30:09:15,09:30:10:00,09:30:10:12,09:30:11:42,Neutral,001_Neutral_0.bvh,FALSE
a.wav,09:30:09:15,09:30:10:00,09:30:10:12,09:30:11:42,Neutral,001_Neutral_0_mirror.bvh,FALSE
b.wav,09:30:09:15,09:30:10:00,09:30:10:12,09:30:11:42,Oration,067_Speech_2.bvh,TRUE
"""


@pytest.fixture
def download(tmp_path):
    touch(tmp_path / "clean", *(f"{name}{suffix}" for name in CUT for suffix in (".bvh", ".wav")))
    (tmp_path / "info.csv").write_text(f"{INFO}\n{ROWS}")
    return tmp_path


@pytest.mark.parametrize("inside", ["", "clean"])
def test_the_clean_form(download, inside):
    """With the table beside `clean/` or from inside it: the table's styles and split, files used whole."""
    found = corpus.survey(download / inside)
    assert sorted(summary(found.entries)) == [
        ("001_Neutral_0_mirror_x_1_0", "Neutral", "train"), ("001_Neutral_0_x_1_0", "Neutral", "train"),
        ("067_Speech_2_x_1_0", "Oration", "valid"),
    ]  # fmt: skip
    assert found.problems == []
    assert {entry.sync for entry in found.entries} == {None}


def test_the_clean_form_without_a_table_has_its_styles_in_its_names(download):
    (download / "info.csv").unlink()
    assert {entry.style for entry in corpus.find(download / "clean")} == {"Neutral", "Speech"}


def test_a_mirrored_take_may_share_its_speech(download):
    (download / "clean" / f"{CUT[1]}.wav").unlink()
    speech = {entry.name: entry.wav.name for entry in corpus.find(download)}
    assert speech[CUT[1]] == f"{CUT[0]}.wav"


def test_what_the_clean_form_lacks_is_listed(download):
    (download / "clean" / f"{CUT[2]}.wav").unlink()
    for suffix in (".bvh", ".wav"):
        (download / "clean" / f"{CUT[1]}{suffix}").unlink()
    problems = dict(corpus.survey(download).problems)
    assert set(problems) == {CUT[2], "001_Neutral_0_mirror"}
    assert f"'{CUT[2]}.wav'" in problems[CUT[2]]
    assert "has no clip" in problems["001_Neutral_0_mirror"]


def test_the_original_form_comes_first(download):
    touch(download / "original", "a.wav", "b.wav", "001_Neutral_0.bvh", "001_Neutral_0_mirror.bvh", "067_Speech_2.bvh")
    for table in ("a.csv", "b.csv"):
        (download / "original" / table).write_text("#,Start,End\nR1,00:00.100,01:01.450\n")
    assert all(entry.sync for entry in corpus.find(download))


def test_every_line_that_does_not_fit_is_listed(download):
    """One good take among five others: all five are told, none stops the others."""
    files = download / "original"
    touch(files, "a.wav", "b.wav", "c.wav", "good.bvh", "late.bvh", "odd.bvh", "deaf.bvh", "short.bvh")
    for name, text in (("a", "R1,00:00.1,01:01"), ("b", "R1,x,01:01")):
        (files / f"{name}.csv").write_text(f"#,Start,End\n{text}\n")
    times = "09:30:09:15,09:30:10:00,09:30:10:12,09:30:11:42"
    rows = [
        f"a.wav,{times},Happy,good.bvh,FALSE",
        "a.wav,09:30:09:15,09:30:10:00,09:30:11:42,09:30:10:12,Happy,late.bvh,FALSE",
        f"b.wav,{times},Happy,odd.bvh,FALSE",
        f"c.wav,{times},Happy,deaf.bvh,FALSE",
        f"a.wav,{times},Happy,gone.bvh,FALSE",
        f"a.wav,{times},,short.bvh,FALSE",
    ]
    (download / "info.csv").write_text("\n".join([INFO, *rows]) + "\n")
    found = corpus.survey(download)
    assert summary(found.entries) == [("good", "Happy", "train")]
    problems = dict(found.problems)
    assert list(problems) == ["late", "odd", "deaf", "gone", "short"]
    for name, word in (("late", "outside"), ("odd", "mm:ss"), ("deaf", "c.csv"), ("gone", "gone.bvh"), ("short", "7")):
        assert word in problems[name]
        assert problems[name].endswith(".")
        assert "\n" not in problems[name]


def test_columns_are_the_releases():
    assert len(release.COLUMNS) == 8
