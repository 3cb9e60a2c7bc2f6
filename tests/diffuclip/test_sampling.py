"""Chunks behind a context: what stays, what does not depend on the chunks, and that one function makes any length."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import diffusion, sampling
from zeggs_jax.diffuclip.config import DiffusionConfig
from zeggs_jax.diffuclip.sampling import Settings, rollout

CONFIG = DiffusionConfig(steps=100)
SCHEDULE = diffusion.schedule(CONFIG)
KEY = jax.random.key(0)
C = 2


def noise_in(z, level, told):
    """A causal "network": latent l is expected to be half of the one before it plus what is told of its place."""
    alpha, sigma = (jnp.broadcast_to(x[:, None], z.shape) for x in diffusion.amounts(SCHEDULE, level))
    before = jnp.concatenate([jnp.zeros((1, C)), z[:-1]])
    clean = 0.5 * before + jnp.broadcast_to(told[:, None], z.shape)
    return sigma * (z - alpha * clean) / (alpha**2 * 0.09 + sigma**2)


def extend(settings):
    """As guidance.extend: the window is the context that is there, then the chunk; told holds a number per latent."""

    @jax.jit
    def run(context, count, noise, told, key):
        def evaluate(z, level):
            window = jax.lax.dynamic_update_slice_in_dim(jnp.pad(context, ((0, len(noise)), (0, 0))), z, count, 0)
            levels = jnp.zeros(len(window)).at[count + jnp.arange(len(noise))].set(level)
            found = noise_in(window, levels, told)
            return jax.lax.dynamic_slice_in_dim(found, count, len(noise))

        return sampling.denoise(evaluate, CONFIG, settings, noise, key)

    return run


def told_at(first, length):
    return np.sin(first + np.arange(length)).astype(np.float32)


def made(settings, latents, key=KEY, prefix=None, run=None):
    return np.concatenate(list(rollout(run or extend(settings), settings, told_at, latents, C, key, prefix)))


CHUNKED = Settings("dpm", 5, chunk=4, context=6)


@pytest.fixture(scope="module")
def chunked():
    return partial(made, CHUNKED, run=extend(CHUNKED))


def test_a_chunk_of_all_is_the_same_as_no_chunks():
    whole = Settings("dpm", 5, chunk=10, context=0)
    noise = sampling.noise_of(jax.random.split(KEY)[0], 0, 10, C)
    at_once = jax.jit(
        lambda noise: sampling.denoise(lambda z, n: noise_in(z, n, told_at(0, 10)), CONFIG, whole, noise, KEY)
    )(noise)
    np.testing.assert_allclose(made(whole, 10), at_once, atol=1e-5)


@pytest.mark.parametrize("chunk", [3, 1])
def test_equation_9_by_hand(chunk):
    """Each chunk with its clean prefix, by the definition: the whole past in one window."""
    settings, past = Settings("ddim", 4, chunk=chunk, context=6), np.zeros((0, C), np.float32)
    for start in range(0, 6, chunk):
        noise = jnp.asarray(sampling.noise_of(jax.random.split(KEY)[0], start, chunk, C))
        evaluate = partial(noise_in, told=told_at(0, start + chunk))
        past = np.concatenate([past, sampling.denoise(evaluate, CONFIG, settings, noise, KEY, past)])
    np.testing.assert_allclose(made(settings, 6), past, atol=1e-5)


def test_the_prefix_is_seen_and_never_changed():
    seen, settings = [], Settings("ddim", 3, chunk=4, context=6)
    prefix = np.arange(16, dtype=np.float32).reshape(8, C)

    def spy(context, count, noise, told, key):
        seen.append((context.copy(), count, told[0]))
        return np.full((4, C), -len(seen), np.float32)

    out = made(settings, 7, prefix=prefix, run=spy)
    np.testing.assert_array_equal(out[:, 0], [-1, -1, -1, -1, -2, -2, -2])
    np.testing.assert_array_equal(seen[0][0], prefix[2:])
    np.testing.assert_array_equal(seen[1][0], np.concatenate([prefix[6:], np.full((4, C), -1)]))
    assert [(count, told) for _, count, told in seen] == [(6, told_at(2, 1)), (6, told_at(6, 1))]


def test_a_young_context_begins_at_the_front():
    seen = []

    def spy(context, count, noise, told, key):
        seen.append((context[:, 0].tolist(), count, float(told[0])))
        return np.full((4, C), len(seen), np.float32)

    made(CHUNKED, 12, run=spy)
    assert seen == [([0] * 6, 0, 0.0), ([1] * 4 + [0] * 2, 4, 0.0), ([1, 1, 2, 2, 2, 2], 6, float(told_at(2, 1)[0]))]


def test_a_longer_motion_begins_the_same(chunked):
    short, long = chunked(9), chunked(30)
    np.testing.assert_array_equal(long[:9], short)
    assert len(long) == 30
    assert np.abs(long - chunked(30, key=jax.random.key(1))).max() > 0.1


def test_the_noise_of_a_latent_does_not_depend_on_the_chunk():
    whole = sampling.noise_of(KEY, 0, 12, C)
    np.testing.assert_array_equal(whole[5:8], sampling.noise_of(KEY, 5, 3, C))
    many = sampling.noise_of(KEY, 0, 20_000, C)
    assert abs(many.mean()) < 0.03
    assert abs(many.std() - 1) < 0.03


def test_one_compiled_function_makes_all_chunks():
    run = extend(CHUNKED)
    made(CHUNKED, 50, run=run)
    made(CHUNKED, 13, prefix=np.ones((3, C), np.float32), run=run)
    assert run._cache_size() == 1


def test_chunks_are_handed_on_as_they_are_made():
    chunks = rollout(extend(CHUNKED), CHUNKED, told_at, 10**9, C, KEY)
    assert [len(next(chunks)) for _ in range(3)] == [4, 4, 4]


def test_ddpm_draws_from_the_key_and_ddim_does_not():
    noise = jnp.asarray(sampling.noise_of(KEY, 0, 5, C))

    for solver, eta, drawn in (("ddpm", 0.0, True), ("ddim", 1.0, True), ("ddim", 0.0, False), ("dpm", 0.0, False)):
        evaluate, settings = partial(noise_in, told=told_at(0, 5)), Settings(solver, 5, eta)
        run = jax.jit(partial(sampling.denoise, evaluate, CONFIG, settings, noise))
        assert (np.abs(run(jax.random.key(0)) - run(jax.random.key(1))).max() > 0) == drawn


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"chunk": 0}, "chunks of 0 latents"),
        ({"context": -1}, "behind -1"),
        ({"steps": 0}, "in 0 steps"),
        ({"eta": 1.5}, "eta is 1.5"),
    ],
)
def test_settings_that_make_no_sense_are_told(settings, told):
    with pytest.raises(ValueError, match=told):
        Settings(**settings)


def test_more_steps_than_levels_are_told():
    with pytest.raises(ValueError, match="200 denoising steps were asked for; expected 1 to 100"):
        sampling.denoise(lambda z, n: z, CONFIG, Settings("ddim", 200), jnp.zeros((2, C)), KEY)
