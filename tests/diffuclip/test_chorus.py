"""Bodies that are performed side by side do what each does alone."""

import numpy as np
import pytest

import chorus
from chorus import Voice
from zeggs_jax.diffuclip import generate as g
from zeggs_jax.diffuclip import guidance
from zeggs_jax.speech import wav
from zeggs_jax.speech.transcript import Word


@pytest.mark.slow
def test_two_voices_of_other_lengths_words_and_prompts_are_as_each_alone(tiny_model):
    config = tiny_model.config
    rng = np.random.default_rng(0)
    styles = rng.normal(size=(3, config.prompts.size)).astype(np.float32)
    styles /= np.linalg.norm(styles, axis=1, keepdims=True)
    first = g.Wishes((0.0, 1.5), tuple(guidance.whole(style, 2.0, config) for style in styles[:2]))
    second = g.Wishes((0.0,), (guidance.whole(styles[2], 1.0, config),))
    wave = (0.1 * rng.normal(size=3 * wav.RATE_HZ)).astype(np.float32)
    words = [Word("big", 0.4, 0.8), Word("house", 0.9, 1.4)]
    voices = [Voice(wave, words, first, 5), Voice(wave[: 2 * wav.RATE_HZ], (), second, 6)]
    for voice, made in zip(voices, chorus.synthesize(tiny_model, voices, 3), strict=True):
        alone = g.synthesize(tiny_model, voice.wave, voice.words, voice.wishes, g.Request(steps=3, seed=voice.seed))
        np.testing.assert_allclose(made, alone, atol=1e-4 * float(np.abs(alone).max()))
