"""Corpus folders: three layouts, and one sentence for each that does not fit."""

import pytest

from zeggs_jax.data import corpus, release

INFO = ",".join(release.COLUMNS)


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def summary(entries):
    return [(entry.name, entry.style, entry.split) for entry in entries]


def test_subfolders_are_styles(tmp_path):
    pairs = ["happy/1", "happy/2", "happy/3", "happy/4", "sad/1"]
    touch(tmp_path, *(f"{pair}.bvh" for pair in pairs), *(f"{pair}.wav" for pair in pairs), "README.txt")
    assert summary(corpus.find(tmp_path)) == [
        ("happy/1", "happy", "train"), ("happy/2", "happy", "train"), ("happy/3", "happy", "train"),
        ("happy/4", "happy", "valid"), ("sad/1", "sad", "train"),
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["067_Speech_2_x_1_0", "calm"])
def test_hidden_files_are_no_clips(tmp_path, name):
    """A Mac's archive holds a ._name of every file."""
    touch(tmp_path, f"{name}.bvh", f"{name}.wav")
    for path in list(tmp_path.iterdir()):
        (tmp_path / f"._{path.name}").write_bytes(b"Mac OS X")
    found = corpus.survey(tmp_path)
    assert [entry.name for entry in found.entries] == [name]
    assert not found.problems


def test_a_flat_folder_is_one_style(tmp_path):
    touch(tmp_path / "talks", "a.b.bvh", "a.b.flac")
    assert summary(corpus.find(tmp_path / "talks")) == [("a.b", "talks", "train")]


def test_a_table_gives_style_split_and_order(tmp_path):
    touch(tmp_path, "b.bvh", "b.wav", "deep/a.bvh", "deep/a.ogg", "unlisted.bvh")
    (tmp_path / "corpus.csv").write_text("name,style,split\nb,calm,valid\ndeep/a,old,train\n")
    entries = corpus.find(tmp_path)
    assert summary(entries) == [("b", "calm", "valid"), ("deep/a", "old", "train")]
    assert entries[1].wav.name == "a.ogg"


@pytest.mark.parametrize("inside", ["", "original"])
def test_the_released_layout(tmp_path, inside):
    touch(tmp_path / inside, "t.bvh", "s.wav")
    (tmp_path / inside / "s.csv").write_text("#,Name,Start,End\nR1,x,00:00.100,01:01.450\nX1,y,00:00.2,00:01\n")
    row = "s.wav,09:30:09:15,09:30:10:00,09:30:10:12,09:30:11:42,Happy,t.bvh,TRUE"
    (tmp_path / "info.csv").write_text(f"{INFO}\n{row}\n")
    (entry,) = corpus.find(tmp_path)
    assert summary([entry]) == [("t", "Happy", "valid")]
    assert entry.sync is not None
    assert entry.sync.audio_s == pytest.approx((0.7, 2.2))  # 15 frames of 30, against 12 and 42 of 60
    assert entry.sync.motion_s == pytest.approx((0.2, 1.7))
    assert entry.sync.speaking_s == ((0.1, 61.45),)


def broken(folder, case):
    touch(folder, "a.bvh", "a.wav")
    if case == "no pairs":
        (folder / "a.wav").unlink()
    elif case == "no wav":
        touch(folder, "b.bvh")
    elif case == "no bvh":
        touch(folder, "b.wav")
    elif case == "no column":
        (folder / "corpus.csv").write_text("name,split\na,train\n")
    elif case == "split":
        (folder / "corpus.csv").write_text("name,style,split\na,calm,test\n")
    elif case == "listed":
        (folder / "corpus.csv").write_text("name,style,split\nb,calm,train\n")
    elif case == "twice":
        (folder / "corpus.csv").write_text("name,style,split\na,calm,train\na,calm,train\n")
    elif case == "short line":
        (folder / "corpus.csv").write_text("name,style,split\na,calm\n")
    elif case == "binary":
        (folder / "corpus.csv").write_bytes(b"\xff\xfe\x00\x81")
    elif case == "empty table":
        (folder / "corpus.csv").write_text("name,style,split\n")
    else:
        audio_start = "1:2:3" if case == "time" else "00:00:00:00"
        acts = "00:00:00:00" if case == "acts after its end" else "00:00:02:00"
        row = f"a.wav,{audio_start},00:00:00:00,00:00:01:00,{acts},x,a.bvh,FALSE"
        (folder / "info.csv").write_text(f"{INFO}\n{row}\n")
        (folder / "a.csv").write_text("#,Start,End\n" + ("R,1,2\n" if case == "clock" else ""))


