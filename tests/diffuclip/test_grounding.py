"""Texts and videos brought to the motions of the training: unit length, nearest first, and only where asked for."""

from dataclasses import replace

import numpy as np

from zeggs_jax.diffuclip import prompts, run_folder
from zeggs_jax.diffuclip.config import SMALL
from zeggs_jax.diffuclip.joint_embedding import unit

ANCHORS = np.eye(4, dtype=np.float32)
PARAMS = {"anchors": ANCHORS}
FREE = replace(SMALL, prompts=replace(SMALL.prompts, grounded=False))


def test_a_prompt_comes_to_the_nearest_motions_and_keeps_its_length():
    beside = np.asarray(unit(np.array([0.9, 0.1, 0.0, 0.0], np.float32)))
    found = prompts.ground(PARAMS, SMALL, beside)
    np.testing.assert_allclose(np.linalg.norm(found), 1.0, atol=1e-5)
    assert found[0] > 0.99
    between = np.asarray(unit(np.array([1.0, 1.0, -1.0, -1.0], np.float32)))  # as far from the motions as it can be
    np.testing.assert_allclose(prompts.ground(PARAMS, SMALL, between)[:2], np.sqrt(0.5), atol=1e-4)


def test_without_anchors_or_the_setting_a_prompt_stays_as_it_is():
    prompt = np.asarray(unit(np.arange(4, dtype=np.float32)))
    np.testing.assert_array_equal(prompts.ground({}, SMALL, prompt), prompt)
    np.testing.assert_array_equal(prompts.ground(PARAMS, FREE, prompt), prompt)
    assert not np.allclose(prompts.ground(PARAMS, SMALL, prompt), prompt, atol=1e-3)


def test_a_run_goes_on_whether_its_prompts_are_grounded_or_not():
    ours, other = (run_folder.seen((), None, config, ("prompts",)) for config in (SMALL, FREE))
    assert ours == other
    wider = replace(SMALL, prompts=replace(SMALL.prompts, width=64))
    assert run_folder.seen((), None, wider, ("prompts",)) != ours
