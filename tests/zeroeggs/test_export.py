"""Laws of the exported step: a loop over it is the stream; its description is all that an engine has to know."""

import json
import sys

import jax
import numpy as np
import pytest

import exported_step
from zeggs_jax.motion import features as motion_features
from zeggs_jax.motion.pose import Root
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import wav
from zeggs_jax.zeroeggs import export, synthesis
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs.steering import Request


@pytest.fixture(scope="module")
def request_of(clips):
    return Request(styles=(str(clips / "old.bvh"),))


@pytest.fixture(scope="module")
def made(gesturer, request_of):
    return export.step(gesturer, request_of)


@pytest.fixture(scope="module")
def told(made, gesturer):
    """The description, as it is read from its file."""
    return json.loads(json.dumps(export.describe(made, gesturer)))


@pytest.fixture(scope="module")
def wave(clips):
    return wav.read(clips / "speech.wav")


def engine(run, told, wave):
    """What an engine makes of a recording with the recipe of the example; nothing of the package is called."""
    rows = exported_step.speech_rows(wave * wav.gain(wav.loudness(wave)), told)
    behind, ahead = told["seen"]["behind"], told["seen"]["ahead"]
    rows = np.pad(rows, ((behind, ahead), (0, 0)), mode="edge")
    spectra = [rows[t : t + behind + 1 + ahead] for t in range(1, len(rows) - behind - ahead)]
    return exported_step.perform(run, told, spectra)


def assert_as_synthesized(found, gesturer, request_of, wave):
    """The frames after the first are those of `synthesize`, in the world in which the body starts in the middle."""
    turns, places, _ = found
    asked = g.prepare(wave, request_of, gesturer)
    made = synthesis.synthesize(gesturer, *asked.told)
    origin = Root(made.root.pos[0], made.root.rot[0] / np.linalg.norm(made.root.rot[0]))
    rotations, positions = jax.vmap(motion_features.joints, (0, None))(made, origin)
    assert len(turns) == len(rotations) - 1 > 30
    turn, place = exported_step.apart(turns, places, rotations[1:], positions[1:, 0])
    assert turn < 1e-4
    assert place < 2e-3


def test_a_loop_over_the_step_is_what_synthesize_makes(gesturer, made, told, request_of, wave):
    assert_as_synthesized(engine(lambda given: jax.jit(made.run)(*given), told, wave), gesturer, request_of, wave)


@pytest.mark.parametrize("log_mel", [False, True])
def test_the_recipe_of_the_features_is_ours(told, wave, log_mel):
    config = speech_features.SpeechFeatureConfig(log_mel=log_mel, normalize_loudness=False)
    told = told | {"features": told["features"] | {"log_mel": log_mel}}
    expected = speech_features.extract(wave, rate_hz=told["rate"], config=config)
    np.testing.assert_allclose(exported_step.speech_rows(wave, told), expected, atol=2e-5)


def test_the_description_is_whole(gesturer, made, tmp_path):
    beside = export.write(tmp_path / "step.mlirbc", b"content", made, gesturer)
    assert (tmp_path / "step.mlirbc").read_bytes() == b"content"
    told = json.loads(beside.read_text())
    assert [one["name"] for one in told["inputs"]] == [*export.NAMES, *told["state"].values()]
    assert [one["name"] for one in told["outputs"]] == [*told["state"], "turns", "place"]
    ins, outs = ({one["name"]: one["shape"] for one in told[side]} for side in ("inputs", "outputs"))
    assert outs["turns"] == [75, 4]
    assert not ins.keys() & outs.keys()  # ONNX has one room of names
    assert all(outs[out] == ins[into] for out, into in told["state"].items())
    assert all(len(one["start"]) == np.prod(one["shape"]) for one in told["inputs"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["step.json", "step.mlirbc"]


def test_stablehlo_is_portable_bytecode_without_what_is_not_used(made, gesturer):
    content = export.stablehlo(made)
    assert content[:4] == b"ML\xefR"
    assert b"StableHLO_v" in content
    form = synthesis.ready(gesturer)
    needed = sum(4 * a.size for a in jax.tree.leaves((form.speech, form.folded)))
    assert needed < len(content) < 1.1 * needed + 60_000


def test_onnx_without_its_extra_is_one_sentence(made, monkeypatch):
    monkeypatch.setitem(sys.modules, "jax2onnx", None)
    with pytest.raises(ValueError, match=r"zeggs-jax\[onnx\]"):
        export.onnx(made)


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["onnx", "mlirbc"])
def test_outside_jax_the_same_speech_makes_the_same_motion(
    gesturer, made, told, request_of, wave, tmp_path, monkeypatch, capsys, ending
):
    for name in {"onnx": ("jax2onnx", "onnxruntime"), "mlirbc": ("iree.compiler", "iree.runtime")}[ending]:
        pytest.importorskip(name)
    path = tmp_path / f"step.{ending}"
    export.write(path, (export.onnx if ending == "onnx" else export.stablehlo)(made), made, gesturer)
    run = exported_step.by_onnxruntime(path) if ending == "onnx" else exported_step.by_iree(path)
    assert_as_synthesized(engine(run, told, wave), gesturer, request_of, wave)
    monkeypatch.setattr(sys, "argv", ["exported_step.py", str(path), "--frames", "5"])
    exported_step.main()
    out = capsys.readouterr().out
    assert "against JAX: rotations differ by" in out
    assert "5 frames of 75 joints" in out


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
