"""What experiment 14 makes of sentences in the joint space: meanings found again, words with meaning, marked text."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from zeggs_jax.diffuclip.stages.joint import Spoken
from zeggs_jax.speech.transcript import Word

PATH = Path(__file__).parents[1] / "experiments" / "14_joint_space.py"


@pytest.fixture(scope="module")
def space():
    spec = importlib.util.spec_from_file_location("experiment_14", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def spoken(text):
    return Spoken(0, tuple(Word(word, float(k), k + 0.5) for k, word in enumerate(text.split())))


@pytest.fixture
def heard(space):
    """Two sentences of each of two meanings; gestures point along their meaning, their own sentence the nearest."""
    said = [spoken(text) for text in ("a big fish", "the giant house", "go up now", "aloft it went")]
    z = np.array([[1.0, 0.1, 0.0], [1.0, 0.0, 0.1], [0.0, 1.0, 0.2], [0.0, 1.0, 0.0]])
    meant = [{1: ("big", False)}, {1: ("big", False)}, {1: ("up", False)}, {0: ("up", True)}]
    weights = [np.array(row) for row in ([0.1, 2.7, 0.2], [1.0, 1.5, 0.5], [1.2, 1.0, 0.8], [2.0, 0.5, 0.5])]
    return space.Heard(said, z, z, {"paper": weights, "rescaled": weights}, meant)


def test_meanings_are_found_in_other_sentences(space, heard):
    assert space.same_meaning(heard) == (1.0, pytest.approx(1 / 3), 4)
    swapped = heard._replace(z_t=heard.z_t[:, [1, 0, 2]])
    assert space.same_meaning(swapped)[0] == 0.0


def test_words_with_meaning_are_counted_by_kind(space, heard):
    share, even, count = space.top_words(heard, "rescaled", False)
    assert (share, even, count) == (pytest.approx(2 / 3), pytest.approx(1 / 3), 3)
    assert space.top_words(heard, "paper", True) == (1.0, pytest.approx(1 / 3), 1)


def test_a_corpus_without_meanings_has_retrieval_alone(space, heard):
    plain = heard._replace(meant=[{}] * 4)
    told = space.report(plain, heard.similarity)
    assert "R@10" in told
    assert "saliency" not in told
    assert set(space.numbers(plain, heard.similarity)) == {"retrieval", "by length"}


def test_meanings_belong_to_the_words_spoken_then(space):
    notes = [{"meaning": "big", "time": 1.2, "synonym": False}, {"meaning": "up", "time": 7.0, "synonym": False}]
    assert space._meant(spoken("a big fish"), notes) == {1: ("big", False)}


def test_report_and_figure(space, heard, tmp_path):
    told = space.report(heard, heard.similarity)
    assert "a **big** fish" in told
    assert "| words → gesture |" in told
    space.draw(tmp_path / "space.png", heard, heard.similarity)
    assert (tmp_path / "space.png").stat().st_size > 5000
