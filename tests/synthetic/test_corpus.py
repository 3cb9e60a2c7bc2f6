"""A corpus folder: files that fit each other, the same bytes for the same config, held-out styles apart."""

import csv
import json

import numpy as np
import pytest

from zeggs_jax.data import corpus as readers
from zeggs_jax.motion import bvh
from zeggs_jax.speech import wav
from zeggs_jax.synthetic import corpus, prosody

CONFIG = corpus.CorpusConfig(clips=3, seconds=(4.0, 6.0), seed=7, styles=("neutral", "sad"), random_share=0.34)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("synthetic")
    corpus.write(path, CONFIG)
    return path


def test_wav_and_bvh_have_one_length(folder):
    names = sorted(p.relative_to(folder).with_suffix("") for p in folder.rglob("*.bvh"))
    assert len(names) == 4
    for name in names:
        clip, wave = bvh.read(folder / f"{name}.bvh"), wav.read(folder / f"{name}.wav")
        assert round(30.0 * len(wave) / 16000.0) == len(clip.euler)
        assert bvh.rate_hz(clip.frame_time) == 30.0
        assert len(clip.skeleton.names) == 75


def test_transcript_says_where_the_words_are(folder):
    notes = json.loads((folder / "neutral_0000.json").read_text())
    level = prosody.envelope(wav.read(folder / "neutral_0000.wav"))
    assert {"text", "start", "end", "stressed"} <= set(notes["words"][0])
    stressed = [level[int(100 * w["nucleus"])] for w in notes["words"] if w["stressed"]]
    assert np.mean(np.array(stressed) > 0.3) > 0.9
    assert notes["factors"]["hand_height"] == -25.0
    assert len(notes["stresses"]) == len(stressed)


def test_index_is_read_as_a_corpus_and_held_out_styles_are_apart(folder):
    rows = list(csv.DictReader((folder / "corpus.csv").read_text().splitlines()))
    assert list(rows[0]) == ["name", "style", "split"]
    assert {row["style"] for row in rows} == {"neutral", "sad", "random2"}
    assert {entry.style for entry in readers.find(folder / corpus.HELD_OUT_FOLDER)} == {"oration"}
    assert len(readers.find(folder)) == 3


def test_same_config_same_bytes(folder, tmp_path):
    take = corpus.plan(CONFIG)[1]
    corpus.write_take(tmp_path, take, corpus.recording.speak(take.seconds, take.seed))
    for suffix in ("wav", "bvh", "json"):
        assert (tmp_path / f"{take.name}.{suffix}").read_bytes() == (folder / f"{take.name}.{suffix}").read_bytes()


def test_plan_covers_styles_and_splits():
    takes = corpus.plan(corpus.CorpusConfig(clips=200))
    assert len({take.name for take in takes}) == len(takes)
    random = sum(take.style.startswith("random") for take in takes)
    assert abs(random - 60) <= 1
    assert 10 <= sum(take.split == "valid" and "held_out" not in take.name for take in takes) <= 20
    assert all("oration" not in take.name for take in takes if "held_out" not in take.name)


@pytest.mark.parametrize("config", [corpus.CorpusConfig(clips=0), corpus.CorpusConfig(seconds=(9.0, 2.0))])
def test_impossible_corpora_are_refused(config):
    with pytest.raises(ValueError, match="make no corpus"):
        corpus.plan(config)


def test_unknown_styles_are_refused():
    with pytest.raises(ValueError, match="jolly"):
        corpus.plan(corpus.CorpusConfig(styles=("jolly",)))
