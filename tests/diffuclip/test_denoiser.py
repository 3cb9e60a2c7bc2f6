"""The denoiser: what each latent may see, proven by gradients; words, prompts and levels; memory of a context."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import denoiser, diffusion
from zeggs_jax.diffuclip.attention import SemanticsAttention, Words, rotate
from zeggs_jax.diffuclip.config import CodesConfig, DenoiserConfig, DiffuclipConfig, JointConfig, PromptsConfig

L, AHEAD, S = 9, 2, 5
TINY = DiffuclipConfig(
    codes=CodesConfig(latent=4),
    joint=JointConfig("words", 6, 1, 2, words=S),
    prompts=PromptsConfig(size=7),
    denoiser=DenoiserConfig(12, 2, 2, ahead=AHEAD, dropout=0.3),
)
LEVEL = jnp.array([0.0, 0.0, 30.0, 400.0, 400.0, 400.0, 700.0, 900.0, 1000.0])


def variant(**changes):
    return replace(TINY, denoiser=replace(TINY.denoiser, **changes))


def told(words=3, prompted=True):
    draw = np.random.default_rng(5)
    return denoiser.Conditions(
        rhythm=jnp.array(draw.uniform(size=(L + AHEAD, 2)), jnp.float32),
        words=jnp.array(draw.normal(size=(S, 6)), jnp.float32),
        saliency=jnp.array(draw.uniform(0.5, 1.5, S), jnp.float32),
        times=jnp.array(np.linspace(-2.0, L, S), jnp.float32),
        word_mask=jnp.array(np.arange(S) < words),
        style=jnp.array(draw.normal(size=7), jnp.float32),
        prompted=jnp.array(prompted),
    )


def latents():
    return normal(2, L, 4)


def normal(seed, *shape):
    return jnp.array(np.random.default_rng(seed).normal(size=shape), jnp.float32)


@pytest.fixture(scope="module")
def params(draw):
    return draw(partial(denoiser.init, config=TINY))


@partial(jax.jit, static_argnames="config")
def run(params, noisy, conditions, level=LEVEL, config=TINY):
    return denoiser.apply(params, config, noisy, level, conditions)


def seen(made):
    """[l, k]: whether output l depends on input row k; from a jacobian [L, C, K, ...]."""
    made = np.asarray(made)
    return np.abs(made).max(axis=(1, *range(3, made.ndim))) > 0


@pytest.mark.parametrize("output", ["noise", "velocity"])
def test_a_latent_sees_itself_and_those_before_it_only(params, output):
    jacobian = jax.jit(jax.jacrev(lambda z: run(params, z, told(), config=variant(output=output))))(latents())
    np.testing.assert_array_equal(seen(jacobian), np.tri(L, dtype=bool))


def test_a_latent_hears_the_audio_until_ahead_latents_after_it_only(params):
    conditions = told()
    jacobian = jax.jit(jax.jacrev(lambda a: run(params, latents(), conditions._replace(rhythm=a))))(conditions.rhythm)
    np.testing.assert_array_equal(seen(jacobian), np.tri(L, L + AHEAD, AHEAD, dtype=bool))


def test_a_level_is_known_from_its_latent_on(params):
    jacobian = jax.jit(jax.jacrev(lambda n: run(params, latents(), told(), n)))(LEVEL)
    np.testing.assert_array_equal(seen(jacobian), np.tri(L, dtype=bool))


def test_masked_words_are_not_seen(params):
    conditions = told(words=3)
    every = jax.jit(jax.jacrev(lambda w: run(params, latents(), conditions._replace(words=w))))(conditions.words)
    assert seen(every)[:, :3].all()
    assert not seen(every)[:, 3:].any()


def test_without_words_there_is_no_attention_to_words(params):
    without = {
        name: {k: v for k, v in part.items() if not k.startswith("words")} if name.startswith("block") else part
        for name, part in params.items()
    }
    expected = run(without, latents(), told(), config=variant(transcript=False))
    np.testing.assert_allclose(run(params, latents(), told(words=0)), expected, atol=1e-6)
    assert np.abs(run(params, latents(), told(words=1)) - expected).max() > 1e-3


def test_the_gradient_is_finite_without_words_and_prompt(params):
    nothing = denoiser.nothing(TINY, L)
    slope = jax.jit(jax.grad(lambda p: jnp.sum(run(p, latents(), nothing) ** 2)))(params)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slope))


def test_without_a_prompt_gamma_is_one_and_beta_zero(params):
    """Bit-equal to a network whose AdaIN gives nothing, whatever the style holds."""
    silent = jax.tree_util.tree_map_with_path(
        lambda path, leaf: jnp.zeros_like(leaf) if "modulation" in jax.tree_util.keystr(path) else leaf, params
    )
    free = run(params, latents(), told(prompted=False))
    np.testing.assert_array_equal(free, run(silent, latents(), told()))
    np.testing.assert_array_equal(free, run(params, latents(), told(prompted=False)._replace(style=jnp.full(7, 9.0))))
    assert np.abs(free - run(params, latents(), told())).max() > 1e-3


def test_concatenated_style_changes_the_output_only_with_a_prompt(draw):
    config, other = variant(style="concatenated"), jnp.ones(7)
    params = draw(partial(denoiser.init, config=config))
    with_it, without = (
        [run(params, latents(), told(prompted=p)._replace(style=style), config=config) for style in (other, -other)]
        for p in (True, False)
    )
    assert np.abs(with_it[0] - with_it[1]).max() > 1e-3
    np.testing.assert_array_equal(without[0], without[1])


def test_a_velocity_means_its_noise(params):
    z = latents()
    noise = run(params, z, told(), config=variant(output="velocity"))
    velocity = run(params, z, told())
    expected = diffusion.noise_of(diffusion.schedule(TINY.diffusion), z, velocity, LEVEL)
    np.testing.assert_allclose(noise, expected, atol=1e-6)


def test_dropout_needs_a_key_and_follows_it(params):
    dropped = jax.jit(lambda seed: denoiser.apply(params, TINY, latents(), LEVEL, told(), jax.random.key(seed)))

    np.testing.assert_array_equal(dropped(0), dropped(0))
    assert np.abs(dropped(0) - dropped(1)).max() > 1e-3
    assert np.abs(dropped(0) - run(params, latents(), told())).max() > 1e-3


@partial(jax.jit, static_argnames="room")
def run_after(params, z, conditions, count, room, shift=0.0):
    """The noise of all latents from `count` on, by way of a memory of `room` latents."""
    context = jnp.where(jnp.arange(room)[:, None] < count, z[:room], 7.0)
    level = jnp.where(jnp.arange(room) < count, LEVEL[:room], 3.0)
    memory = denoiser.remember(params, TINY, context, level, conditions, jnp.arange(room) < count)
    z, level, rhythm = (jnp.roll(x, -count, axis=0) for x in (z, LEVEL, conditions.rhythm))
    moved = conditions._replace(rhythm=rhythm, times=conditions.times + shift)
    return denoiser.apply_after(params, TINY, z, level, moved, count + shift, memory)


@pytest.mark.parametrize("count", [0, 2, 5])
def test_a_remembered_context_gives_the_same_noise(params, count):
    made = run_after(params, latents(), told(), count, room=5)
    np.testing.assert_allclose(made[: L - count], run(params, latents(), told())[count:], atol=1e-5)


def test_a_window_can_begin_anywhere(params):
    """Only distances in time count: latents and words moved together make the same noise."""
    moved = run_after(params, latents(), told(words=4), 0, room=0, shift=17.0)
    np.testing.assert_allclose(moved, run(params, latents(), told(words=4)), atol=2e-5)


def test_audio_of_another_length_is_told(params):
    with pytest.raises(ValueError, match="audio of 11 latents came with 8 noisy ones; expected 10"):
        denoiser.apply(params, TINY, latents()[:8], 3.0, told())


def test_clips_in_a_batch_are_as_alone(params):
    both = jax.tree.map(lambda a, b: jnp.stack([a, b]), told(), told(words=0, prompted=False))
    z = jnp.stack([latents(), -latents()])
    together = jax.vmap(lambda z, c: run(params, z, c))(z, both)
    np.testing.assert_allclose(together[0], run(params, z[0], told()), atol=1e-5)
    np.testing.assert_allclose(together[1], run(params, z[1], told(words=0, prompted=False)), atol=1e-5)


def test_the_paper_s_sizes_are_the_paper_s():
    """127 M by the specification's estimate: attention 28 + 28, feed-forward 57, AdaIN 14."""
    shapes = jax.eval_shape(lambda key: denoiser.init(key, DiffuclipConfig()), jax.random.key(0))
    block = {name: sum(x.size for x in jax.tree.leaves(part)) / 1e6 for name, part in shapes["block0"].items()}
    assert round(12 * block["attention"]) == round(12 * block["words"]) == 28
    assert round(12 * (block["widen"] + block["narrow"])) == 57
    assert round(12 * block["adain"]) == 14
    assert 125 < sum(x.size for x in jax.tree.leaves(shapes)) / 1e6 < 131


