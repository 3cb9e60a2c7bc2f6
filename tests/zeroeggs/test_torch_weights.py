"""The release's weights there and back, sizes told by shapes, conversions, and files that do not fit."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs import torch_weights
from zeggs_jax.zeroeggs.torch_names import torch_names

SPEECH = m.SpeechEncoderConfig(features=9, hidden=6, size=5, kernel=5)
STYLES = {
    "attn": m.StyleEncoderConfig(hidden=12, size=4),
    "attn, no VAE": m.StyleEncoderConfig(hidden=12, size=4, variational=False),
    "gru": m.StyleEncoderConfig("gru", hidden=12, size=4),
    "gru, no VAE": m.StyleEncoderConfig("gru", hidden=12, size=4, variational=False),
    "label": m.StyleEncoderConfig("label"),
}
DECODERS = [m.DecoderConfig(16, 2), m.DecoderConfig(16, 3, "film"), m.DecoderConfig(8, 1)]


def make(style="attn", decoder=DECODERS[0]):
    """A config and random parameters."""
    labels = ("Happy", "Old", "Sad") if style == "label" else ()
    config = m.ZeroEggsConfig(5, 0.02, labels, speech=SPEECH, style=STYLES[style], decoder=decoder)
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))
    rng = np.random.default_rng(0)
    return config, jax.tree.map(lambda a: rng.normal(size=a.shape).astype(np.float32), shapes)


@pytest.fixture(params=[(s, d) for s in STYLES for d in DECODERS], ids=str)
def made(request):
    return make(*request.param)


def test_there_and_back_is_bit_for_bit(made):
    config, params = made
    arrays = torch_weights.to_torch(params, config)
    back = torch_weights.from_torch(arrays, config)
    jax.tree.map(np.testing.assert_array_equal, back, params)
    assert jax.tree.structure(back) == jax.tree.structure(params)
    again = torch_weights.to_torch(back, config)
    assert all(again[name].tobytes() == array.tobytes() for name, array in arrays.items())


def test_a_look_ahead_of_its_own_has_no_form_in_the_release():
    config, params = make()
    early = replace(config, speech=replace(config.speech, lookahead=1))
    with pytest.raises(ValueError, match="looks 1 frames ahead and 3 behind"):
        torch_weights.to_torch(params, early)


def test_every_parameter_has_one_name(made):
    config, params = made
    names = torch_names(config)
    assert len(set(names.values())) == len(names) == len(jax.tree.leaves(params))


def test_shapes_tell_the_sizes(made):
    config, params = made
    arrays = torch_weights.to_torch(params, config)
    assert torch_weights.infer_config(arrays, config.frame_time, config.labels) == config


def test_names_are_the_releases():
    arrays = torch_weights.to_torch(*reversed(make()))
    assert arrays["speech_encoder/layer0.weight"].shape == (6, 9, 1)
    assert arrays["style_encoder/encoder.blocks.0.attention.multi_head_attention.in_proj_weight"].shape == (
        24,
        8,
    )
    assert arrays["decoder/recurrent_decoder.layer1.weight_ih_l0"].shape == (48, 16 + 84 + 5 + 4)
    assert arrays["decoder/cell_state_encoder.layer2.weight"].shape == (32, 16)
    film = torch_weights.to_torch(*reversed(make("gru", DECODERS[1])))
    assert film["decoder/recurrent_decoder.gammas_predictor.linear_layer.weight"].shape == (32, 4)
    assert film["style_encoder/encoder.rnn_layer.weight_hh_l0_reverse"].shape == (36, 12)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda a: a.pop("decoder/recurrent_decoder.layer0.bias"),
            "'decoder/recurrent_decoder.layer0.bias' is missing",
        ),
        (lambda a: a.update({"decoder/new.weight": np.zeros(3)}), "'decoder/new.weight' does not belong"),
        (
            lambda a: a.update({"speech_encoder/layer0.bias": np.zeros(7)}),
            r"'speech/conv0/bias' has shape \(7,\)",
        ),
    ],
)
def test_arrays_that_do_not_fit_are_named(change, says):
    config, params = make()
    arrays = torch_weights.to_torch(params, config)
    change(arrays)
    with pytest.raises(ValueError, match=says):
        torch_weights.from_torch(arrays, config)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda a: a.pop("decoder/cell_state_encoder.layer0.weight"), "layer0.weight' is missing"),
        (
            lambda a: a.update({"speech_encoder/layer0.weight": np.zeros(3)}),
            r"has shape \(3,\); expected 3 axes",
        ),
        (
            lambda a: a.update({"decoder/recurrent_decoder.layer2.weight": np.zeros((80, 16))}),
            "80 numbers a frame",
        ),
        (lambda a: a.update({"style_encoder/encoder.convs.4.conv.bias": np.zeros(5)}), "gives 5 numbers"),
        (lambda a: [a.pop(k) for k in list(a) if k.startswith("style")], "is style_encoder.pt missing"),
    ],
)
def test_sizes_that_contradict_each_other(change, says):
    config, params = make()
    arrays = torch_weights.to_torch(params, config)
    change(arrays)
    with pytest.raises(ValueError, match=says):
        torch_weights.infer_config(arrays)


def release(torch_file, style="attn"):
    """A small release: its networks' files, statistics and definitions, and what it was made from."""
    config, params = make(style)
    arrays = torch_weights.to_torch(params, config)
    networks = {
        network: torch_file.network({k.split("/")[1]: a for k, a in arrays.items() if k.startswith(f"{network}/")})
        for network in torch_weights.NETWORKS
        if network != "style_encoder" or not config.labels
    }
    rng = np.random.default_rng(1)
    stats = {"audio_input_mean": rng.normal(size=9).astype(np.float32), "audio_input_std": np.float64(1.5)}
    for kind, size in (("anim_input", 84), ("anim_output", 81)):
        stats[f"{kind}_mean"] = rng.normal(size=size).astype(np.float32)
        stats[f"{kind}_std"] = rng.uniform(0.5, 2.0, size)
    names = ("Hips", "Spine2", "Head", "LeftHand", "RightHand")
    definition = {"dt": 0.02, "label_names": ["Happy", "Old", "Sad"], "bone_names": list(names)}
    return networks, stats, definition | {"parents": [-1, 0, 1, 1, 1]}, (config, params)


