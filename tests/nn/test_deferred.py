"""A scan with deferred weight gradients is `jax.lax.scan`: values, gradients, batches; it only computes otherwise."""

import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn

from zeggs_jax.nn import deferred
from zeggs_jax.nn.compute import PLAIN, Compute
from zeggs_jax.nn.layers import Dense, GRUCell

HIDDEN, SEEN, FRAMES = 12, 3, 6


class Loop(nn.Module):
    """A GRU cell that reads its own last output, and a dense layer."""

    @nn.compact
    def __call__(self, x, hidden):
        hidden = GRUCell(HIDDEN, name="cell")(x, hidden)
        return Dense(SEEN, name="out")(hidden), hidden


def normal(seed: int, *shape: int):
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape))


def step(params: Any, carry: Any, x: Any):
    network: Any = Loop()
    seen, hidden = carry
    (seen, hidden), kept = network.apply({"params": params}, seen + x, hidden, mutable=[deferred.INPUTS])
    return (seen, hidden), {"seen": seen}, kept[deferred.INPUTS]


def plain(params, carry, xs):
    def body(carry, x):
        carry, y, _ = step(params, carry, x)
        return carry, y

    return jax.lax.scan(body, carry, xs)


def total(scan, params, carry, xs):
    (seen, hidden), ys = scan(params, carry, xs)
    return jnp.sum(jnp.sin(ys["seen"])) + jnp.sum(seen * seen) + jnp.sum(jnp.cos(hidden))


def scan_with(compute: Compute):
    return lambda params, carry, xs: deferred.scan(step, params, carry, xs, compute)


def setup(clips: int = 1):
    """Parameters, carries and inputs of some clips, in the precision that is switched on."""
    shapes = jax.eval_shape(lambda: Loop().init(jax.random.key(0), jnp.zeros(SEEN), jnp.zeros(HIDDEN)))["params"]
    params = jax.tree.map(lambda a: normal(a.size, *a.shape) * 0.5, shapes)
    return params, (normal(1, clips, SEEN), normal(2, clips, HIDDEN)), normal(3, clips, FRAMES, SEEN)


def one_of(clips):
    params, carry, xs = clips
    return params, jax.tree.map(lambda a: a[0], carry), xs[0]


def close(ours, theirs, rtol=1e-10):
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol), ours, theirs)


@pytest.mark.parametrize("compute", [PLAIN, Compute(remat=True)], ids=str)
def test_values_and_gradients_are_the_plain_scans(compute):
    with jax.enable_x64(True):
        given = one_of(setup())
        close(scan_with(compute)(*given), plain(*given))
        slopes = [jax.jit(jax.grad(total, (1, 2, 3)), static_argnums=0)(s, *given) for s in (scan_with(compute), plain)]
        close(*slopes)


def test_batches_too():
    def mean(scan, params, carry, xs):
        return jnp.mean(jax.vmap(lambda c, x: total(scan, params, c, x))(carry, xs))

    with jax.enable_x64(True):
        given = setup(clips=4)
        slopes = [jax.jit(jax.grad(mean, (1, 2, 3)), static_argnums=0)(s, *given) for s in (scan_with(PLAIN), plain)]
        close(*slopes)
        each = [jax.vmap(jax.grad(total, (1, 2)), (None, None, 0, 0)) for _ in range(2)]
        close(*(f(s, *given) for f, s in zip(each, (scan_with(PLAIN), plain), strict=True)))


def shapes_of(compiled: str) -> set[str]:
    return set(re.findall(r"f32\[([\d,]+)\]", compiled))


def test_weight_gradients_are_one_product_over_frames_and_clips():
    """Neither per clip nor per frame is a gradient of a weight's size formed."""
    clips = 5
    params, carry, xs = jax.tree.map(lambda a: a.astype(jnp.float32), setup(clips))

    def mean(scan, params):
        return jnp.mean(jax.vmap(lambda c, x: total(scan, params, c, x))(carry, xs))

    weights = [leaf.shape for leaf in jax.tree.leaves(params) if leaf.ndim == 2]
    per_clip = {f"{clips},{rows},{columns}" for rows, columns in weights}
    ours = jax.jit(jax.grad(lambda p: mean(scan_with(PLAIN), p))).lower(params).compile().as_text()
    assert not per_clip & shapes_of(ours)

    bodies = re.findall(r"^%?\S*(?:body|while)\S* \(.*?\{\n(.*?)^\}", ours, re.M | re.S)
    sums = {f"= f32[{rows},{columns}]" for rows, columns in weights}
    lines = [line for body in bodies for line in body.splitlines() if "dot" in line]
    assert not [line for line in lines if any(s in line for s in sums)]
