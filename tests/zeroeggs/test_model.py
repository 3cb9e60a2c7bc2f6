"""Fig. 2: sizes of the published networks, configs written and read, parameters checked, styles by label."""

import json
import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data import scale
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.zeroeggs import checkpoints, generate, library
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs.style_encoder import StyleEncoder

LABELS = ("Happy", "Old", "Sad")


def count(config, part=None):
    """Parameters that `init` makes, of one network or of all."""
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))
    return sum(math.prod(leaf.shape) for leaf in jax.tree.leaves(shapes[part] if part else shapes))


def label_config(labels=LABELS):
    return m.ZeroEggsConfig(labels=labels, style=m.StyleEncoderConfig(kind="label"))


def test_paper_sizes():
    config = m.ZeroEggsConfig()
    assert count(config, "speech") == 136_448
    assert count(config, "style") == 2_105_472
    assert count(config, "decoder") == 23_301_227
    assert count(config) == 25_543_147


def test_sizes_of_the_other_kinds():
    gru = m.StyleEncoderConfig(kind="gru")
    assert count(m.ZeroEggsConfig(style=gru), "style") == 5_812_352
    plain = m.StyleEncoderConfig(variational=False)
    assert count(m.ZeroEggsConfig(style=plain), "style") == 1_883_456
    assert count(m.ZeroEggsConfig(decoder=m.DecoderConfig(conditioning="film")), "decoder") == 24_354_923
    assert count(label_config(tuple("123456789"))) == 23_156_075


def test_a_model_with_labels_has_no_style_encoder(small):
    config = m.ZeroEggsConfig(
        joints=5,
        labels=LABELS,
        speech=small.config.speech,
        style=label_config().style,
        decoder=small.config.decoder,
    )
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))
    assert set(shapes) == {"speech", "decoder"}
    params = jax.tree.map(lambda a: jnp.full(a.shape, 0.01), shapes)
    style = jnp.tile(jax.nn.one_hot(1, 3)[None], (7, 1))
    assert small._replace(config=config, params=params, style=style).decode().joint_pos.shape == (7, 5, 3)


def test_encode_speech_scales_its_features(small):
    features = jax.random.normal(jax.random.key(1), (8, 9))
    raw = scale.invert(small.scales.speech, features)
    unit = small.scales._replace(speech=scale.Scale(jnp.zeros(9), jnp.ones(9)))
    expected = m.encode_speech(small.params, small.config, unit, features)
    np.testing.assert_allclose(m.encode_speech(small.params, small.config, small.scales, raw), expected, atol=1e-5)


def test_encode_style_sees_no_gaze(small):
    example = jax.random.normal(jax.random.key(1), (8, small.config.vector_size))
    ours = m.encode_style(small.params, small.config, small.scales, example)
    gazeless = scale.apply(small.scales.pose_in, jnp.concatenate([example, jnp.zeros((8, 3))], axis=1))
    network = StyleEncoder(small.config.style)
    expected = network.apply({"params": small.params["style"]}, gazeless, 8)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), ours, expected)


def test_dropout_only_with_a_key(small):
    features = jax.random.normal(jax.random.key(1), (8, 9))
    example = jax.random.normal(jax.random.key(2), (8, small.config.vector_size))
    for encode, x in ((m.encode_speech, features), (m.encode_style, example)):

        def run(key=None, encode=encode, x=x):
            return jax.tree.leaves(encode(small.params, small.config, small.scales, x, dropout_key=key))[0]

        np.testing.assert_array_equal(run(), run())
        assert np.abs(run(jax.random.key(1)) - run()).max() > 1e-4
        np.testing.assert_array_equal(run(jax.random.key(1)), run(jax.random.key(1)))
        assert np.abs(run(jax.random.key(1)) - run(jax.random.key(2))).max() > 1e-4