@pytest.mark.parametrize("style", ["attn", "gru", "label"])
def test_convert_makes_a_model(torch_file, style):
    networks, stats, definition, (config, params) = release(torch_file, style)
    model = torch_weights.convert(networks, stats, definition, {"audio_conf": {"hop_length": 200}})
    assert model.config == config
    jax.tree.map(np.testing.assert_array_equal, model.params, params)
    assert model.skeleton.names[2] == "Head"
    np.testing.assert_array_equal(model.skeleton.offsets, stats["anim_output_mean"][6:21].reshape(5, 3))
    np.testing.assert_array_equal(model.scales.speech.std, np.full(9, 1.5, np.float32))
    np.testing.assert_array_equal(model.scales.pose_in.std, stats["anim_input_std"].astype(np.float32))
    assert all(np.asarray(leaf).dtype == np.float32 for leaf in jax.tree.leaves(model.scales))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda n, s, d, c: n.pop("decoder"), "'decoder.pt' is missing"),
        (lambda n, s, d, c: n.update(decoder=b"text"), "'decoder.pt' is not a network"),
        (lambda n, s, d, c: n.update(decoder=n["speech_encoder"]), "'decoder/.*' is missing"),
        (lambda n, s, d, c: s.pop("anim_input_std"), "stats.npz has no array 'anim_input_std'"),
        (
            lambda n, s, d, c: s.update(anim_input_std=np.ones(3)),
            r"'anim_input_std' in stats.npz has shape \(3,\)",
        ),
        (lambda n, s, d, c: d.pop("dt"), "data_definition.json lacks a valid dt"),
        (lambda n, s, d, c: d.update(parents="none"), "data_definition.json lacks"),
        (lambda n, s, d, c: d["bone_names"].pop(), "5 joints, data_definition.json names 4"),
        (lambda n, s, d, c: c["audio_conf"].update(hop_length=160), "sets hop_length to 160"),
        (lambda n, s, d, c: c.update(audio_feature_type=["mel_spec"]), "asks for the features"),
    ],
)
def test_files_that_do_not_fit_are_named(torch_file, change, says):
    networks, stats, definition, _ = release(torch_file)
    conf = {"audio_conf": {}, "audio_feature_type": ["mel_spec", "energy"]}
    change(networks, stats, definition, conf)
    with pytest.raises(ValueError, match=says):
        torch_weights.convert(networks, stats, definition, conf)
