"""Several prompts in one chunk: guidance, parts of the body, and the same noise as from the whole window."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import denoiser, diffusion, sampling
from zeggs_jax.diffuclip.config import (
    CodesConfig,
    DenoiserConfig,
    DiffuclipConfig,
    DiffusionConfig,
    JointConfig,
    PromptsConfig,
)
from zeggs_jax.diffuclip.guidance import Wish, extend, whole
from zeggs_jax.diffuclip.sampling import Settings

P, K, AHEAD = 4, 3, 2
CONFIG = DiffuclipConfig(
    parts=("upper", "lower"),
    codes=CodesConfig(latent=3),
    joint=JointConfig("words", 6, 1, 2, words=3),
    prompts=PromptsConfig(size=5),
    denoiser=DenoiserConfig(8, 1, 2, ahead=AHEAD, output="velocity"),
    diffusion=DiffusionConfig(steps=50),
)
SETTINGS = Settings("ddim", 3, chunk=K, context=P)
KEY = jax.random.key(0)
MASKS = jnp.repeat(jnp.eye(2, dtype=bool), 3, axis=1)


def normal(seed, *shape):
    return jnp.array(np.random.default_rng(seed).normal(size=shape), jnp.float32)


PARAMS = jax.tree_util.tree_map_with_path(
    lambda path, leaf: 0.3 * normal(1, *leaf.shape) + (path[-1].key == "scale"),
    jax.eval_shape(partial(denoiser.init, config=CONFIG), KEY),
)
TOLD = denoiser.nothing(CONFIG, P + K)._replace(
    rhythm=normal(2, P + K + AHEAD, 2), words=normal(3, 3, 6), saliency=jnp.ones(3), word_mask=jnp.ones(3, bool)
)
NOISE, CONTEXT, OLD, HAPPY = normal(4, K, 6), normal(5, P, 6), normal(6, 5), normal(7, 5)


def chunk(wish, count=P, seam=0.0, settings=SETTINGS, seed=0):
    return extend(PARAMS, CONFIG, settings, seam, CONTEXT, count, NOISE, (TOLD, wish), jax.random.key(seed))


@partial(jax.jit, static_argnames="count")
def by_definition(style, prompted, count):
    """The chunk from whole windows, without memory and guidance."""
    told = TOLD._replace(style=style, prompted=prompted, rhythm=TOLD.rhythm[: count + K + AHEAD])
    evaluate = partial(denoiser.apply, PARAMS, CONFIG, conditions=told)
    return sampling.denoise(lambda z, n: evaluate(z, n), CONFIG.diffusion, SETTINGS, NOISE, KEY, CONTEXT[:count])


@pytest.mark.parametrize("count", [0, 2, P])
def test_scale_1_is_the_prompt_and_scale_0_is_none(count):
    for scale, prompted in ((1.0, True), (0.0, False)):
        expected = by_definition(OLD, jnp.array(prompted), count)
        np.testing.assert_allclose(chunk(whole(OLD, scale, CONFIG), count), expected, atol=2e-5)


def test_what_is_not_in_the_context_is_not_seen():
    changed = CONTEXT.at[2:].set(99.0)
    wish = whole(OLD, 2.0, CONFIG)
    made = extend(PARAMS, CONFIG, SETTINGS, 0.0, changed, 2, NOISE, (TOLD, wish), KEY)
    np.testing.assert_array_equal(made, chunk(wish, 2))
    assert np.abs(made - chunk(wish, 3)).max() > 1e-3


@pytest.mark.parametrize("seam", [0.0, 0.5])
def test_equal_prompts_for_all_parts_are_one_prompt(seam):
    twice = Wish(jnp.stack([OLD, OLD]), jnp.array([2.0, 2.0]), MASKS)
    np.testing.assert_allclose(chunk(twice, seam=seam), chunk(whole(OLD, 2.0, CONFIG)), atol=1e-5)


def test_other_prompts_of_parts_and_their_seam_change_the_motion():
    wish = Wish(jnp.stack([OLD, HAPPY]), jnp.array([2.0, 1.0]), MASKS)
    made = chunk(wish)
    assert np.isfinite(made).all()
    for style in (OLD, HAPPY):
        assert np.abs(made - chunk(whole(style, 2.0, CONFIG))).max() > 1e-3
    assert np.abs(chunk(wish, seam=0.5) - made).max() > 1e-3


def test_one_step_is_equation_17_and_19():
    """A single DDIM step from N to 0 is the estimate of z_0; its noise is put together by hand."""
    settings, styles, scales = replace(SETTINGS, steps=1), (OLD, HAPPY), (2.0, 0.5)
    told = TOLD._replace(rhythm=TOLD.rhythm[: K + AHEAD])

    def noise(style, prompted):
        one = told._replace(style=style, prompted=jnp.array(prompted))
        return denoiser.apply(PARAMS, CONFIG, NOISE, 50.0, one)

    each = [s * noise(style, True) + (1 - s) * noise(style, False) for style, s in zip(styles, scales, strict=True)]
    both = jnp.concatenate([each[0][:, :3], each[1][:, 3:]], axis=1)
    expected = diffusion.estimate(diffusion.schedule(CONFIG.diffusion), NOISE, both, 50.0)
    made = chunk(Wish(jnp.stack(styles), jnp.array(scales), MASKS), 0, settings=settings)
    np.testing.assert_allclose(made, expected, rtol=2e-4, atol=2e-3)


def test_a_little_noise_on_the_context_follows_the_key():
    noisy = replace(SETTINGS, context_level=20.0)
    wish = whole(OLD, 2.0, CONFIG)
    assert np.abs(chunk(wish, settings=noisy) - chunk(wish, settings=noisy, seed=1)).max() > 1e-4
    np.testing.assert_array_equal(chunk(wish), chunk(wish, seed=1))


def test_a_rollout_goes_through_the_network_in_chunks():
    wish = whole(OLD, 2.0, CONFIG)
    run = partial(extend, PARAMS, CONFIG, SETTINGS, 0.0)
    made = list(sampling.rollout(run, SETTINGS, lambda first, length: (TOLD, wish), 8, 6, KEY))
    assert [piece.shape for piece in made] == [(3, 6), (3, 6), (2, 6)]
    assert np.isfinite(np.concatenate(made)).all()
