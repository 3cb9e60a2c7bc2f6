"""Empty tables, a file for a folder, clips that the motion room refuses: each error names the file."""

import pytest

from zeggs_jax.data import corpus, takes
from zeggs_jax.data.prepare import PrepareConfig, prepare
from zeggs_jax.motion import edit, features

from .conftest import add_pair


@pytest.mark.parametrize("table", ["corpus.csv", "info.csv"])
def test_an_empty_table_is_named(tmp_path, table):
    (tmp_path / table).touch()
    with pytest.raises(ValueError, match=f"{table}' has no column"):
        corpus.find(tmp_path)


def test_a_file_is_no_corpus(tmp_path):
    (tmp_path / "text.wav").touch()
    with pytest.raises(FileNotFoundError, match=r"text\.wav' is a file; a folder .* was expected"):
        corpus.find(tmp_path / "text.wav")


@pytest.mark.parametrize(
    ("room", "name", "config"),
    [
        (features, "encode", PrepareConfig()),
        (edit, "centre", PrepareConfig()),
        (edit, "retime", PrepareConfig(pace=(0.9,), centre=False)),
        (edit, "resample", PrepareConfig(rate_hz=30)),
    ],
)
def test_errors_of_a_clip_name_its_file(tmp_path, monkeypatch, room, name, config):
    def fail(*_, **__):
        raise ValueError("the joints do not fit.")

    add_pair(tmp_path / "corpus", "a", 20)
    monkeypatch.setattr(room, name, fail)
    with pytest.raises(ValueError, match=r"a: '.*a\.bvh': the joints do not fit\)"):
        prepare(tmp_path / "corpus", tmp_path / "out", config)


def test_only_value_errors_are_renamed(tmp_path):
    with pytest.raises(KeyError), takes.naming(tmp_path):
        raise KeyError("a")
