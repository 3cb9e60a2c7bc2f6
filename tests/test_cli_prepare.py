"""`zeggs prepare` as a stranger calls it: its flags on tiny folders, what it says, a sentence for what is wrong."""

import json
import shutil

import numpy as np
import pytest
import soundfile

from zeggs_jax.data.prepared import load
from zeggs_jax.motion import bvh
from zeggs_jax.motion.skeleton import Roles, Skeleton

NAMES = ("Hips", "Spine", "Spine2", "Head", "LeftHand", "RightHand", "LeftFoot", "RightFoot")
FOREIGN = ("Rt", "Sp", "Sp9", "Kopf", "LA", "RA", "LB", "RB")
OFFSETS = [[0, 95, 0], [0, 12, -2], [0, 25, 1], [0, 35, 2], [38, -9, 6], [-36, -10, 5], [9, -86, 3], [-10, -85, 2]]


def add(folder, name, names=NAMES, frames=36, unit=1.0, suffix=".wav"):
    """A pair of 36 frames at 60 a second."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(len(name) + frames)
    offsets = np.array(OFFSETS, float) / unit
    skeleton = Skeleton(names, (-1, 0, 1, 2, 2, 2, 0, 0), offsets)
    euler = 0.3 * np.sin(np.arange(frames)[:, None, None] / 20 + random.uniform(0, 6, (len(names), 3)))
    positions = np.repeat(offsets[None], frames, axis=0)
    bvh.write(path.with_name(f"{path.name}.bvh"), bvh.Clip(skeleton, ("zyx",) * 8, euler, positions, 1 / 60))
    noise = 0.1 * random.normal(size=round(frames / 60 * 16000))
    soundfile.write(path.with_name(path.name + suffix), noise, 16000)


@pytest.fixture
def corpus(tmp_path):
    for name in ("calm/a", "calm/b"):
        add(tmp_path / "corpus", name)
    return tmp_path / "corpus"


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def test_it_says_what_was_made_and_how_it_was_read(zeggs, corpus, out):
    status, told, _ = zeggs("prepare", f"{corpus}/", "-o", out, "--processes", 1)
    assert status == 0
    assert f"wrote {out}: 2 clips (2 to train, 0 to validate), 1.2 seconds at 60 frames a second, mended" in told
    assert "styles: calm 2" in told
    assert "body: 8 joints, about 183 cm tall; files read as cm, y up, facing z; hips Hips" in told
    assert "mirrored in training: yes" in told
    assert zeggs("prepare", corpus, "-o", out)[1] == told  # done before


def test_names_with_spaces_accents_and_capital_suffixes(zeggs, tmp_path, out):
    folder = tmp_path / "mein Körper 体"
    add(folder, "ä ö (1)/日本 v1.2", suffix=".FLAC")
    bvh_file = folder / "ä ö (1)" / "日本 v1.2.bvh"
    bvh_file.rename(bvh_file.with_suffix(".BVH"))
    assert zeggs("prepare", folder, "-o", out)[0] == 0
    assert load(out).names == ("ä ö (1)/日本 v1.2",)


def test_log_mel_features_are_kept_and_have_their_own_statistics(zeggs, corpus, out, tmp_path):
    for folder, words in ((out, ["--log-mel"]), (tmp_path / "usual", [])):
        assert zeggs("prepare", corpus, "-o", folder, *words)[0] == 0
    mel, usual = load(out), load(tmp_path / "usual")
    assert mel.config["speech"]["log_mel"]
    assert mel.speech.shape == usual.speech.shape
    assert not np.allclose(mel.speech, usual.speech)
    assert np.ptp(mel.scales.speech.std) > 0
    assert np.ptp(usual.scales.speech.std) == 0
    scaled = (mel.speech - mel.scales.speech.mean) / mel.scales.speech.std
    np.testing.assert_allclose(scaled.std(axis=0), 1, atol=0.5)
    np.testing.assert_array_equal(mel.pose, usual.pose)


def test_a_body_file_names_the_joints(zeggs, tmp_path, out):
    add(tmp_path / "corpus", "a", names=FOREIGN)
    status, _, told = zeggs("prepare", tmp_path / "corpus", "-o", out)
    assert status == 2
    assert "looks like the hips" in told
    assert "[roles]" in told
    body = tmp_path / "body.toml"
    body.write_text('facing = "z"\n[roles]\nhips = "Rt"\nspine = "Sp9"\nhead = "Kopf"\n')
    status, told, _ = zeggs("prepare", tmp_path / "corpus", "-o", out, "--skeleton", body)
    assert status == 0
    assert "hips Rt, spine Sp9, head Kopf" in told
    assert "mirrored in training: no, left and right joints are not known" in told
    made = load(out)
    assert made.across is None
    assert made.skeleton.roles == Roles("Rt", "Sp9", "Kopf")


def test_flags_win_over_the_body_file(zeggs, tmp_path, out):
    add(tmp_path / "corpus", "a", unit=100.0)
    (tmp_path / "body.toml").write_text('scale = 1\nup = "z"\n')
    words = ("--skeleton", tmp_path / "body.toml", "--scale", 50, "--up", "y", "--facing=-z")
    status, told, _ = zeggs("prepare", tmp_path / "corpus", "-o", out, *words)
    assert status == 0
    assert "about 91 cm tall; files read as 50.0 cm a unit, y up, facing -z" in told


def test_the_rate_and_the_least_length(zeggs, corpus, out):
    add(corpus, "calm/c", frames=20)
    status, _, told = zeggs("prepare", corpus, "-o", out, "--rate", 30, "--min-frames", 12)
    assert status == 2
    assert "calm/c" in told
    assert "12 are needed" in told
    words = ("--rate", 30, "--min-frames", 12, "--skip-bad")
    status, told, warned = zeggs("prepare", corpus, "-o", out, *words)
    assert status == 0
    assert "30 frames a second" in told
    assert f"left out: 1 clip, with reasons in {out / 'report.json'}" in told
    assert "calm/c" in warned
    assert load(out).names == ("calm/a", "calm/b")


def test_a_damaged_clip_in_the_middle_stops_it_and_nothing_counts_as_finished(zeggs, corpus, out):
    add(corpus, "calm/c")
    text = (corpus / "calm" / "b.bvh").read_bytes()
    (corpus / "calm" / "b.bvh").write_bytes(text[: len(text) // 2])
    status, told, complained = zeggs("prepare", corpus, "-o", out)
    assert (status, told) == (2, "")
    assert complained.count("\n") == 1
    assert "1 of 3 clips cannot be used (the first, calm/b: 'b.bvh' is cut off" in complained
    assert [problem["name"] for problem in json.loads((out / "report.json").read_text())["problems"]] == ["calm/b"]
    assert not (out / "manifest.json").exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("{t}/none", "-o", "{o}"), "'{t}/none' does not exist"),
        (("{t}/corpus/calm/a.bvh", "-o", "{o}"), "is a file"),
        (("{t}/empty", "-o", "{o}"), "holds no pairs of name.bvh and name.wav"),
        (("{t}/corpus", "-o", "{t}/corpus/"), "is the corpus itself; name another folder"),
        (("{t}/corpus", "-o", "{t}/corpus/out", "--save-trimmed"), "lies in the corpus"),
        (("{t}/corpus", "-o", "{t}/corpus/calm/a.bvh/out"), "cannot write to folder"),
        (("{t}/corpus", "-o", "{o}", "--processes", "0"), "give at least 1"),
        (("{t}/corpus", "-o", "{o}", "--rate", "0"), "give one above 0"),
        (("{t}/corpus", "-o", "{o}", "--min-frames", "3"), "at least 8"),
        (("{t}/corpus", "-o", "{o}", "--scale", "-1"), "the cm of one unit, above 0"),
        (("{t}/corpus", "-o", "{o}", "--up", "north"), "--up is 'north'; give one of auto, x"),
        (("{t}/corpus", "-o", "{o}", "--facing", "y"), "head along the hips' own y"),
        (("{t}/corpus", "-o", "{o}", "--skeleton", "{t}/none.toml"), "'{t}/none.toml' cannot be read"),
        (("{t}/corpus", "-o", "{o}", "--skeleton", "{t}/wrong.toml"), "nearest known one is 'scale'"),
    ],
)
def test_it_refuses_in_one_sentence(zeggs, corpus, out, tmp_path, words, sentence):
    (tmp_path / "empty").mkdir()
    (tmp_path / "wrong.toml").write_text("scal = 1\n")
    status, told, complained = zeggs("prepare", *(word.format(t=tmp_path, o=out) for word in words))
    assert (status, told) == (2, "")
    assert sentence.format(t=tmp_path) in complained
    assert complained.startswith("zeggs: ")
    assert complained.count("\n") == 1
    assert "Traceback" not in complained
    assert not list(tmp_path.rglob("manifest.json"))


def test_a_folder_of_the_users_named_as_ours_is_left_alone(zeggs, corpus, tmp_path):
    """The corpus lies in OUT/clips, where preparing keeps its own unfinished files."""
    shutil.move(corpus, tmp_path / "clips")
    before = {path: path.read_bytes() for path in (tmp_path / "clips").rglob("*") if path.is_file()}
    assert zeggs("prepare", tmp_path / "clips", "-o", tmp_path)[0] == 0
    assert {path: path.read_bytes() for path in (tmp_path / "clips").rglob("*") if path.is_file()} == before