@pytest.mark.parametrize(
    "config",
    [
        m.ZeroEggsConfig(),
        label_config(),
        m.ZeroEggsConfig(joints=7, frame_time=0.05, decoder=m.DecoderConfig(8, 3, "film")),
        m.ZeroEggsConfig(style=m.StyleEncoderConfig("gru", 8, 4, variational=False)),
    ],
)
def test_a_config_comes_back_from_json(config):
    assert m.from_dict(m.ZeroEggsConfig, json.loads(json.dumps(m.to_dict(config)))) == config


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ({"joint": 75}, "config has an unknown key 'joint'; the nearest known one is 'joints'"),
        ({"decoder": {"hiden": 3}}, r"config.decoder has an unknown key 'hiden'; .* 'hidden'"),
        ({"decoder": {"hidden": "many"}}, r"config.decoder.hidden is 'many'; expected int"),
        ({"decoder": {"hidden": True}}, r"config.decoder.hidden is True; expected int"),
        ({"decoder": {"hidden": 2.5}}, r"config.decoder.hidden is 2.5; expected int"),
        ({"style": {"variational": 1}}, r"config.style.variational is 1; expected bool"),
        ({"decoder": {"conditioning": "filn"}}, "is 'filn'; expected one of 'normal', 'film'"),
        ({"labels": "Happy"}, "config.labels is 'Happy'"),
        ({"labels": [1]}, r"config.labels\[0\] is 1; expected str"),
        ({"speech": 3}, "config.speech is 3; expected a table"),
        ({"labels": ["Happy"]}, "the style kind is 'attn' and there are 1 labels"),
        ({"style": {"kind": "label"}}, "the style kind is 'label' and there are 0 labels"),
        ({"decoder": {"layers": 0}}, "DecoderConfig.layers is 0"),
        ({"speech": {"kernel": 30}}, "kernel is 30; it must be odd"),
        ({"speech": {"kernel": 7, "lookahead": 7}}, "lookahead is 7; a kernel of 7 frames sees 0 to 6 ahead"),
        ({"speech": {"lookahead": -1}}, "lookahead is -1"),
        ({"speech": {"lookahead": 4.0}}, "expected int"),
        ({"speech": {"lookahead": True}}, "expected int"),
        ({"style": {"size": 3}}, "6 wide, which its 4 heads do not divide"),
        ([], "config is .*; expected a table"),
    ],
)
def test_a_config_is_read_strictly(data, says):
    with pytest.raises(ValueError, match=says):
        m.from_dict(m.ZeroEggsConfig, data)


def test_a_look_ahead_is_kept_with_a_model_and_one_without_is_the_model_that_it_was(small, tmp_path):
    """Libraries know their model by its digest, in which a setting that came late must not be where it is not used."""
    skeleton = Skeleton(("Hips",), (-1,), np.zeros((1, 3)))
    plain = m.Model(small.config, small.params, small.scales, skeleton)
    early = plain._replace(config=replace(small.config, speech=replace(small.config.speech, lookahead=1)))
    assert "lookahead" not in checkpoints.describe(plain.config, skeleton)["model"]["speech"]
    for model in (plain, early):
        checkpoints.save_model(tmp_path / str(model.config.speech.ahead), model)
        assert checkpoints.load_model(tmp_path / str(model.config.speech.ahead)).config == model.config
    assert checkpoints.digest(plain) != checkpoints.digest(early)
    assert library.is_bundled(generate.bundled_model())


def test_parameters_that_fit_pass(small):
    m.check_params(small.params, small.config)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda p: p["decoder"]["recurrent"].pop("dense_out"),
            "'decoder/recurrent/dense_out/bias' is missing",
        ),
        (lambda p: p.pop("style"), "'style/encoder/.*' is missing"),
        (lambda p: p["speech"].update(extra=jnp.zeros(3)), "'speech/extra' .* does not belong"),
        (
            lambda p: p["speech"]["dense"].update(bias=jnp.zeros(3)),
            r"'speech/dense/bias' has shape \(3,\); .* \(5,\)",
        ),
    ],
)
def test_parameters_that_do_not_fit_are_named(small, change, says):
    params = jax.tree.map(lambda a: a, small.params)
    change(params)
    with pytest.raises(ValueError, match=says):
        m.check_params(params, small.config)
