"""The numbered experiments: each opens with what it answers, tells its options, and has settings that hold together."""

import importlib.util
import json
import re
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "experiments"
NUMBERED = sorted(FOLDER.glob("[0-9][0-9]_*.py"))


def load(path: Path):
    """The script as a module; a name that begins with a digit cannot be imported."""
    spec = importlib.util.spec_from_file_location(f"experiment_{path.stem}", path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", NUMBERED, ids=lambda path: path.stem)
def test_each_script_tells_its_options_and_what_of_the_paper_it_answers(path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [path.name, "--help"])
    with pytest.raises(SystemExit) as done:
        load(path).main()
    told = capsys.readouterr().out
    assert done.value.code == 0
    assert f"experiments/{path.name}" in told
    assert re.search(r"(Sec|Fig|Table|Eq)\w*\.? ?\d", told)


def test_numbers_are_in_order_and_none_is_left_out():
    assert [int(path.name[:2]) for path in NUMBERED] == list(range(1, len(NUMBERED) + 1))


def test_paper_and_release_differ_where_they_say():
    module = load(FOLDER / "01_paper.py")
    paper, release = module.PAPER, module.RELEASE
    assert (paper.steps, release.steps) == (120_000, 160_000)
    assert paper.model == release.model
    assert (paper.windows.batch, paper.windows.window, paper.windows.example) == (32, 256, (256, 512))
    assert not paper.windows.as_released
    assert release.windows.as_released


def test_every_ablation_changes_one_thing():
    import trials

    variants = load(FOLDER / "04_ablations.py").variants()
    full = variants.pop("full").model
    assert full == trials.SMALL.model
    assert len(variants) >= 4
    for config in variants.values():
        parts = [(getattr(full, name), getattr(config.model, name)) for name in ("speech", "style", "decoder")]
        changed = [key for before, after in parts for key, value in vars(before).items() if vars(after)[key] != value]
        assert len(changed) == 1


def test_speech_features_differ_in_features_alone():
    variants = load(FOLDER / "05_speech_features.py").variants()
    assert len(variants) == 3
    assert len({str(config.speech) for config in variants.values()}) == 2


def test_a_ledger_goes_on_where_it_stopped(tmp_path):
    import ledger

    calls = []

    def job(name):
        return lambda: calls.append(name) or {"name": name[0], "value": len(name)}

    jobs = {name: job(name) for name in ("a1", "a22", "b1")}
    path = tmp_path / "rows.jsonl"
    ledger.fill(path, {"a1": jobs["a1"]}, "")
    with path.open("a") as file:
        file.write('{"job": "a22", "na')  # a kill in the middle of a line
    rows = ledger.fill(path, jobs, "")
    assert calls == ["a1", "a22", "b1"]
    assert [row["job"] for row in rows] == ["a1", "a22", "b1"]
    assert ledger.fill(path, jobs, "") == rows
    assert calls == ["a1", "a22", "b1"]
    groups = ledger.grouped(rows, "name")
    assert ledger.mean(groups["a"], "value") == 2.5
    assert ledger.spread(groups["a"], "value") == 0.5
    assert "| a | 2 | 2.50 ± 0.50 |" in ledger.by_seeds("what", rows, (("value", "value", "{:.2f}"),))
    ledger.save(tmp_path / "x.json", rows)
    assert json.loads((tmp_path / "x.json").read_text()) == rows


@pytest.mark.parametrize(
    ("speaker", "held"),
    [
        ("espeak-ng en-us+m4 -s 150 -p 50", True),
        ("espeak-ng en-us+m5 -s 150 -p 50", False),
        ("festival kal_diphone stretch 1.1", True),
        ("synthetic", False),
    ],
)
def test_voices_are_held_out_by_the_end_of_their_name(speaker, held):
    import make_corpus

    assert make_corpus.held_out(speaker, ("kal_diphone", "+m4")) is held
