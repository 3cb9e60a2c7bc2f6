"""Settings of a run that cannot work are refused in one sentence; a run stays with the corpus it began on."""

import json
import os

import pytest

from zeggs_jax.data import prepare as preparation
from zeggs_jax.training.plain import from_dict
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs import train as t


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("steps", 0), ("log_every", 0), ("checkpoint_every", 0), ("keep", 0), ("seed", -1), ("seed", 2**32),
        ("learning_rate", 0.0), ("learning_rate", float("inf")), ("learning_rate", float("nan")),
        ("clip_norm", 0.0), ("ema", 1.0), ("ema", -0.1), ("explode", 1.0), ("explode", float("inf")),
        ("accumulate", 0), ("validate_every", -1), ("validate_clips", 0), ("sample_every", -1), ("keep_every", -1),
        ("decay", 0.0), ("decay", 1.1), ("eps", 0.0), ("eps", float("nan")),
    ],
)  # fmt: skip
def test_numbers_out_of_range_are_named(name, value):
    with pytest.raises(ValueError, match=f"^{name} is .*must be"):
        t.TrainConfig(**{name: value})


def test_parts_must_divide_the_batch():
    with pytest.raises(ValueError, match="accumulate is 3; it must be a number that divides the batch of 32"):
        t.TrainConfig(accumulate=3)


def test_options_that_are_off_are_null():
    given = {"clip_norm": 5, "ema": None, "explode": None, "matmul": "bfloat16"}
    config = from_dict(t.TrainConfig, given)
    assert (config.clip_norm, config.ema, config.explode, config.matmul) == (5.0, None, None, "bfloat16")
    with pytest.raises(ValueError, match=r"config\.clip_norm is 'no'; expected float"):
        from_dict(t.TrainConfig, {"clip_norm": "no"})
    with pytest.raises(ValueError, match=r"config\.matmul is 'float16'; expected one of 'float32', 'bfloat16'"):
        from_dict(t.TrainConfig, {"matmul": "float16"})


def test_the_ends_of_the_ranges_are_allowed():
    t.TrainConfig(steps=1, log_every=1, checkpoint_every=1, keep=1, seed=2**32 - 1, decay=1.0)


@pytest.mark.parametrize(
    "model",
    [
        {"speech": {"dropout": 1.0}}, {"style": {"dropout": -0.1}}, {"style": {"block_dropout": float("nan")}},
        {"style": {"heads": 3}}, {"style": {"heads": 0}}, {"decoder": {"layers": 0}}, {"speech": {"hidden": -4}},
    ],
)  # fmt: skip
def test_networks_that_cannot_be_built_are_refused(model):
    with pytest.raises(ValueError, match=r"must be|at least 1|heads do not divide"):
        from_dict(m.ZeroEggsConfig, model)


@pytest.mark.parametrize("example", [[8], [8, 12, 16], []])
def test_a_pair_of_another_length_is_named(example):
    with pytest.raises(ValueError, match=rf"^config\.windows\.example has {len(example)} values; expected 2\.$"):
        from_dict(t.TrainConfig, {"windows": {"example": example}})


@pytest.mark.parametrize("labels", [[], ["calm"], ["calm", "wild", "old"]])
def test_a_tuple_of_any_length_stays_free(labels):
    style = {"kind": "label"} if labels else {}
    assert from_dict(m.ZeroEggsConfig, {"labels": labels, "style": style}).labels == tuple(labels)


@pytest.fixture
def made(monkeypatch) -> list:
    """What was prepared, with which settings; nothing is computed."""
    calls = []

    def prepare(corpus, out, config):
        columns = {"speech_columns": config.speech_columns}
        manifest = {"config": columns, "source": corpus.name, "made_of": preparation.made_of(corpus, config)}
        calls.append((corpus.name, config.speech_columns))
        out.mkdir(parents=True, exist_ok=True)
        (out / "manifest.json").write_text(json.dumps(manifest))

    monkeypatch.setattr(preparation, "prepare", prepare)
    return calls


@pytest.fixture
def corpora(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        for suffix in ("bvh", "wav"):
            (tmp_path / name / f"a.{suffix}").write_text(name)
    return tmp_path / "one", tmp_path / "two"


def test_a_corpus_is_prepared_once(corpora, made, tmp_path):
    run = tmp_path / "run"
    assert t.prepared(corpora[0], run) == t.prepared(corpora[0], run) == run / "prepared"
    assert made == [("one", False)]


def test_another_corpus_is_not_taken_for_the_first(corpora, made, tmp_path):
    t.prepared(corpora[0], tmp_path / "run")
    with pytest.raises(ValueError, match=r"run '.*run' was started on a corpus 'one', and '.*two' is another one"):
        t.prepared(corpora[1], tmp_path / "run")
    assert t.prepared(tmp_path / "run" / "prepared", tmp_path / "run") == tmp_path / "run" / "prepared"


def test_changed_files_are_noticed_by_what_they_hold(corpora, made, tmp_path):
    """Not by size or time: a copy with its old date does not pass, the same file with another date does."""
    t.prepared(corpora[0], tmp_path / "run")
    wav = corpora[0] / "a.wav"
    before = wav.stat()
    os.utime(wav, ns=(1, 1))
    t.prepared(corpora[0], tmp_path / "run")
    wav.write_text("eno")
    os.utime(wav, ns=(before.st_atime_ns, before.st_mtime_ns))
    with pytest.raises(ValueError, match="or has changed since") as caught:
        t.prepared(corpora[0], tmp_path / "run")
    assert "\n" not in str(caught.value)


def test_a_moved_corpus_is_the_same(corpora, made, tmp_path):
    t.prepared(corpora[0], tmp_path / "run")
    (tmp_path / "elsewhere").mkdir()
    moved = corpora[0].rename(tmp_path / "elsewhere" / "one")
    assert t.prepared(moved, tmp_path / "run") == tmp_path / "run" / "prepared"
    assert len(made) == 1


def test_a_half_written_folder_is_prepared_again(corpora, made, tmp_path):
    folder = t.prepared(corpora[0], tmp_path / "run")
    (folder / "manifest.json").unlink()
    t.prepared(corpora[1], tmp_path / "run")
    assert made == [("one", False), ("two", False)]
    t.prepared(corpora[1], tmp_path / "run")


@pytest.mark.parametrize("content", ["{", "{}", "[]"])
def test_a_damaged_manifest_is_said(corpora, made, tmp_path, content):
    (t.prepared(corpora[0], tmp_path / "run") / "manifest.json").write_text(content)
    with pytest.raises(ValueError, match=r"^'.*manifest\.json' is damaged: delete '.*prepared', and the same command"):
        t.prepared(corpora[0], tmp_path / "run")


def test_a_missing_corpus_is_said(made, tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        t.prepared(tmp_path / "none", tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_speech_columns_reach_the_preparation(corpora, made, tmp_path):
    config = from_dict(t.TrainConfig, {"speech_columns": True})
    t.prepared(corpora[0], tmp_path / "run", config.speech_columns)
    assert made == [("one", True)]
    with pytest.raises(ValueError, match="speech_columns = True, now it is False"):
        t.prepared(corpora[0], tmp_path / "run")
