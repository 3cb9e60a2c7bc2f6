"""Experiment 20, the paper's protocol of style recognition, on a stand-in for the ZEGGS recordings."""

import importlib.util
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

from zeggs_jax.diffuclip import wording
from zeggs_jax.diffuclip.checkpoints import save_model
from zeggs_jax.motion import bvh

PATH = Path(__file__).parents[2] / "experiments" / "20_styles_of_zeggs.py"
POSES = {"Neutral": (0.0, 0.0), "Old": (1.1, 0.0), "Happy": (-0.2, 2.0), "Agreement": (0.5, 0.5)}


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("experiment_20", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def recordings(tmp_path_factory, clip):
    """Two clips of 23 s in each of four styles, told apart by spine and arms; words in one of them."""
    folder, lines = tmp_path_factory.mktemp("zeggs"), ["name,style,split"]
    rng = np.random.default_rng(0)
    for style, (spine, arms) in POSES.items():
        for k in range(2):
            name = f"00{k}_{style}_0"
            euler = 0.1 * np.tile(clip.euler, (8, 1, 1))[:690] + 0.01 * rng.normal(size=(690, 13, 3))
            euler[:, 1, 0] += spine
            euler[:, [4, 7], 2] += arms
            bvh.write(
                folder / f"{name}.bvh", clip._replace(euler=euler, positions=np.tile(clip.positions, (8, 1, 1))[:690])
            )
            soundfile.write(folder / f"{name}.wav", 0.1 * rng.normal(size=23 * 16000), 16000)
            lines.append(f"{name},{style},{'valid' if k else 'train'}")
    words = [{"text": f"w{k}", "start": k + 0.2, "end": k + 0.6} for k in range(23)]
    (folder / "000_Neutral_0.json").write_text(json.dumps({"words": words}))
    (folder / "corpus.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="module")
def run(script, tmp_path_factory, tiny_model, recordings):
    """Runs the script with more arguments; returns its report and its rows."""
    out = tmp_path_factory.mktemp("sra")
    save_model(out / "model", tiny_model)

    def call(*words):
        shutil.rmtree(out / "sra", ignore_errors=True)
        given = ("--checkpoint", out / "model", "--corpus", recordings, "-o", out / "sra", "--steps", 2, *words)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(wording, "installed", lambda: False)
            patch.setattr(sys, "argv", [PATH.name, *map(str, given)])
            script.main()
        return json.loads((out / "sra" / "sra.json").read_text())

    return call


def test_the_thirteen_styles_are_those_of_the_paper(script):
    assert len(set(script.STYLES)) == 13
    dropped = {"agreement", "disagreement", "oration", "pensive", "sarcastic", "threatening"}
    assert not dropped & set(script.STYLES)
    assert script.SPOKEN in script.STYLES


def test_a_body_that_does_as_asked_is_recognised_and_one_that_does_not_is_not(script, run, monkeypatch, capsys, clip):
    """The generator replaced by the recordings: those of the style that was asked for, then those of another."""
    asked = []
    monkeypatch.setattr(script.prompted, "of_text", lambda bench, text: asked.append(text) or text.split()[-1])
    monkeypatch.setattr(script.prompted, "wish", lambda bench, prompt: prompt)
    for told, expected in (({}, 100.0), ({"old": "happy", "happy": "neutral", "neutral": "old"}, 0.0)):

        def perform(bench, voices, told=told):
            style = told.get(voices[0].wishes, voices[0].wishes)
            take = next(said.take for said in bench.said if said.take.style.lower() == style)
            return [script.prompted.movement(bench.model, take.motion)] * len(voices)

        monkeypatch.setattr(script, "perform", perform)
        found = run("--samplings", "2")
        assert found["styles"] == ["happy", "neutral", "old"]  # agreement is dropped
        assert found["own"] == 1.0
        assert [len(row["seen"]) for row in found["rows"]] == [4] * 6  # two segments of each neutral recording
        text = capsys.readouterr().out
        assert f"SRA {expected:.1f} +- 0.0 % over 2 samplings: 3 styles" in text
        assert "chance 33.3 %" in text
    assert set(asked) == {f"the person is {style}" for style in ("happy", "neutral", "old")}


def test_segments_are_cut_with_their_words(script, recordings, tiny):
    from prompted import Said
    from zeggs_jax.diffuclip import takes

    read, _, _ = takes.gather(recordings, recordings.parent / "kept", tiny, 1)
    said = [Said(take, recordings / f"{take.name}.wav", {}) for take in read]
    found = script.segments(said)
    assert [len(one.wave) for one in found] == [11 * 16000] * 4
    assert [word.text for word in found[1].words] == [f"w{k}" for k in range(11, 22)]
    np.testing.assert_allclose([found[0].words[0].start, found[1].words[0].start], 0.2, atol=1e-6)
    with pytest.raises(ValueError, match="no recording of the style 'neutral' is 11 s long"):
        script.segments([one for one in said if one.take.style == "Old"])


@pytest.mark.slow
def test_the_whole_protocol_runs_with_a_model(run, capsys):
    found = run("--samplings", "2", "--segments", "2")
    assert [len(row["seen"]) for row in found["rows"]] == [2] * 6
    assert (
        "% over 2 samplings: 3 styles (of the paper's 13; the corpus has no more), 2 segments"
        in capsys.readouterr().out
    )
