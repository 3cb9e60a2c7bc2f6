"""Windows that begin in another clip's pose: which, whose, and that nothing else of a batch changes."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from zeggs_jax.data.draws import WindowConfig, draw
from zeggs_jax.data.prepare import Prepared
from zeggs_jax.data.windows import batch
from zeggs_jax.motion.pose import to_vector
from zeggs_jax.zeroeggs import objective

OWN = WindowConfig(batch=8, window=6, example=(8, 12), mirror=0.0, pace=0.0)
HALF = replace(OWN, foreign_start=0.5)


def test_a_share_of_the_windows_begins_elsewhere(prepared: Prepared):
    chosen = np.concatenate([batch(prepared, 1, k, HALF).foreign.chosen for k in range(40)])
    assert 0.4 < chosen.mean() < 0.6
    assert batch(prepared, 1, 0, replace(OWN, foreign_start=1.0)).foreign.chosen.all()


def test_the_poses_are_frames_of_any_training_clip(prepared: Prepared):
    drawn = draw(prepared, 1, 3, HALF, "train")
    np.testing.assert_array_equal(batch(prepared, 1, 3, HALF).foreign.pose, prepared.pose[drawn.elsewhere])
    rows = np.concatenate([draw(prepared, 1, k, HALF, "train").elsewhere for k in range(40)])
    ranges = prepared.ranges[prepared.clips("train")]
    inside = (rows[:, None] >= ranges[:, 0]) & (rows[:, None] < ranges[:, 1])
    assert inside.any(axis=1).all()
    assert inside.any(axis=0).all()


def test_all_else_of_a_batch_is_the_same(prepared: Prepared):
    for paced in (0.0, 0.1):
        own, half = (batch(prepared, 2, 5, replace(c, pace=paced)) for c in (OWN, HALF))
        assert own.foreign is None
        jax.tree.map(np.testing.assert_array_equal, own, half._replace(foreign=None))


def test_other_splits_begin_in_their_own_pose(prepared: Prepared):
    assert not batch(prepared, 1, 0, replace(OWN, foreign_start=1.0), split="valid").foreign.chosen.any()


def test_the_body_begins_in_the_chosen_pose_where_its_own_root_is(prepared: Prepared):
    clips = batch(prepared, 1, 3, HALF)
    first = jax.vmap(objective.begin)(clips)
    own = jax.tree.map(lambda a: np.asarray(a[:, 0]), clips.poses)
    vectors, chosen = jax.vmap(to_vector)(first), clips.foreign.chosen
    assert 0 < chosen.sum() < len(chosen)
    np.testing.assert_allclose(vectors[chosen], clips.foreign.pose[chosen], atol=1e-6)
    np.testing.assert_allclose(vectors[~chosen], jax.vmap(to_vector)(own)[~chosen], atol=1e-6)
    jax.tree.map(np.testing.assert_array_equal, first.root, own.root)


@pytest.mark.parametrize("wrong", [{"foreign_start": 1.2}, {"foreign_start": 0.1, "as_released": True, "mirror": None}])
def test_what_does_not_fit_is_refused(wrong):
    with pytest.raises(ValueError, match="foreign_start"):
        replace(WindowConfig(), **wrong)
