"""A stage goes on only with what it was begun with: motions, words, its settings and those of the stages before it."""

from dataclasses import replace

import numpy as np
import pytest

from zeggs_jax.diffuclip import run_folder
from zeggs_jax.diffuclip.config import SMALL
from zeggs_jax.diffuclip.stages.stage import Take
from zeggs_jax.diffuclip.train import STAGES
from zeggs_jax.speech.transcript import Word
from zeggs_jax.training import checkpoint

TAKE = Take("a", "old", "train", np.ones((8, 9), np.float32), np.zeros((2, 2), np.float32), (), ("old",))
ALL = tuple(STAGES)


def seen(config=SMALL, take=TAKE, only=ALL):
    return run_folder.seen([take], None, config, only)


def refused(tmp_path, before, now, name):
    checkpoint.save(tmp_path / "step", {"x": np.ones(1)}, before[name])
    try:
        run_folder.check_same(tmp_path / "step", now[name], tmp_path)
    except ValueError as error:
        return str(error)
    return ""


def test_every_stage_has_its_settings_named():
    assert list(run_folder.READS) == list(STAGES)


@pytest.mark.parametrize("name", ALL)
def test_the_same_goes_on_and_how_often_is_logged_does_not_matter(tmp_path, name):
    learn = f"learn_{name}"
    other = replace(SMALL, **{learn: replace(getattr(SMALL, learn), log_every=7, checkpoint_every=3)})
    assert not refused(tmp_path, seen(), seen(other), name)


def test_new_captions_keep_the_codes_and_nothing_else(tmp_path):
    told = seen(take=TAKE._replace(captions=("tired",), words=(Word("no", 0.0, 0.2),)))
    assert not refused(tmp_path, seen(), told, "codes")
    for name in ALL[1:]:
        assert "another corpus" in refused(tmp_path, seen(), told, name)
    moved = seen(take=TAKE._replace(motion=2 * TAKE.motion))
    assert "another corpus" in refused(tmp_path, seen(), moved, "codes")


def test_a_setting_holds_back_its_stage_and_the_later_ones(tmp_path):
    other = seen(replace(SMALL, joint=replace(SMALL.joint, width=48)))
    assert not refused(tmp_path, seen(), other, "codes")
    for name in ALL[1:]:
        assert f"joint.width = {SMALL.joint.width}, now 48" in refused(tmp_path, seen(), other, name)
    longer = seen(replace(SMALL, learn_prompts=replace(SMALL.learn_prompts, steps=1)))
    assert not refused(tmp_path, seen(), longer, "joint")
    assert "learn_prompts.steps" in refused(tmp_path, seen(), longer, "denoiser")
