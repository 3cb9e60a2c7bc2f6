"""Generation with a small random model: laws first, then files, tables and wrong input."""

import json

import jax
import numpy as np
import pytest

from zeggs_jax.data import scale
from zeggs_jax.motion import bvh, edit, features, pose
from zeggs_jax.zeroeggs import batch, examples, steering
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs.checkpoints import digest
from zeggs_jax.zeroeggs.model import encode_style


@pytest.fixture(scope="module")
def folder(clips):
    return clips


@pytest.fixture(scope="module")
def model(gesturer):
    return gesturer


def ask(folder, *styles, **settings):
    return g.Request(styles=tuple(str(folder / f"{style}.bvh") for style in styles), **settings)


def test_frames_follow_rate_and_duration(folder, model):
    gesture = g.generate(folder / "speech.wav", ask(folder, "old"), model=model)
    assert len(gesture.clip.euler) == round(30 * 20_800 / 16_000) == len(gesture.style)
    assert np.isfinite(gesture.clip.euler).all()


def test_same_seed_same_bytes_other_seed_other_motion(folder, model, tmp_path):
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        path = g.save(
            tmp_path / f"{name}.bvh",
            g.generate(folder / "speech.wav", ask(folder, "old", seed=seed), model=model),
        )
        texts.append(path.read_bytes())
    assert texts[0] == texts[1]
    assert texts[0] != texts[2]


def test_temperature_zero_is_the_mean_whatever_the_seed(folder, model):
    styles = [
        np.asarray(g.generate(folder / "speech.wav", ask(folder, "old", seed=s, temperature=0.0), model=model).style)
        for s in (1, 2)
    ]
    mean = np.asarray(examples.read(str(folder / "old.bvh"), model).distribution.mean)
    np.testing.assert_array_equal(styles[0], styles[1])
    np.testing.assert_allclose(styles[0][0], mean, rtol=1e-6)


def test_higher_temperature_varies_more(folder, model):
    chosen = g.read_styles(ask(folder, "old"), model)
    draw = lambda seed, t: g.style_sequence(g.Request(styles=("x",), seed=seed, temperature=t), chosen, 1)[0]  # noqa: E731
    spread = [np.ptp([draw(seed, t) for seed in range(8)], axis=0).mean() for t in (0.0, 0.5, 1.0, 2.0)]
    assert 0.0 == spread[0] < spread[1] < spread[2] < spread[3]


def test_a_blend_is_linear_and_all_weight_on_one_style_is_that_style(folder, model):
    one = ask(folder, "old", temperature=0.0)
    both = ask(folder, "old", "happy", temperature=0.0)
    old, happy = (np.asarray(e.distribution.mean) for e in g.read_styles(both, model))
    chosen = g.read_styles(both, model)
    mixed = np.asarray(g.style_sequence(both._replace(weights=(0.25, 0.75)), chosen, 3))
    np.testing.assert_allclose(mixed, np.tile(0.25 * old + 0.75 * happy, (3, 1)), rtol=1e-5, atol=1e-6)
    alone = np.asarray(g.style_sequence(both._replace(weights=(1.0, 0.0)), chosen, 3))
    np.testing.assert_allclose(alone, np.asarray(g.style_sequence(one, chosen[:1], 3)), rtol=1e-6)


def test_spans_follow_each_other(folder, model):
    both = ask(folder, "old", "happy", temperature=0.0, spans=(0.4, 0.6))
    chosen = g.read_styles(both, model)
    sequence = np.asarray(g.style_sequence(both, chosen, 10))
    np.testing.assert_allclose(sequence[3], chosen[0].distribution.mean, rtol=1e-6)
    np.testing.assert_allclose(sequence[4], chosen[1].distribution.mean, rtol=1e-6)


