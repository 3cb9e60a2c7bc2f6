"""What a parity run does not compare is named, and the sentences of the `generate` cases are read."""

import json
import sys

import pytest

import reference_parity
from parity import generate, left_out


@pytest.fixture(autouse=True)
def nothing_kept():
    left_out.take()
    yield
    left_out.take()


def case(folder, **content):
    folder.mkdir()
    (folder / "case.json").write_text(json.dumps(content))


def test_absent_files_and_strange_folders_are_named(tmp_path):
    case(tmp_path / "audio", files={"a.npz": {}, "b.npz": {}})
    (tmp_path / "audio" / "a.npz").touch()
    case(tmp_path / "dance")
    left_out.absent_files(tmp_path, "audio")
    left_out.other_stages(tmp_path, ("audio",))
    assert [(entry.stage, entry.name) for entry in left_out.take()] == [("audio", "b.npz"), ("dance", "all")]
    assert left_out.take() == []


def test_without_the_reference_every_generated_case_is_left_out(tmp_path):
    case(tmp_path / "generate", cases={"single": {}, "frames": {}})
    assert list(generate.check(tmp_path, None)) == []
    assert [entry.name for entry in left_out.take()] == ["single", "frames"]


def test_the_script_names_them_and_ends_with_the_counts(tmp_path, monkeypatch, capsys):
    case(tmp_path / "generate", cases={"single": {}})
    report = tmp_path / "report.json"
    arguments = ["--golden", str(tmp_path), "--json", str(report), "--only", "generate", "audio"]
    monkeypatch.setattr(sys, "argv", ["reference_parity.py", *arguments])
    monkeypatch.setattr(reference_parity.jax.config, "update", lambda *_: None)
    with pytest.raises(SystemExit, match="1"):  # nothing compared is no success
        reference_parity.main()
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == "0 passed, 0 failed"
    assert "generate/single (needs --reference)" in err
    assert "audio/all (no folder in this set)" in err
    assert "train/all (not asked for)" in err
    assert len(json.loads(report.read_text())["left_out"]) == 2 + len(reference_parity.STAGES) - 2


@pytest.mark.parametrize(
    ("about", "plan"),
    [
        ("style A, frames 7 to 90, temperature 2", ("A", "A", (7, 90), None, False)),
        ("B and A added 0.5 / 0.5; first pose and gaze come from A", ("BA", "A", None, None, False)),
        ("a given embedding, first pose from B", ("", "B", None, None, True)),
        ("label 'Happy' (one-hot), first pose from A", ("", "A", None, "Happy", False)),
    ],
)
def test_a_case_is_read_from_its_sentence(about, plan):
    assert generate.read_plan("new", {"about": about}, "AB") == generate.Plan(*plan)


def test_a_case_that_says_nothing_is_known_by_name_or_fails():
    assert generate.read_plan("stitch", {}, "AB") == generate.PLANS["stitch"]
    assert generate.read_plan("new", {"about": "something else"}, "AB") is None
