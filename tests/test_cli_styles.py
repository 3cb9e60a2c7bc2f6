"""`zeggs embed`, `zeggs styles`, the style flags of `zeggs generate`: what they make, one sentence for the rest."""

import functools
import json
import shutil
from dataclasses import replace

import jax
import numpy as np
import pytest
import soundfile

from zeggs_jax.motion import bvh
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs import library as libraries
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs import timeline as t
from zeggs_jax.zeroeggs.checkpoints import save_model

STYLES = ("happy", "old", "sad", "neutral")
bundled_model = functools.cache(g.bundled_model)


@pytest.fixture
def zeggs(zeggs, monkeypatch):
    """The command line, with the bundled model read once for all."""
    monkeypatch.setattr(g, "bundled_model", bundled_model)
    return zeggs


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A second of speech, libraries of the bundled model and of another, models of other kinds, and timelines."""
    where = tmp_path_factory.mktemp("styles")
    speech, rate = soundfile.read(next(iter(g.bundled_speech().values())))
    soundfile.write(where / "speech.wav", speech[:rate], rate)
    model = bundled_model()
    found = libraries.embed(STYLES, model, frames=((0, 90),))
    libraries.save(where / "lib.npz", found)
    libraries.save(where / "one.npz", found._replace(entries=found.entries[1:2]))
    libraries.save(where / "other.npz", found._replace(model="another"))
    same = [found.entries[0]._replace(name=str(k)) for k in range(3)]
    libraries.save(where / "same.npz", found._replace(entries=tuple(same)))
    shutil.copy(where / "speech.wav", where / "sound.npz")
    (where / "cut.npz").write_bytes((where / "lib.npz").read_bytes()[:-900])
    other = model._replace(params=jax.tree.map(lambda x: x * 1.01, model.params))
    save_model(where / "model", other, "float16")
    config = replace(
        model.config, labels=("calm", "wild"), style=m.StyleEncoderConfig(kind="label"),
        speech=replace(model.config.speech, hidden=4), decoder=m.DecoderConfig(hidden=4, layers=1),
    )  # fmt: skip
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))
    params = jax.tree.map(lambda leaf: np.zeros(leaf.shape, np.float32), shapes)
    save_model(where / "labels", m.Model(config, params, model.scales, model.skeleton))
    for name, cues in {
        "turns": [(0.0, "old", 1.0), (0.4, "happy", 1.0)], "strong": [(0.0, "old", 2.0)],
        "late": [(0.0, "old", 1.0), (3.0, "happy", 1.0)], "unknown": [(0.0, "old", 1.0), (0.4, "hapy", 1.0)],
    }.items():  # fmt: skip
        lines = t.Timeline(tuple(t.Cue(time, ((style, 1.0),), 0.5, intensity=much) for time, style, much in cues))
        t.write(where / f"{name}.json", lines)
    (where / "overlap.csv").write_text("time,style,transition\n0,old,\n0.2,happy,1\n0.4,old,1\n")
    return where


def test_embed_makes_a_library_that_generate_and_styles_read(zeggs, place, tmp_path):
    made = tmp_path / "new" / "mine.npz"
    status, told, _ = zeggs("embed", "old", "sad", "--frames", "0:90", "--label", "slow", "-o", made)
    assert (status, told) == (0, f"wrote {made}: 2 clips of 1 style\n")
    _, told, _ = zeggs("styles", "--library", made)
    assert [line.split()[:2] for line in told.splitlines()[1:]] == [["old", "slow"], ["sad", "slow"]]
    assert zeggs("embed", made, "happy", "-o", tmp_path / "more.npz")[1].endswith("3 clips of 2 styles\n")
    for style, name in ((f"{made}:old", "a"), (place / "lib.npz:old", "b"), (place / "one.npz", "c")):
        assert zeggs("generate", place / "speech.wav", "-s", style, "-o", tmp_path / f"{name}.bvh")[0] == 0
    assert (tmp_path / "a.bvh").read_bytes() == (tmp_path / "b.bvh").read_bytes() == (tmp_path / "c.bvh").read_bytes()


def test_the_flags_of_generate_are_the_request(zeggs, place, tmp_path):
    """The file made by the flags is the one made in Python; what is asked for stands in its provenance."""
    words = ("--library", place / "lib.npz", "--intensity", 1.5, "--pca", "1=+2.0", "--pca", "3=-1", "-s", "old")
    out, page = tmp_path / "out.bvh", tmp_path / "out.html"
    status, _, told = zeggs("generate", place / "speech.wav", *words, "-o", out, "--html", page)
    assert status == 0
    assert told.startswith("zeggs: note: intensity 1.5 of 'old' with component 1 +2, component 3 -1 lies ")
    assert told.count("\n") == 1
    request = g.Request(
        styles=("old",), library=str(place / "lib.npz"), intensity=1.5, pca=((1, 2.0), (3, -1.0)),
    )  # fmt: skip
    gesture = g.generate(place / "speech.wav", request, model=bundled_model())
    g.save(tmp_path / "same.bvh", gesture)
    assert out.read_bytes() == (tmp_path / "same.bvh").read_bytes()
    assert json.loads(out.with_suffix(".provenance.json").read_text())["arguments"]["pca"] == [[1, 2.0], [3, -1.0]]
    assert page.is_file()


def test_a_timeline_starts_with_its_first_style_and_ends_in_its_last(zeggs, place, tmp_path):
    words = ("generate", place / "speech.wav", "--library", place / "lib.npz", "--temperature", 0)
    out, page = tmp_path / "turns.bvh", tmp_path / "turns.html"
    assert zeggs(*words, "--timeline", place / "turns.json", "-o", out, "--html", page)[0] == 0
    assert zeggs(*words, "-s", "old", "-o", tmp_path / "old.bvh")[0] == 0
    turned, old = (bvh.read(path).euler for path in (out, tmp_path / "old.bvh"))
    np.testing.assert_array_equal(turned[:12], old[:12])  # 0.4 s
    assert np.abs(turned[-1] - old[-1]).max() > 0.01  # rad
    assert "old + happy" in page.read_text()


def test_without_a_style_components_start_from_the_mean(zeggs, place, tmp_path):
    for amount in (0, 1):
        words = ("--library", place / "lib.npz", "--pca", f"2={amount}", "-o", tmp_path / f"{amount}.bvh")
        assert zeggs("generate", place / "speech.wav", *words)[0] == 0
    assert (tmp_path / "0.bvh").read_bytes() != (tmp_path / "1.bvh").read_bytes()


def test_styles_finds_the_nearest_and_draws_the_map(zeggs, place, tmp_path):
    words = ("styles", "--library", place / "lib.npz")
    assert [line.split()[0] for line in zeggs(*words)[1].splitlines()] == ["name", *STYLES]
    picture = tmp_path / "new" / "space.svg"
    status, told, _ = zeggs(*words, "--nearest", "sad", "--count", 2, "--picture", picture)
    assert status == 0
    rows = told.splitlines()
    assert rows[0] == f"wrote {picture}"
    assert rows[2].split() == ["sad", "sad", "0.00"]
    assert len(rows) == 5
    assert "times as far out as the farthest clip" in rows[-1]
    assert "<svg" in picture.read_text()
    assert len(zeggs("styles", "--library", place / "one.npz", "--nearest", "sad")[1].splitlines()) == 2
    assert zeggs("styles", "--checkpoint", place / "labels")[1] == "calm\nwild\n"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--library", "{f}/lib.npz", "--pca", "9=1"), "component 9"),
        (("--library", "{f}/lib.npz", "--pca", "0=1"), "component 0"),
        (("--library", "{f}/lib.npz", "--pca", "1"), "give COMPONENT=AMOUNT"),
        (("--library", "{f}/lib.npz", "--pca", "first=1"), "give COMPONENT=AMOUNT"),
        (("--library", "{f}/lib.npz", "--pca", "1=big"), "'big' is no number"),
        (("--library", "{f}/lib.npz", "--pca", "1=nan"), "not finite"),
        (("--library", "{f}/lib.npz", "--pca", "1=1", "--pca", "1=2"), "one twice"),
        (("--library", "{f}/lib.npz", "--intensity", "inf"), "not finite"),
        (("--library", "{f}/one.npz", "--pca", "1=1"), "a library of 1 embedding"),
        (("--library", "{f}/one.npz", "--intensity", "2"), "a library of 1 embedding"),
        (("--library", "{f}/same.npz", "--pca", "1=1"), "3 equal embeddings"),
        (("--library", "{f}/other.npz"), "another checkpoint"),
        (("--library", "{f}/none.npz"), "none.npz' does not exist"),
        (("--library", "{f}/cut.npz"), "damaged"),
        (("--library", "{f}/sound.npz"), "is not a style library"),
        (("--library", "{f}"), "is a folder"),
        (("--style", "{f}/lib.npz"), "holds 4 styles"),
        (("--style", "{f}/lib.npz:hapy"), "nearest: happy"),
        (("--style", "{f}/other.npz:old"), "another checkpoint"),
        (("--style", "{f}/lib.npz:old", "--frames", "0:30"), "no frames to cut"),
        (("--timeline", "{f}/none.json"), "none.json' does not exist"),
        (("--timeline", "{f}/speech.wav"), "ends in .json or .csv"),
        (("--timeline", "{f}"), "ends in .json or .csv"),
        (("--timeline", "{f}/overlap.csv"), "line 4 of timeline 'overlap.csv'"),
        (("--library", "{f}/lib.npz", "--timeline", "{f}/late.json"), "the speech ends at 1 s"),
        (("--library", "{f}/lib.npz", "--timeline", "{f}/unknown.json"), "nearest: happy"),
        (("--library", "{f}/lib.npz", "--timeline", "{f}/turns.json", "-s", "old"), "names its styles itself"),
        (("--library", "{f}/lib.npz", "--timeline", "{f}/turns.json", "--spans", "1"), "names its styles itself"),
        (("--checkpoint", "{f}/model", "--intensity", "2"), "with --library"),
        (("--checkpoint", "{f}/model", "--pca", "1=2"), "with --library"),
        (("--checkpoint", "{f}/model", "--timeline", "{f}/strong.json"), "with --library"),
        (("--checkpoint", "{f}/model", "--library", "{f}/lib.npz"), "another checkpoint"),
        (("--checkpoint", "{f}/labels", "--pca", "1=2", "-s", "calm"), "steered by labels"),
    ],
)  # fmt: skip
def test_generate_refuses_in_one_sentence(zeggs, place, tmp_path, words, sentence):
    told = refused(zeggs, "generate", place / "speech.wav", *_at(words, place), "-o", tmp_path / "out.bvh")
    assert sentence in told
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("hapy",), "nearest: happy"),
        (("{f}/none.bvh",), "none.bvh"),
        (("{f}/speech.wav",), "speech.wav"),
        (("{f}",), "holds no pairs"),
        (("{f}/other.npz",), "another checkpoint"),
        (("old", "old"), "2 entries called 'old'"),
        (("{f}/lib.npz", "--frames", "0:30"), "no frames to cut"),
        (("old", "--frames", "0:30", "0:40"), "2 frame ranges for 1"),
        (("old", "--frames", "90:90"), "START:STOP"),
        (("old", "--frames", "0:99999"), "frames"),
        (("old", "sad", "happy", "--label", "a", "b"), "2 labels for 3"),
        (("calm", "--checkpoint", "{f}/labels"), "steered by labels"),
        (("old", "--checkpoint", "{f}/none"), "none"),
    ],
)
def test_embed_refuses_in_one_sentence(zeggs, place, tmp_path, words, sentence):
    assert sentence in refused(zeggs, "embed", *_at(words, place), "-o", tmp_path / "out.npz")
    assert not list(tmp_path.iterdir())


def test_embed_writes_nothing_over_and_nothing_else(zeggs, place, tmp_path):
    before = (place / "one.npz").read_bytes()
    assert "written over" in refused(zeggs, "embed", place / "one.npz", "sad", "-o", place / "one.npz")
    assert "written over" in refused(
        zeggs, "generate", place / "speech.wav", "-s", place / "one.npz:old", "-o", place / "one.npz"
    )
    assert before == (place / "one.npz").read_bytes()
    assert "ends in .npz" in refused(zeggs, "embed", "old", "-o", tmp_path / "old.bvh")
    (tmp_path / "folder.npz").mkdir()
    assert "is a folder" in refused(zeggs, "embed", "old", "-o", tmp_path / "folder.npz")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--library", "{f}/one.npz", "--picture", "{t}/a.png"), "a library of 1 embedding"),
        (("--library", "{f}/same.npz", "--picture", "{t}/a.png"), "3 equal embeddings"),
        (("--library", "{f}/lib.npz", "--picture", "{t}/a.gif"), ".png, .svg"),
        (("--library", "{f}/lib.npz", "--picture", "{t}"), "is a folder"),
        (("--library", "{f}/lib.npz", "--picture", "{f}/lib.npz"), "written over"),
        (("--library", "{f}/lib.npz", "--nearest", "hapy"), "nearest: happy"),
        (("--library", "{f}/lib.npz", "--nearest", "old", "--count", "0"), "1 or more"),
        (("--library", "{f}/lib.npz", "--count", "3"), "give --nearest too"),
        (("--library", "{f}/other.npz"), "another checkpoint"),
        (("--library", "{f}/speech.wav"), "is not a style library"),
        (("--checkpoint", "{f}/model", "--nearest", "old"), "with --library"),
        (("--checkpoint", "{f}/labels", "--nearest", "calm"), "steered by labels"),
    ],
)
def test_styles_refuses_in_one_sentence(zeggs, place, tmp_path, words, sentence):
    words = [word.replace("{t}", str(tmp_path)) for word in words]
    assert sentence in refused(zeggs, "styles", *_at(words, place))
    assert not list(tmp_path.iterdir())


def refused(zeggs, *words) -> str:
    """What is said to a command line that ends with exit status 2 and one sentence."""
    status, _, told = zeggs(*words)
    assert (status, told.count("\n")) == (2, 1), told
    assert told.startswith("zeggs: ")
    return told


def _at(words, place):
    return [word.replace("{f}", str(place)) for word in words]
