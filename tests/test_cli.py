"""The command line on the bundled model: what it writes, and one sentence for each wrong input."""

import json
import shutil

import numpy as np
import pytest
import soundfile

from zeggs_jax.motion import bvh, features
from zeggs_jax.nn import native
from zeggs_jax.zeroeggs import examples
from zeggs_jax.zeroeggs import generate as g


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One recording of 1.5 s, a style clip, and everything that can be wrong with them."""
    where = tmp_path_factory.mktemp("cli")
    speech, rate = soundfile.read(next(iter(g.bundled_speech().values())))
    soundfile.write(where / "speech.wav", speech[: int(1.5 * rate)], rate)
    soundfile.write(where / "empty.wav", speech[:0], rate)
    (where / "text.wav").write_text("this is no sound")
    text = examples.bundled()["old"].read_text()
    (where / "old.bvh").write_text(text)
    (where / "cut.bvh").write_text(text[: int(0.7 * len(text))])
    lines = text.splitlines()
    (where / "nan.bvh").write_text(
        "\n".join([*lines[:-3], lines[-3].replace(lines[-3].split()[7], "nan", 1), *lines[-2:]])
    )
    (where / "other.bvh").write_text(text.replace("RightHandThumb4", "Tail"))
    clip = bvh.read(where / "old.bvh")
    bvh.write(where / "short.bvh", clip._replace(euler=clip.euler[:3], positions=clip.positions[:3]))
    (where / "file").write_text("")
    model = where / "model"
    shutil.copytree(g.BUNDLE / "model", model)
    largest = max((path for path in model.rglob("*") if path.is_file()), key=lambda path: path.stat().st_size)
    damaged = bytearray(largest.read_bytes())
    damaged[len(damaged) // 2] ^= 0xFF
    largest.write_bytes(damaged)
    return where


def test_generate_writes_motion_provenance_and_page(zeggs, folder, tmp_path):
    out, page = tmp_path / "new" / "out.bvh", tmp_path / "out.html"
    status, told, _ = zeggs("generate", folder / "speech.wav", "--style", "old", "-o", out, "--html", page)
    assert status == 0
    assert "45 frames" in told
    clip = bvh.read(out)
    assert clip.euler.shape == (45, 75, 3)
    assert np.isfinite(clip.euler).all()
    assert json.loads(out.with_suffix(".provenance.json").read_text())["arguments"]["styles"] == ["old"]
    assert "http" not in page.read_text().replace("http-equiv", "").replace("http://www.w3.org", "")


def test_weights_of_fewer_bytes_move_the_body_alike_and_say_where_they_bring_nothing(
    zeggs, folder, tmp_path, monkeypatch
):
    monkeypatch.setattr(native, "problem", lambda: "no compiler.")
    made = {}
    for precision in ("float32", "int8"):
        out = tmp_path / f"{precision}.bvh"
        status, _, complaint = zeggs("generate", folder / "speech.wav", "-o", out, "--precision", precision)
        assert status == 0
        assert complaint == ("" if precision == "float32" else "zeggs: note: no compiler.\n")
        assert json.loads(out.with_suffix(".provenance.json").read_text())["precision"] == precision
        made[precision] = features.world_positions(bvh.read(out))
    far = np.linalg.norm(made["int8"] - made["float32"], axis=-1)
    assert 0.0 < far.max() < 1.0  # cm


def test_embed_then_generate_is_generate(zeggs, folder, tmp_path):
    assert zeggs("embed", "happy", "-o", tmp_path / "happy.npz")[0] == 0
    for style, name in (("happy", "a"), (tmp_path / "happy.npz", "b")):
        assert zeggs("generate", folder / "speech.wav", "--style", style, "-o", tmp_path / f"{name}.bvh")[0] == 0
    assert (tmp_path / "a.bvh").read_bytes() == (tmp_path / "b.bvh").read_bytes()


def test_styles_lists_the_bundled_ones(zeggs):
    assert {"neutral", "happy", "old", "oration"} <= set(zeggs("styles")[1].split())


def test_convert_back_writes_plain_arrays(zeggs, tmp_path):
    assert zeggs("convert", "--to-torch", g.BUNDLE / "model", "-o", tmp_path / "arrays.npz")[0] == 0
    with np.load(tmp_path / "arrays.npz") as arrays:
        assert (
            arrays["decoder/recurrent_decoder.layer1.weight_hh_l0"].shape[0]
            == 3 * arrays["decoder/recurrent_decoder.layer1.weight_hh_l0"].shape[1]
        )


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("{f}/missing.wav",), "missing.wav"),
        (("{f}/text.wav",), "text.wav"),
        (("{f}/empty.wav",), "empty.wav"),
        ((), "no speech was given"),
        (("{f}/speech.wav", "--style", "{f}/missing.bvh"), "missing.bvh"),
        (("{f}/speech.wav", "--style", "{f}/cut.bvh"), "cut.bvh"),
        (("{f}/speech.wav", "--style", "{f}/other.bvh"), "RightHandThumb4"),
        (("{f}/speech.wav", "--style", "{f}/nan.bvh"), "nan.bvh"),
        (("{f}/speech.wav", "--style", "{f}/short.bvh"), "3 frames"),
        (("{f}/speech.wav", "--style", "hapy"), "happy"),
        (("{f}/speech.wav", "--style", "old", "--frames", "10:9999"), "frames 0:"),
        (("{f}/speech.wav", "--style", "old", "--frames", "10-20"), "START:STOP"),
        (
            ("{f}/speech.wav", "--style", "old", "--style", "happy", "--weights", "0.5"),
            "1 weights for 2 styles",
        ),
        (("{f}/speech.wav", "--style", "old", "--style", "happy", "--weights", "0.5", "0.9"), "sum to 1.4"),
        (("{f}/speech.wav", "--checkpoint", "{f}/model"), "damaged"),
        (("{f}/speech.wav", "--checkpoint", "{f}"), "checkpoint"),
        (("{f}/speech.wav", "--checkpoint", "{f}/none"), "none"),
        (("--csv", "{f}/none.csv"), "none.csv"),
        (("{f}/speech.wav", "--csv", "{f}/none.csv"), "leave SPEECH"),
    ],
)
def test_wrong_input_ends_in_one_sentence_and_no_file(zeggs, folder, tmp_path, words, sentence):
    out = tmp_path / "out.bvh"
    status, _, told = zeggs("generate", *(word.format(f=folder) for word in words), "-o", out)
    assert status == 2
    assert sentence in told
    assert told.startswith("zeggs: ")
    assert told.count("\n") == 1
    assert "Traceback" not in told
    assert not out.is_file()


def test_a_folder_that_cannot_be_written_is_named_before_any_work(zeggs, folder):
    status, _, told = zeggs("generate", folder / "speech.wav", "-o", folder / "file" / "out.bvh")
    assert status == 2
    assert "cannot write to folder" in told


def test_nothing_that_is_read_is_written_over(zeggs, folder):
    for words in (
        ("{f}/speech.wav", "-o", "{f}/speech.wav"),
        ("{f}/speech.wav", "-s", "{f}/old.bvh", "-o", "{f}/old.bvh"),
    ):
        before = (folder / "speech.wav").read_bytes(), (folder / "old.bvh").read_bytes()
        status, _, told = zeggs("generate", *(word.format(f=folder) for word in words))
        assert status == 2
        assert "would be written over" in told
        assert before == ((folder / "speech.wav").read_bytes(), (folder / "old.bvh").read_bytes())
    assert "is a folder" in zeggs("generate", folder / "speech.wav", "-o", folder)[2]


def test_a_checkpoint_of_another_config_names_the_parameter(zeggs, folder, tmp_path):
    from zeggs_jax.training import checkpoint

    tree, metadata = checkpoint.load(g.BUNDLE / "model")
    metadata["model"]["decoder"]["hidden"] += 1
    checkpoint.save(tmp_path / "other", tree, metadata)
    status, _, told = zeggs(
        "generate", folder / "speech.wav", "--checkpoint", tmp_path / "other", "-o", tmp_path / "o.bvh"
    )
    assert status == 2
    assert "decoder" in told
    assert "config" in told


@pytest.mark.parametrize("words", [(), ("--help",), ("generat",), ("generate", "--stile", "old")])
def test_usage_errors_are_no_tracebacks(zeggs, words):
    status, out, told = zeggs(*words)
    assert status in (0, 2)
    assert "Traceback" not in out + told


def test_all_settings_of_a_training_are_printed(zeggs, tmp_path):
    (tmp_path / "few.json").write_text('{"ema": 0.99}')
    status, told, _ = zeggs("train", "--print-config", "--config", tmp_path / "few.json", "--steps", 7)
    assert status == 0
    assert json.loads(told)["windows"]["window"] == 256
    (tmp_path / "all.json").write_text(told)
    assert zeggs("train", "--print-config", "--config", tmp_path / "all.json")[1] == told
    assert (json.loads(told)["ema"], json.loads(told)["steps"]) == (0.99, 7)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "needs a corpus and --out"),
        (("{t}/none", "-o", "{t}/run"), "'{t}/none' does not exist"),
        (("{t}", "-o", "{t}/run", "--steps", "-1"), "steps is -1"),
        (("{t}", "-o", "{t}/run", "--config", "{t}/none.json"), "none.json"),
        (
            ("{t}", "-o", "{t}/run", "--config", "{t}/wrong.json"),
            "unknown key 'stepps'; the nearest known one is 'steps'",
        ),
        (("{t}", "-o", "{t}/run", "--processes", "2"), "--coordinator"),
        (("{t}/damaged", "-o", "{t}/run"), "is damaged"),
    ],
)
def test_training_refuses_in_one_sentence(zeggs, tmp_path, words, sentence):
    (tmp_path / "wrong.json").write_text('{"stepps": 3}')
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "manifest.json").write_text('{"format": 1}')
    status, _, told = zeggs("train", *(word.format(t=tmp_path) for word in words))
    assert (status, told.count("\n")) == (2, 1)
    assert sentence.format(t=tmp_path) in told
    assert "Traceback" not in told
