"""Styles are points of one factor space, and random ones stay inside it."""

import numpy as np
import pytest

from zeggs_jax.synthetic import styles


def test_named_styles_lie_inside_the_bounds_and_apart():
    points = np.array(list(styles.STYLES.values()))
    assert np.all(points >= np.array(styles.LOWEST))
    assert np.all(points <= np.array(styles.HIGHEST))
    scaled = points / (np.array(styles.HIGHEST) - np.array(styles.LOWEST))
    apart = np.linalg.norm(scaled[:, None] - scaled[None], axis=-1) + 9.0 * np.eye(len(points))
    assert apart.min() > 0.4


def test_random_styles_are_deterministic_inside_and_varied():
    points = np.array([styles.random_style(seed) for seed in range(60)])
    np.testing.assert_array_equal(points[7], styles.random_style(7))
    assert np.all(points >= np.array(styles.LOWEST))
    assert np.all(points <= np.array(styles.HIGHEST))
    assert np.all(points.std(axis=0) > 0.08 * (np.array(styles.HIGHEST) - np.array(styles.LOWEST)))


def test_oration_is_held_out():
    assert "oration" in styles.STYLES
    assert "oration" not in styles.TRAINING


def test_blend_is_linear_and_checks_its_weights():
    happy, sad = styles.STYLES["happy"], styles.STYLES["sad"]
    assert styles.blend([happy, sad], [1.0, 0.0]) == happy
    middle = styles.blend([happy, sad], [0.5, 0.5])
    np.testing.assert_allclose(middle, 0.5 * (np.array(happy) + np.array(sad)))
    with pytest.raises(ValueError, match="2 styles and 1 weights"):
        styles.blend([happy, sad], [1.0])
    with pytest.raises(ValueError, match="neutral"):
        styles.find("jolly")
