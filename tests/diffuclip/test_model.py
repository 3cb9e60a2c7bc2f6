"""The model as a whole: takes to latents of unit variance and back, the words of a window, the conditions of one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data import scale
from zeggs_jax.diffuclip import model, quantiser, representation, vqvae
from zeggs_jax.diffuclip.stages.stage import Take
from zeggs_jax.speech.transcript import Word

WORDS = tuple(Word(f"w{k}", 0.5 * k + 0.1, 0.5 * k + 0.4) for k in range(20))


@pytest.fixture(scope="module")
def encoded(tiny_model, clip):
    """(the scale of latents, latents) of two takes to train on and one that is not, which moves more."""
    motion = representation.encode(clip)[:88]
    takes = [
        Take(str(k), "old", split, gain * motion, np.zeros((22, 2), np.float32), (), ())
        for k, (split, gain) in enumerate((("train", 1.0), ("train", 1.2), ("valid", 3.0)))
    ]
    made = tiny_model
    return model.encode_takes(made.params["codes"], made.config, made.motion_scale, takes)


def test_latents_of_the_training_takes_have_unit_variance(encoded, tiny_model):
    _, made = encoded
    train = np.concatenate([one.latents for one in made[:2]])
    assert train.shape == (44, tiny_model.config.latent_size)
    np.testing.assert_allclose(train.mean(axis=0), 0.0, atol=1e-4)
    np.testing.assert_allclose(train.std(axis=0), 1.0, rtol=1e-3)
    assert np.abs(made[2].latents.std(axis=0) - 1.0).max() > 0.05


def test_the_quantised_latents_are_what_the_codes_stand_for(encoded, tiny_model):
    z_scale, made = encoded
    for one in made:
        raw = np.asarray(scale.invert(z_scale, one.quantised))
        for k, part in enumerate(tiny_model.config.parts):
            book = jax.tree.map(jnp.asarray, vqvae.book(tiny_model.params["codes"][part]))
            meant = quantiser.lookup(book, jnp.asarray(one.codes[:, 2 * k : 2 * k + 2]))
            np.testing.assert_allclose(raw[:, 6 * k : 6 * k + 6], meant, atol=1e-4)


@pytest.mark.parametrize("frames", [1, 62])
def test_latents_are_as_many_as_the_frames_ask_for_and_give_whole_ones_back(tiny_model, clip, frames):
    latents = model.latents_of(tiny_model, representation.encode(clip)[:frames])
    assert len(latents) == -(-frames // 4)
    assert model.motion_of(tiny_model, latents).shape == (4 * len(latents), tiny_model.config.motion_size)


def test_the_words_of_a_window_are_those_a_second_around_it(tiny_model):
    hz = tiny_model.config.latents_hz
    near = model.words_near(WORDS, tiny_model.config, 30, 8)  # from 4 s on, for 1.07 s
    middles = np.array([0.5 * k + 0.25 for k in range(20)])
    inside = [m for m in middles if 3.0 - 0.2 < m < 4.0 + 8 / hz + 1.0 + 0.2]
    times = near.times[near.mask]
    assert len(inside) - 2 <= len(times) <= len(inside)
    np.testing.assert_allclose([np.abs(middles - 4.0 - time).min() for time in times], 0.0, atol=1e-5)


def test_conditions_count_time_in_latents_and_leave_padding_out(tiny_model):
    config = tiny_model.config
    near = model.words_near(WORDS[:3], config, 0, 8)
    heard = np.zeros((8 + config.denoiser.ahead, 2), np.float32)
    tell = jax.jit(model.conditions, static_argnames=("config", "prompted"))
    told = tell(tiny_model.params, config, heard, near, np.zeros(config.prompts.size, np.float32), False)
    assert not told.prompted
    assert told.word_mask.sum() == 3
    np.testing.assert_allclose(told.times[:3], np.array([0.25, 0.75, 1.25]) * config.latents_hz, atol=1e-4)
    np.testing.assert_allclose(told.saliency.sum(), 3.0, rtol=1e-4)  # rescaled: L_t
    assert not np.asarray(told.saliency[3:]).any()
