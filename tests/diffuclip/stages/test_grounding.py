"""The anchors of the text prompts' stage: one of unit length for every take of the training."""

import jax
import numpy as np

from zeggs_jax.data import scale
from zeggs_jax.diffuclip import prompts
from zeggs_jax.diffuclip.stages import prompts as stage


def test_every_take_of_the_training_has_an_anchor_where_its_motion_lies(config, leaning):
    params = stage.stage(config, leaning, {}).finish(stage.stage(config, leaning, {}).begin(jax.random.key(0)))
    takes = [take for take in leaning.takes if take.split == "train"]
    assert params["anchors"].shape == (len(takes), config.prompts.size)
    np.testing.assert_allclose(np.linalg.norm(params["anchors"], axis=1), 1.0, atol=1e-5)
    rows = scale.apply(leaning.motion_scale, takes[0].motion[: config.prompts.frames])
    own = prompts.encode_motion(params, config, rows, np.ones(len(rows), bool))
    assert params["anchors"][0] @ own > 0.9
