"""Recorded and made clips of folders: names, styles, speech, stresses; one sentence for each that does not fit."""

import json

import numpy as np
import pytest

from zeggs_jax.data import made, recorded, spoken
from zeggs_jax.motion import bvh
from zeggs_jax.speech import wav
from zeggs_jax.speech.transcript import Word

from .conftest import add_pair, make_clip


@pytest.fixture
def folder(tmp_path):
    add_pair(tmp_path / "truth", "one", 40, 1)
    add_pair(tmp_path / "truth", "sad/two", 40, 2)
    return tmp_path


def write(path, clip):
    path.parent.mkdir(parents=True, exist_ok=True)
    bvh.write(path, clip)


def test_names_are_paths_and_styles_are_subfolders(folder):
    clips = recorded.read_truth(folder / "truth").clips
    assert [(clip.name, clip.style) for clip in clips] == [("one", None), ("sad/two", "sad")]
    assert all(clip.speech is not None and clip.transcript is None for clip in clips)


def test_a_table_gives_styles_and_splits(folder):
    (folder / "truth" / "corpus.csv").write_text("name,style,split\none,old,valid\nsad/two,sad,train\nlost,old,valid\n")
    found = recorded.read_truth(folder / "truth", split="valid")
    assert [(clip.name, clip.style) for clip in found.clips] == [("one", "old")]
    assert "lost" in found.problems[0]


def test_speech_may_lie_elsewhere_or_nowhere(folder):
    (folder / "truth" / "one.wav").rename(folder / "moved.wav")
    assert recorded.read_truth(folder / "truth").clips[0].speech is None
    assert spoken.hear(recorded.read_truth(folder / "truth").clips[0]) is None
    (folder / "wavs").mkdir()
    (folder / "moved.wav").rename(folder / "wavs" / "one.wav")
    assert recorded.read_truth(folder / "truth", folder / "wavs").clips[0].speech == folder / "wavs" / "one.wav"


def test_stresses_of_the_json_else_of_the_louder_words(folder):
    notes = folder / "truth" / "one.json"
    notes.write_text(json.dumps({"style": "old", "stresses": [{"time": 0.5}, {"time": 0.2}]}))
    clip = recorded.read_truth(folder / "truth").clips[0]
    assert clip.style == "old"
    assert spoken.hear(clip).stresses.tolist() == [0.2, 0.5]
    wave = np.zeros(16000)
    wave[4000:4400], wave[9600:10000], wave[14000:14400] = 0.5, 0.1, 0.4
    words = [("a", 0.2, 0.4), ("b", 0.5, 0.7), ("c", 0.8, 1.0)]
    found = spoken.stressed(tuple(Word(*word) for word in words), wave)
    assert found == pytest.approx([0.26, 0.89], abs=0.04)
    wav.write(folder / "truth" / "one.wav", wave)
    keys = ("text", "start", "end")
    notes.write_text(json.dumps({"words": [dict(zip(keys, word, strict=True)) for word in words]}))
    assert spoken.hear(recorded.read_truth(folder / "truth").clips[0]).stresses == pytest.approx(found, abs=1e-3)
    notes.write_text('{"stresses": ["soon"]}')
    with pytest.raises(ValueError, match=r"one.json' has stresses that are no times"):
        spoken.hear(recorded.read_truth(folder / "truth").clips[0])


def test_groups_are_folders_and_files_together(folder):
    write(folder / "ours" / "one__old.bvh", make_clip(40, 5))
    write(folder / "x.bvh", make_clip(40, 6))
    truth = recorded.read_truth(folder / "truth")
    found = made.read_groups([str(folder / "ours"), f"b={folder / 'ours'}", str(folder / "x.bvh")], truth)
    assert list(found) == ["ours", "b", "generated"]
    (clip,) = found["ours"]
    assert (clip.name, clip.truth.name, clip.style) == ("one__old", "one", "old")
    assert found["generated"][0].truth is None


def test_provenance_goes_before_the_name(folder):
    write(folder / "ours" / "one__old.bvh", make_clip(40, 5))
    notes = {"speech": {"name": "two.wav"}, "arguments": {"styles": ["happy"]}}
    (folder / "ours" / "one__old.provenance.json").write_text(json.dumps(notes))
    (clip,) = made.read_groups([str(folder / "ours")], recorded.read_truth(folder / "truth"))["ours"]
    assert (clip.truth.name, clip.style, clip.provenance) == ("sad/two", "happy", notes)


def test_the_size_of_a_body_does_not_depend_on_units_of_the_truth(folder):
    clip = make_clip(40, 1)
    metres = clip._replace(
        skeleton=type(clip.skeleton)(clip.skeleton.names, clip.skeleton.parents, clip.skeleton.offsets / 100.0),
        positions=clip.positions / 100.0,
    )
    write(folder / "m" / "one.bvh", metres)
    write(folder / "ours" / "one.bvh", clip)
    truth = recorded.read_truth(folder / "m")
    (found,) = made.read_groups([str(folder / "ours")], truth)["ours"]
    assert np.ptp(found.clip.positions - truth.clips[0].clip.positions) < 1e-2
    write(folder / "theirs" / "one.bvh", metres)
    with pytest.raises(ValueError, match=r"are 0\.01 times as long as those of"):
        made.read_groups([str(folder / "theirs")], recorded.read_truth(folder / "truth"))


def test_what_does_not_fit_is_one_sentence(folder):
    truth = recorded.read_truth(folder / "truth")
    write(folder / "few" / "one.bvh", make_clip(40, names=make_clip(4).skeleton.names[:6]))
    write(folder / "slow" / "one.bvh", make_clip(40, rate_hz=30.0))
    (folder / "empty").mkdir()
    (folder / "text.txt").write_text("x")
    for words, told in {
        ("few",): "one.bvh' has a skeleton of 6 joints",
        ("slow",): "runs at 30 frames per second .* say --rate 60",
        ("empty",): "holds no clips",
        ("absent",): "no file or folder",
        ("text.txt",): "is no motion",
        ("truth", "truth/../truth"): "two groups are called 'truth'",
    }.items():
        with pytest.raises((ValueError, OSError), match=told) as error:
            made.read_groups([str(folder / word) for word in words], truth)
        assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match="holds no clips; put the recorded"):
        recorded.read_truth(folder / "empty")
    with pytest.raises(FileNotFoundError, match=r"the truth '.*absent' is no folder"):
        recorded.read_truth(folder / "absent")
    with pytest.raises(ValueError, match=r"has no corpus.csv that says what its split 'valid' is"):
        recorded.read_truth(folder / "truth", split="valid")
    resampled = made.read_groups([str(folder / "slow")], recorded.read_truth(folder / "truth", rate_hz=30.0), 30.0)
    assert len(resampled["slow"][0].clip.euler) == 40