@pytest.mark.parametrize(
    ("case", "words"),
    [("no pairs", "no pairs"), ("no wav", r"b\.wav"), ("no bvh", r"b\.bvh"),
     ("no column", "no column 'style'"), ("split", "train or valid"), ("listed", r"b\.bvh.*does not exist"),
     ("twice", "more than once"), ("short line", "Line 2"), ("binary", "CSV"),
     ("empty table", "no pairs"), ("time", "HH:MM:SS:FF"),
     ("clock", "mm:ss"), ("acts after its end", "outside its recording")],
)  # fmt: skip
def test_what_does_not_fit_is_named_in_one_sentence(tmp_path, case, words):
    broken(tmp_path, case)
    with pytest.raises((ValueError, FileNotFoundError), match=words) as caught:
        corpus.find(tmp_path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="absent"):
        corpus.find(tmp_path / "absent")


def test_all_that_has_no_partner_is_listed(tmp_path):
    touch(tmp_path, "x/a.bvh", "x/a.wav", "x/b.bvh", "y/c.FLAC", "d.ogg", "e.BVH", "e.WAV", "notes.txt")
    found = corpus.survey(tmp_path)
    assert [entry.name for entry in found.entries] == ["e", "x/a"]
    assert [problem.name for problem in found.problems] == ["x/b", "d", "y/c"]
    assert all("beside it; add that or remove this." in problem.reason for problem in found.problems)
    with pytest.raises(ValueError, match=r"b\.bvh"):
        corpus.find(tmp_path)


def test_all_lines_that_do_not_fit_are_listed(tmp_path):
    touch(tmp_path, "a.bvh", "a.wav", "b.bvh")
    lines = ["name,style,split", "a,calm,train", "a,calm,train", "b,calm,train", "a,calm,test", "c,,train", "d,calm,"]
    (tmp_path / "corpus.csv").write_text("\n".join(lines) + "\n")
    found = corpus.survey(tmp_path)
    assert summary(found.entries) == [("a", "calm", "train")]
    assert [problem.name for problem in found.problems] == ["a", "b", "a", "c", "d"]


def test_a_table_without_split_leaves_it_to_the_rule(tmp_path):
    names = [f"t{k}" for k in range(6)]
    touch(tmp_path, *(f"{name}{suffix}" for name in names for suffix in (".bvh", ".wav")))
    rows = [f"{name},{'old' if k == 2 else 'calm'}" for k, name in enumerate(names)]
    (tmp_path / "corpus.csv").write_text("\ufeffname, style\n" + "\n".join(rows) + "\n", encoding="utf-8")
    assert [entry.split for entry in corpus.find(tmp_path)] == ["train"] * 5 + ["valid"]


def test_transcripts_lie_beside_the_pairs(tmp_path):
    touch(tmp_path, "a.bvh", "a.wav", "a.txt", "b.bvh", "b.wav", "b.json", "b.txt", "c.bvh", "c.wav")
    found = [entry.transcript.name if entry.transcript else None for entry in corpus.find(tmp_path)]
    assert found == ["a.txt", "b.json", None]
    (tmp_path / "corpus.csv").write_text("name,style\na,calm\n")
    assert corpus.find(tmp_path)[0].transcript == tmp_path / "a.txt"


@pytest.mark.parametrize("suffix", [".TextGrid", ".srt", ".vtt", ".tsv", ".txt"])
def test_a_transcript_of_an_aligner_lies_beside_too_and_json_goes_first(tmp_path, suffix):
    for name in ("a.bvh", "a.wav", f"a{suffix}"):
        (tmp_path / name).touch()
    assert corpus.find(tmp_path)[0].transcript == tmp_path / f"a{suffix}"
    (tmp_path / "a.json").touch()
    assert corpus.find(tmp_path)[0].transcript == tmp_path / "a.json"