def hearing(timed=False, heads=2):
    """(parameters, the layer as a function of (vectors, saliency)) of attention to five words, three of them there."""
    layer, x, mask = SemanticsAttention(heads, timed), normal(0, 3, 8), jnp.arange(S) < 3

    def words(vectors, saliency):
        return Words(vectors, saliency, jnp.arange(5.0), mask)

    params = jax.jit(layer.init)(jax.random.key(2), x, jnp.zeros(3), words(normal(1, S, 6), jnp.ones(S)))
    return params["params"], jax.jit(lambda v, s: layer.apply(params, x, jnp.zeros(3), words(v, s))), x


def test_equation_12_to_the_letter():
    """Against plain loops: softmax((Q K^T / sqrt(C)) * s) V over the words that are there."""
    params, layer, x = hearing(heads=1)
    vectors, saliency = normal(1, S, 6), jnp.array([0.5, 0.2, 0.3, 9.0, 9.0])

    def dense(name, x):
        part = {key: np.asarray(value, np.float64) for key, value in params[name].items()}
        return np.asarray(x, np.float64) @ part["weight"].T + part["bias"]

    both, expected = dense("keys_values", vectors), []
    for row in dense("queries", x):
        score = np.array([row @ both[s, :8] / np.sqrt(8) * float(saliency[s]) for s in range(3)])
        weight = np.exp(score) / np.exp(score).sum()
        expected.append(sum(w * both[s, 8:] for s, w in enumerate(weight)))
    np.testing.assert_allclose(layer(vectors, saliency), dense("project_out", expected), atol=1e-5)


