"""Laws of the straightened function: the same numbers, and nothing within it but plain operations."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from zeggs_jax.nn.straight import straightened

WEIGHT = np.random.default_rng(0).normal(size=(3, 3)).astype(np.float32)
UNUSED = np.ones((50, 50), np.float32)


@jax.custom_jvp
def squared(x):
    return x * x


squared.defjvp(lambda primals, tangents: (squared(*primals), 2.0 * primals[0] * tangents[0]))


def walk(x, steps):
    """A loop within a function within a function."""

    @jax.jit
    def step(state, add, unused=UNUSED):
        turned = jax.nn.elu(WEIGHT @ state) + add
        del unused
        return turned, (turned[:2], state)

    padded = jnp.pad(x, (0, 0), mode="edge")  # of no width
    last, rest = jax.lax.scan(partial(step, unused=jnp.asarray(UNUSED)), squared(padded), jnp.ones((steps, 3)))
    return last, *rest


def operations(function, *given):
    return jax.make_jaxpr(function)(*given)


def test_the_numbers_are_the_same_and_nothing_lies_within():
    x = np.array([0.5, -1.0, 2.0], np.float32)
    straight = straightened(lambda x: walk(x, 1), x)
    for ours, theirs in zip(straight(x), walk(x, 1), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)
    found = operations(straight, x)
    names = {one.primitive.name for one in found.jaxpr.eqns}
    assert {"dot_general", "add"} <= names
    assert not names & {"jit", "pjit", "scan", "custom_jvp_call", "concatenate"}
    assert not any(np.shape(array) == UNUSED.shape for array in found.consts)


def test_a_loop_of_several_turns_stays_a_loop():
    x = np.array([0.5, -1.0, 2.0], np.float32)
    straight = straightened(lambda x: walk(x, 4), x)
    for ours, theirs in zip(straight(x), walk(x, 4), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)
    assert "scan" in {one.primitive.name for one in operations(straight, x).jaxpr.eqns}
