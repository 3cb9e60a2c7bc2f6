"""Corpora with bad clips: all of them in one report, one sentence, and the rest used where that is asked for."""

import json

import numpy as np
import pytest

from zeggs_jax.data.prepare import PrepareConfig, prepare
from zeggs_jax.motion import bvh
from zeggs_jax.speech import wav

from .conftest import NAMES, add_pair, make_clip


@pytest.fixture
def spoilt(corpus_folder):
    """Of six clips one is damaged, one has another skeleton, one another rate; and there is a file without partner."""
    (corpus_folder / "calm" / "b.bvh").write_text("no motion")
    bvh.write(corpus_folder / "calm" / "c.bvh", make_clip(30, names=(*NAMES[:7], "Tail")))
    add_pair(corpus_folder, "calm/d", 60, rate_hz=30)
    wav.write(corpus_folder / "old" / "alone.wav", 0.1 * np.ones(16000))
    return corpus_folder


def test_all_problems_are_in_one_report(spoilt, tmp_path, capsys):
    with pytest.raises(ValueError, match=r"^4 of 7 clips cannot be used \(the first, .*--skip-bad\.$") as caught:
        prepare(spoilt, tmp_path / "out")
    assert "\n" not in str(caught.value)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    reasons = {problem["name"]: problem["reason"] for problem in report["problems"]}
    assert report["used"] == 3
    assert reasons.keys() == {"old/alone", "calm/b", "calm/c", "calm/d"}
    assert "no 'alone.bvh' beside it" in reasons["old/alone"]
    assert "b.bvh" in reasons["calm/b"]
    assert "first different joint: 'RightFoot'" in reasons["calm/c"]
    assert "30 frames a second" in reasons["calm/d"]
    said = capsys.readouterr().err
    assert all(name in said for name in reasons)
    assert not (tmp_path / "out" / "manifest.json").exists()


def test_bad_clips_are_left_out_where_that_is_asked_for(spoilt, tmp_path, capsys):
    left = prepare(spoilt, tmp_path / "out", PrepareConfig(skip_bad=True))
    assert left.names == ("angry/a", "calm/a", "old/x")
    assert "4 of 7 clips cannot be used and are left out" in capsys.readouterr().err
    for name in ("calm/b", "calm/c", "calm/d"):
        for suffix in (".bvh", ".wav"):
            (spoilt / f"{name}{suffix}").unlink()
    (spoilt / "old" / "alone.wav").unlink()
    alone = prepare(spoilt, tmp_path / "alone")
    np.testing.assert_array_equal(left.pose, alone.pose)
    np.testing.assert_array_equal(left.scales.pose_in.std, alone.scales.pose_in.std)


def test_only_bad_clips_make_no_corpus(tmp_path):
    add_pair(tmp_path / "c", "a", 40)
    (tmp_path / "c" / "a.bvh").write_text("no motion")
    with pytest.raises(ValueError, match=r"^No clip of the corpus can be used \(the first, a: "):
        prepare(tmp_path / "c", tmp_path / "out", PrepareConfig(skip_bad=True))


def test_clips_under_the_asked_length_are_reported(corpus_folder, tmp_path):
    with pytest.raises(ValueError, match=r"^2 of 6 .*40 are needed"):
        prepare(corpus_folder, tmp_path / "out", PrepareConfig(min_frames=40))
    assert len(prepare(corpus_folder, tmp_path / "out", PrepareConfig(min_frames=40, skip_bad=True)).names) == 4


@pytest.mark.parametrize("setting", [{"min_frames": 3}, {"rate_hz": 0.0}, {"pace": ()}, {"pace": (0.9, -1.0)}])
def test_settings_that_make_no_sense_are_refused(setting):
    with pytest.raises(ValueError, match=r"give|need"):
        PrepareConfig(**setting)


def test_trimmed_clips_do_not_go_into_the_corpus(corpus_folder):
    with pytest.raises(ValueError, match="lies in the corpus"):
        prepare(corpus_folder, corpus_folder / "out", PrepareConfig(save_trimmed=True))