def test_saliency_decides_which_word_is_heard():
    _, layer, _ = hearing()
    heard = jax.jit(jax.jacrev(layer))
    flat = heard(normal(1, S, 6), jnp.zeros(S))[:, :, :3]  # all logits 0: every word alike
    np.testing.assert_allclose(flat, np.broadcast_to(flat[:, :, :1], flat.shape), atol=1e-6)
    assert np.ptp(np.abs(heard(normal(1, S, 6), jnp.ones(S))[:, :, :3]).sum((0, 1, 3))) > 1e-2


def test_words_are_told_apart_by_their_times_only_if_asked():
    same = jnp.broadcast_to(normal(1, 1, 6), (S, 6))
    for timed in (False, True):
        _, layer, _ = hearing(timed)
        slope = np.asarray(jax.jit(jax.jacrev(layer))(same, jnp.ones(S)))[:, :, :3]
        assert (np.ptp(slope, axis=2).max() > 1e-3) == timed


@pytest.mark.parametrize("width", [1, 4, 9])
def test_rotated_products_depend_on_distance_only(width):
    query, key, at, times = normal(0, 4, 2, width), normal(1, 4, 2, width), jnp.arange(4.0), normal(2, 4)

    @jax.jit
    def products(by):
        return jnp.einsum("qhd,khd->hqk", rotate(query, at + by), rotate(key, times + by))

    for shift in (-100.0, 0.37, 40.0):
        np.testing.assert_allclose(products(shift), products(0.0), atol=1e-3)
    length = np.linalg.norm(rotate(query, at), axis=-1)
    np.testing.assert_allclose(length, np.linalg.norm(query, axis=-1), rtol=1e-5)
