"""Every kind of style encoder keeps the contract: padding changes nothing, gradients are finite, configs say all."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data.scale import Scale, Scales
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.zeroeggs import encoders
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs.encoders import ENCODERS
from zeggs_jax.zeroeggs.style_encoder import Encoder
from zeggs_jax.zeroeggs.torch_names import torch_names

BODY = Skeleton(("Hips", "Spine", "Head"), (-1, 0, 1), np.zeros((3, 3)))
INPUTS, LENGTH, PADDED = 6 + 15 * len(BODY) + 3, 13, 21
KINDS = sorted(ENCODERS)
COMPILED = [kind for kind in KINDS if kind not in ("attn", "gru")]  # the paper's two: test_style_encoder.py


def config_of(kind, **changes):
    """A small config that has seen the body."""
    return ENCODERS[kind].fit(m.StyleEncoderConfig(kind, hidden=12, size=8, **changes), BODY)


def drawn(kind, config):
    """Parameters of the shapes that `init` gives, without compiling it."""
    shapes = jax.eval_shape(lambda: ENCODERS[kind].init(jax.random.key(0), config, INPUTS))
    rng = np.random.default_rng(0)
    return jax.tree.map(lambda a: (rng.normal(size=a.shape) / a.shape[-1] ** 0.5).astype(np.float32), shapes)


class Fixed:
    """One kind with its config and parameters, compiled for an example, for a batch, and for gradients."""

    def __init__(self, kind):
        self.config = config_of(kind)
        self.params = drawn(kind, self.config)
        self.one = jax.jit(self.plain)
        self.batch = jax.jit(jax.vmap(self.plain, (None, 0, 0)))
        self.slopes = jax.jit(jax.value_and_grad(self.total, argnums=(0, 1)))

    def plain(self, params, example, length, key=None):
        return ENCODERS[self.config.kind].apply(params, self.config, example, length, key, "float32")

    def total(self, params, example, key):
        return sum(jnp.sum(jnp.sin(leaf)) for leaf in jax.tree.leaves(self.plain(params, example, LENGTH, key)))


@pytest.fixture(scope="module", params=COMPILED)
def kind(request):
    return Fixed(request.param)


@pytest.fixture(scope="module", params=["bottleneck", pytest.param("parts", marks=pytest.mark.slow)])
def learning(request):
    """Gradients of many parts take long to compile."""
    return Fixed(request.param)


@pytest.fixture(scope="module")
def example():
    return np.random.default_rng(1).normal(size=(LENGTH, INPUTS)).astype(np.float32)


def padded(example, value):
    return np.concatenate([example, np.full((PADDED - LENGTH, INPUTS), value, np.float32)])


def test_padding_changes_nothing_in_a_compiled_batch_of_any_lengths(kind, example):
    rows = np.stack([padded(example, value) for value in (0.0, 1e4, np.nan, 0.5, 0.5)])
    batch = kind.batch(kind.params, rows, jnp.array([LENGTH, LENGTH, LENGTH, PADDED, 5]))
    assert batch.mean.shape == (5, 8)
    assert (batch.log_var is None) == (not kind.config.variational)
    alone = kind.one(kind.params, example, LENGTH)
    for ours, expected in zip(batch, alone, strict=True):
        if expected is not None:
            np.testing.assert_array_equal(ours[1], ours[0])
            np.testing.assert_array_equal(ours[2], ours[0])
            np.testing.assert_allclose(ours[0], expected, rtol=0, atol=2e-6)
            assert np.abs(ours[3] - ours[0]).max() > 1e-3  # frames that are no padding count
            assert np.abs(ours[4] - ours[0]).max() > 1e-3


def test_gradients_are_finite_at_rest_too_and_reach_every_parameter(learning, example):
    """A body that does not move has no spread: the root of a variance must not break there."""
    still = np.broadcast_to(example[:1], example.shape)
    for x in (padded(still, 0.0), padded(example, 7.0)):
        _, (params, frames) = learning.slopes(learning.params, x, jax.random.key(0))
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((params, frames)))
        assert np.abs(frames[:LENGTH]).max(1).min() > 0
        assert not frames[LENGTH:].any()
    assert all(leaf.any() for leaf in jax.tree.leaves(params))


def test_dropout_is_of_the_key(learning, example):
    one, same, other = (learning.slopes(learning.params, padded(example, 0.0), jax.random.key(k))[0] for k in (1, 1, 2))
    assert one == same != other


@pytest.mark.parametrize("kind", KINDS)
def test_a_config_comes_back_from_json_and_fitting_it_again_changes_nothing(kind):
    config = m.ZeroEggsConfig(joints=3, style=config_of(kind))
    assert m.from_dict(m.ZeroEggsConfig, json.loads(json.dumps(m.to_dict(config)))) == config
    assert ENCODERS[kind].fit(config.style, BODY) == config.style


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("atn", "'atn' is unknown; nearest: attn"),
        ("part", "nearest: parts"),
        ("mine", r"nearest: attn, gru, .*label.*ENCODERS\['mine'\] = Encoder"),
    ],
)
def test_an_unknown_kind_is_one_sentence(kind, says):
    with pytest.raises(ValueError, match=says) as told:
        m.from_dict(m.ZeroEggsConfig, {"style": {"kind": kind}})
    assert "\n" not in str(told.value)


def test_a_kind_is_added_in_one_line(monkeypatch):
    """Two plain functions: the weighted mean of the frames."""

    def init(key, config, inputs):
        return {"weight": 0.1 * jax.random.normal(key, (config.size, inputs))}

    def apply(params, config, example, length, dropout_key, matmul):
        seen = jnp.where((jnp.arange(len(example)) < length)[:, None], example, 0.0)
        return m.StyleDistribution(params["weight"] @ (seen.sum(0) / length), None)

    monkeypatch.setitem(ENCODERS, "mine", Encoder(init, apply))
    config = m.from_dict(m.ZeroEggsConfig, {"joints": 3, "style": {"kind": "mine", "size": 4}})
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))
    assert shapes["style"]["weight"].shape == (4, INPUTS)
    weight = np.arange(4.0 * INPUTS, dtype=np.float32).reshape(4, INPUTS)
    unit = [Scale(jnp.zeros(n), jnp.ones(n)) for n in (81, INPUTS, INPUTS - 3)]
    style = m.encode_style({"style": {"weight": weight}}, config, Scales(*unit), jnp.ones((6, INPUTS - 3)), 4)
    np.testing.assert_allclose(style.mean, weight[:, :-3].sum(1), rtol=1e-5)


def test_an_encoder_that_breaks_the_contract_is_told_so(monkeypatch):
    given = ENCODERS["bottleneck"]
    short = lambda *given_to: m.StyleDistribution(given.apply(*given_to).mean[:-1], None)  # noqa: E731
    monkeypatch.setitem(ENCODERS, "short", given._replace(apply=short))
    with pytest.raises(ValueError, match=r"style kind 'short' returns a mean of shape \(3,\).*\(4,\)"):
        encoders.init(jax.random.key(0), m.StyleEncoderConfig("short", hidden=4, size=4), INPUTS)
    monkeypatch.setitem(ENCODERS, "bare", given._replace(apply=lambda *given_to: given.apply(*given_to).mean))
    with pytest.raises(ValueError, match=r"style kind 'bare' returns a ShapeDtypeStruct; .* return StyleDistribution"):
        encoders.init(jax.random.key(0), m.StyleEncoderConfig("bare", hidden=4, size=4), INPUTS)


def test_the_release_holds_its_own_kinds_alone():
    for kind in KINDS:
        config = m.ZeroEggsConfig(joints=3, style=replace(config_of(kind), heads=2))
        if kind in ("attn", "gru"):
            assert any(name.startswith("style/") for name in torch_names(config))
        else:
            with pytest.raises(ValueError, match=f"style kind is '{kind}'; the release, which has attn, gru"):
                torch_names(config)
