"""Factors from motion: exact on a known linear law, blind to place and heading, right about styles it never saw."""

import numpy as np
import pytest

from zeggs_jax.metrics import factors
from zeggs_jax.synthetic import corpus, styles

NAMES = styles.StyleFactors._fields


@pytest.fixture(scope="module")
def clip():
    return corpus.style_clip("happy", 4.0, 30, 3)


def test_a_law_in_the_measures_and_their_squares_is_found_again():
    draw = np.random.default_rng(0)
    measured = draw.uniform(-1.0, 1.0, (200, 4))
    known = np.stack([3.0 * measured[:, 0] - measured[:, 2] + 7.0, measured[:, 1] ** 2], axis=1)
    ruler = factors.fit(measured[:150], known[:150], ("line", "bowl"), ridge=1e-6)
    np.testing.assert_allclose(factors.recover(ruler, measured[150:]), known[150:], atol=1e-3)
    assert factors.recover(ruler, measured[0]).shape == (2,)


def test_a_measure_without_spread_and_one_far_outside_do_no_harm():
    draw = np.random.default_rng(1)
    measured = np.concatenate([draw.uniform(-1.0, 1.0, (60, 2)), np.ones((60, 1))], axis=1)
    ruler = factors.fit(measured, measured[:, :1], ("first",), ridge=1e-3)
    assert factors.recover(ruler, np.array([0.5, 0.0, 1.0]))[0] == pytest.approx(0.5, abs=0.02)
    assert abs(factors.recover(ruler, np.array([0.5, 0.0, 1e9]))[0]) < 10.0


def test_rows_that_do_not_fit_and_short_clips_are_refused(clip):
    with pytest.raises(ValueError, match="3 clips, and 2 factors of 4"):
        factors.fit(np.zeros((3, 5)), np.zeros((4, 2)), ("a", "b"))
    with pytest.raises(ValueError, match="7 frames"):
        factors.measures(clip._replace(euler=clip.euler[:7], positions=clip.positions[:7]))


def test_measures_do_not_depend_on_where_the_body_stands_and_looks(clip):
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # 90 degrees about y
    positions, euler = clip.positions.copy(), clip.euler.copy()
    positions[:, 0] = positions[:, 0] @ turn.T + [30.0, 0.0, -80.0]
    hips = np.stack([_matrix(angles) for angles in euler[:, 0]])
    euler[:, 0] = [_zyx(turn @ matrix) for matrix in hips]
    moved = clip._replace(positions=positions, euler=euler)
    np.testing.assert_allclose(factors.measures(moved), factors.measures(clip), atol=2e-3)


def test_factors_of_unseen_styles_are_recovered():
    random = [styles.random_style(k) for k in range(45)]
    measured = np.stack([factors.measures(corpus.style_clip(f, 5.0, 30, k)) for k, f in enumerate(random)])
    ruler = factors.fit(measured, np.array(random), NAMES)
    for style in ("old", "happy", "angry"):
        truth = styles.STYLES[style]
        found = styles.StyleFactors(*factors.recover(ruler, factors.measures(corpus.style_clip(style, 5.0, 30, 901))))
        assert found.hand_height == pytest.approx(truth.hand_height, abs=6.0)
        assert found.lean == pytest.approx(truth.lean, abs=0.06)
        assert found.crouch == pytest.approx(truth.crouch, abs=1.0)
        assert found.amplitude == pytest.approx(truth.amplitude, abs=5.0)


def _matrix(zyx: np.ndarray) -> np.ndarray:
    (cz, cy, cx), (sz, sy, sx) = np.cos(zyx), np.sin(zyx)
    about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    return about_z @ about_y @ about_x


def _zyx(m: np.ndarray) -> np.ndarray:
    return np.array([np.arctan2(m[1, 0], m[0, 0]), -np.arcsin(m[2, 0]), np.arctan2(m[2, 1], m[2, 2])])
