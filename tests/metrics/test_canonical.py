"""Canonical correlation: known answers, invariance under mixing, and no praise for two motions that share nothing."""

import numpy as np
import pytest

from zeggs_jax.metrics import canonical


def test_a_shared_line_is_found_through_any_mixing():
    draw = np.random.default_rng(0)
    first = draw.normal(size=(400, 4))
    second = np.stack([first[:, 2] * 3.0, *draw.normal(size=(2, 400))], axis=1) @ draw.normal(size=(3, 3)) + 5.0
    found = canonical.fit(first @ draw.normal(size=(4, 4)) - 2.0, second)
    assert found.correlation == pytest.approx(1.0)


def test_two_columns_correlate_as_pearson_says():
    draw = np.random.default_rng(1)
    first = draw.normal(size=(300, 1))
    second = 0.6 * first + 0.8 * draw.normal(size=(300, 1))
    assert canonical.fit(first, second).correlation == pytest.approx(abs(np.corrcoef(first[:, 0], second[:, 0])[0, 1]))


def test_it_is_what_the_equations_say():
    """Square roots of the eigenvalues of A^-1 C B^-1 C^T."""
    draw = np.random.default_rng(2)
    first = draw.normal(size=(200, 3))
    second = np.concatenate([first[:, :2] + draw.normal(size=(200, 2)), draw.normal(size=(200, 1))], axis=1)
    joint = np.cov(np.concatenate([first, second], axis=1), rowvar=False)
    a, b, c = joint[:3, :3], joint[3:, 3:], joint[:3, 3:]
    wanted = np.sqrt(np.linalg.eigvals(np.linalg.solve(a, c) @ np.linalg.solve(b, c.T)).real.max())
    found = canonical.fit(first, second)
    assert found.correlation == pytest.approx(wanted)
    assert canonical.score(found, first, second) == pytest.approx(wanted)


def test_columns_that_repeat_or_do_not_move_do_no_harm():
    draw = np.random.default_rng(3)
    first = draw.normal(size=(200, 2))
    padded = np.concatenate([first, first, np.ones((200, 1))], axis=1)
    second = draw.normal(size=(200, 2))
    assert canonical.fit(padded, second).correlation == pytest.approx(canonical.fit(first, second).correlation)


def test_fitted_on_its_own_clip_noise_looks_related_and_held_out_it_does_not():
    draw = np.random.default_rng(4)
    first, second = draw.normal(size=(2, 8, 60, 8))
    own = [canonical.fit(a, b).correlation for a, b in zip(first, second, strict=True)]
    assert np.mean(own) > 0.5
    assert abs(canonical.held_out(list(first), list(second)).mean()) < 0.15


def test_a_relation_in_all_clips_is_found_in_the_one_left_out_and_falls_with_a_shift(gesture):
    clips = [gesture(seed).positions[:, [5, 9]].reshape(240, -1) for seed in range(6)]
    found = [canonical.held_out(clips, [np.roll(c, n, axis=0) for c in clips]).mean() for n in (0, 4, 8, 60)]
    assert found[0] == pytest.approx(1.0)
    assert found[:3] == sorted(found[:3], reverse=True)
    assert found[-1] < 0.6


def test_what_cannot_be_correlated_is_refused():
    draw = np.random.default_rng(5)
    first = draw.normal(size=(60, 3))
    with pytest.raises(ValueError, match="60 and 59 frames"):
        canonical.fit(first, first[:59])
    with pytest.raises(ValueError, match="60 frames are too few to correlate 43 columns"):
        canonical.fit(first, draw.normal(size=(60, 40)))
    with pytest.raises(ValueError, match="stands still"):
        canonical.fit(first, np.ones((60, 2)))
    with pytest.raises(ValueError, match="NaN"):
        canonical.fit(first, np.full((60, 2), np.nan))
    with pytest.raises(ValueError, match="1 and 1 clips"):
        canonical.held_out([first], [first])
