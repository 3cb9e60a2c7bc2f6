"""A cut look-ahead is the whole model told no more than that: the last frame it knows stands for those that follow."""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "experiments"))

import look_ahead
from zeggs_jax.data.scale import Scale, Scales
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs.speech_encoder import SpeechEncoder


@pytest.mark.parametrize("lookahead", [0, 1, 3])
def test_a_cut_model_is_the_whole_one_whose_speech_ends_there(lookahead):
    config = m.ZeroEggsConfig(speech=m.SpeechEncoderConfig(features=4, hidden=6, size=5, kernel=7))
    key, sizes = jax.random.key(0), (4, config.vector_size + 3, config.vector_size)
    scales = Scales(*(Scale(np.zeros(n, np.float32), np.ones(n, np.float32)) for n in sizes))
    speech = SpeechEncoder(config.speech).init(key, jnp.zeros((1, 4)))["params"]
    whole = m.Model(config, {"speech": speech}, scales, None)  # pyright: ignore
    cut = look_ahead.cut(whole, lookahead)
    assert (cut.config.speech.ahead, cut.config.speech.behind) == (lookahead, 6 - lookahead)
    rows = jax.random.normal(jax.random.key(1), (12, 4))
    ours = m.encode_speech(cut.params, cut.config, scales, rows)
    held = np.minimum(np.arange(12)[None], np.arange(12)[:, None] + lookahead)  # what is known of the rows at frame t
    told = jax.vmap(lambda known: m.encode_speech(whole.params, config, scales, known))(rows[held])
    np.testing.assert_allclose(ours, told[np.arange(12), np.arange(12)], atol=1e-5)
