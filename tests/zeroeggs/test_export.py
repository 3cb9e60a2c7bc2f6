"""Laws of the exported step: a loop over it is the stream; its description is all that an engine has to know."""

import json
import sys

import jax
import numpy as np
import pytest

from zeggs_jax.zeroeggs import export
from zeggs_jax.zeroeggs.broadcast import Broadcast
from zeggs_jax.zeroeggs.steering import Request
from zeggs_jax.zeroeggs.stream import StreamSession


@pytest.fixture(scope="module")
def request_of(clips):
    return Request(styles=(str(clips / "old.bvh"),))


@pytest.fixture(scope="module")
def made(gesturer, request_of):
    return export.step(gesturer, request_of)


def rows(wave, session) -> np.ndarray:
    """All feature rows of a recording, the ends repeated as far as the encoder sees."""
    from zeggs_jax.speech import features as speech_features

    sees = session.model.config.speech
    found = speech_features.extract(wave, rate_hz=session.rate)
    return np.pad(found, ((sees.behind, sees.ahead), (0, 0)), mode="edge")


def test_a_loop_over_the_step_is_the_stream(gesturer, made, request_of, clips):
    from zeggs_jax.speech import wav

    wave = wav.read(clips / "speech.wav")
    session = StreamSession(gesturer, request_of, loudness=wav.loudness(wave))
    told = list(
        Broadcast(session).frames(jax.tree.map(lambda *p: np.concatenate(p), session.push(wave), session.flush()))
    )
    run, given, seen = jax.jit(made.run), list(made.start.values()), rows(wave, session)
    for number in range(1, 12):
        given[0] = seen[number : number + 31]
        *state, turns, place = run(*given)
        given[-len(state) :] = state
        np.testing.assert_allclose(place, told[number]["place"], atol=2e-3)
        np.testing.assert_allclose(np.abs(np.sum(turns * np.array(told[number]["turns"]), axis=-1)), 1.0, atol=1e-4)


def test_the_description_is_whole(gesturer, made, tmp_path):
    beside = export.write(tmp_path / "step.mlirbc", b"content", made, gesturer)
    assert (tmp_path / "step.mlirbc").read_bytes() == b"content"
    told = json.loads(beside.read_text())
    assert [one["name"] for one in told["inputs"]] == [*export.NAMES, *told["state"]]
    assert [one["name"] for one in told["outputs"]] == [*told["state"], "turns", "place"]
    shapes = {one["name"]: one["shape"] for one in told["outputs"]}
    assert shapes["turns"] == [75, 4]
    for one in told["inputs"]:
        assert len(one["start"]) == np.prod(one["shape"])
        assert shapes.get(one["name"], one["shape"]) == one["shape"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["step.json", "step.mlirbc"]


def test_stablehlo_is_portable_bytecode(made):
    content = export.stablehlo(made)
    assert content[:4] == b"ML\xefR"
    assert b"StableHLO_v" in content


def test_onnx_without_its_extra_is_one_sentence(made, monkeypatch):
    monkeypatch.setitem(sys.modules, "jax2onnx", None)
    with pytest.raises(ValueError, match=r"zeggs-jax\[onnx\]"):
        export.onnx(made)


@pytest.mark.slow
def test_onnx_gives_the_same_numbers_outside_jax(made):
    pytest.importorskip("jax2onnx")
    runtime = pytest.importorskip("onnxruntime")
    session = runtime.InferenceSession(export.onnx(made))
    names = [one.name for one in session.get_inputs()]
    given = list(made.start.values())
    given[0] = np.random.default_rng(0).normal(size=given[0].shape).astype(np.float32)
    found = session.run(None, dict(zip(names, given, strict=True)))
    for ours, theirs in zip(made.run(*given), found, strict=True):
        np.testing.assert_allclose(theirs, ours, atol=1e-5)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "--stablehlo FILE"),
        (("--stablehlo", "a.json"), "that of the description"),
        (("--stablehlo", "x.mlirbc", "--style", "hapy"), "unknown style 'hapy'"),
    ],
)
def test_what_cannot_be_exported_is_one_sentence(zeggs, tmp_path, monkeypatch, words, sentence):
    monkeypatch.chdir(tmp_path)
    status, _, err = zeggs("export", *words)
    assert (status, err.count("\n")) == (2, 1)
    assert sentence in err