def test_frames_are_those_of_the_cut_clip(folder, model):
    cut = examples.read(str(folder / "old.bvh"), model, (10, 50))
    clip = edit.trim(bvh.read(folder / "old.bvh"), 10, 50)
    vectors = jax.vmap(pose.to_vector)(features.encode(clip).pose)
    expected = encode_style(model.params, model.config, model.scales, vectors)
    np.testing.assert_allclose(cut.distribution.mean, expected.mean, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(cut.distribution.log_var, expected.log_var, rtol=1e-5, atol=1e-6)


def test_body_starts_from_the_last_style_or_the_first_pose(folder, model):
    request = ask(folder, "old", "happy")
    chosen = g.read_styles(request, model)
    last = features.encode(bvh.read(folder / "happy.bvh"))
    start = g.starting_pose(request, chosen, model)
    np.testing.assert_allclose(start.pose.joint_pos[0], last.pose.joint_pos[0], rtol=1e-6)
    other = g.starting_pose(request._replace(first_pose=str(folder / "old.bvh")), chosen, model)
    old = features.encode(bvh.read(folder / "old.bvh"))
    np.testing.assert_allclose(other.pose.joint_axes[0], old.pose.joint_axes[0], rtol=1e-6)


def test_a_clip_of_another_rate_is_brought_to_the_models(folder, model, tmp_path):
    bvh.write(tmp_path / "fast.bvh", edit.resample(bvh.read(folder / "old.bvh"), 60.0))
    fast = examples.read(str(tmp_path / "fast.bvh"), model).distribution.mean
    np.testing.assert_allclose(fast, examples.read(str(folder / "old.bvh"), model).distribution.mean, atol=0.02)


def test_provenance_lies_beside_the_motion(folder, model, tmp_path):
    g.save(tmp_path / "out.bvh", g.generate(folder / "speech.wav", ask(folder, "old", seed=7), model=model))
    told = json.loads((tmp_path / "out.provenance.json").read_text())
    assert told["seed"] == 7
    assert len(told["model_sha256"]) == 64
    assert told["arguments"]["styles"] == [str(folder / "old.bvh")]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.bvh", "out.provenance.json"]


@pytest.mark.parametrize(
    ("request_of", "sentence"),
    [
        (lambda f: ask(f, "old", "happy", weights=(1.0,)), "got 1 weights for 2 styles"),
        (lambda f: ask(f, "old", "happy", weights=(0.5, 0.9)), "sum to 1.4"),
        (lambda f: ask(f, "old", "happy", spans=(0.5, 0.2)), "sum to 0.7"),
        (lambda f: ask(f, "old", "happy", weights=(0.5, 0.5), spans=(0.5, 0.5)), "both weights and spans"),
        (lambda f: ask(f, "old", frames=((0, 999),)), "not in the clip, which has frames 0:60"),
        (lambda f: ask(f, "old", frames=((0, 3),)), "3 frames"),
        (lambda f: ask(f, "old", temperature=-1.0), "temperature is -1"),
        (lambda f: ask(f, "old", temperature=float("inf")), "temperature is inf"),
        (lambda f: ask(f, "old", seed=-1), "seed is -1"),
        (lambda f: ask(f, "old", "happy", spans=(1.5, -0.5)), "from 0 to 1"),
        (lambda f: g.Request(styles=("hapy",)), "unknown style 'hapy'"),
        (lambda f: g.Request(styles=("missing.bvh",)), "missing.bvh"),
    ],
)
def test_wrong_requests_get_one_sentence(folder, model, request_of, sentence):
    with pytest.raises((ValueError, OSError), match=sentence):
        g.generate(folder / "speech.wav", request_of(folder), model=model)


def test_the_digest_knows_parameters_scales_and_skeleton(model):
    other = model._replace(
        scales=model.scales._replace(speech=scale.Scale(model.scales.speech.mean + 1.0, model.scales.speech.std))
    )
    assert digest(model) == digest(model._replace(params=dict(model.params)))
    assert digest(model) != digest(other)


@pytest.mark.parametrize(
    "speech", [np.zeros((10, 2), np.float32), np.full(9000, np.nan, np.float32), np.zeros(3, np.float32)]
)
def test_speech_that_is_none_is_refused(folder, model, speech):
    with pytest.raises(ValueError, match=r"finite samples|shorter than one frame"):
        g.generate(speech, ask(folder, "old"), model=model)


def test_motion_is_written_only_under_a_name_for_motion(folder, model, tmp_path):
    gesture = g.generate(folder / "speech.wav", ask(folder, "old"), model=model)
    with pytest.raises(ValueError, match=r"ends in .bvh"):
        g.save(tmp_path / "out.json", gesture)
    assert not list(tmp_path.iterdir())


def test_another_skeleton_is_named(folder, model, tmp_path):
    clip = bvh.read(folder / "old.bvh")
    text = bvh.format(clip).replace("RightHandThumb4", "Tail")
    (tmp_path / "tail.bvh").write_text(text)
    with pytest.raises(ValueError, match=r"'tail.bvh'.*RightHandThumb4"):
        examples.read(str(tmp_path / "tail.bvh"), model)


def test_a_table_makes_one_file_per_row(folder, model, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(steering, "notes", lambda request, *_: ("it is far out.",) if request.first_pose else ())
    table = folder / "table.csv"
    table.write_text(
        "base_path,audio,style,file_name,temperature,seed,use_gpu,frames,first_pose,generate\n"
        ".,speech.wav,old.bvh,one,0.5,3,true,5 40,happy.bvh,true\n"
        ".,speech.wav,happy.bvh,,,,,,,\n"
        ".,speech.wav,happy.bvh,skipped,,,,,,False\n"
    )
    made = batch.generate_all(table, tmp_path, g.Request(), model)
    assert capsys.readouterr().err.count("zeggs: note: line 2 of table 'table.csv': it is far out.\n") == 1
    assert [path.name for path in made] == ["one.bvh", "audio_speech_label_happy.bvh"]
    alone = ask(folder, "old", temperature=0.5, seed=3, frames=((5, 40),), first_pose=str(folder / "happy.bvh"))
    expected = g.generate(folder / "speech.wav", alone, model=model)
    written = bvh.read(made[0])
    np.testing.assert_allclose(written.euler, expected.clip.euler, atol=1e-4)  # rows are decoded together
    np.testing.assert_allclose(written.positions, expected.clip.positions, atol=1e-3)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("sound,style\na.wav,old\n", "column 'sound'"),
        ("style\nold\n", "no column 'audio'"),
        ("audio,frames\nspeech.wav,1\n", "frames '1'"),
        ("audio,seed\nspeech.wav,x\n", "malformed number"),
        ("audio,generate\nspeech.wav,0\n", "no row to generate"),
        ("audio,file_name\nspeech.wav,a\nspeech.wav,a\n", "'a.bvh' twice"),
        ("audio,style\nmissing.wav,old\n", "line 2.*missing.wav"),
        ("audio,style\nspeech.wav,missing.bvh\n", "line 2.*missing.bvh"),
    ],
)
def test_wrong_tables_get_one_sentence(folder, model, tmp_path, text, sentence):
    (tmp_path / "t.csv").write_text(text)
    (tmp_path / "speech.wav").touch()
    with pytest.raises((ValueError, OSError), match=sentence):
        batch.generate_all(tmp_path / "t.csv", tmp_path, g.Request(), model)
