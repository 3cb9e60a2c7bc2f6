"""DCI and SAP where the answer is known: factors as they are, turned, said twice, not said; and slices of parts."""

import numpy as np
import pytest

from zeggs_jax.metrics import disentanglement as d

COUNT, FACTORS = 300, 5


@pytest.fixture(scope="module")
def factors():
    return np.random.default_rng(0).uniform(-1.0, 1.0, (COUNT, FACTORS))


def turned(factors, seed=1):
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(factors.shape[1],) * 2))
    return factors @ turn


def noise(columns, seed=2):
    return np.random.default_rng(seed).normal(size=(COUNT, columns))


def test_factors_in_another_order_scale_and_sign_are_perfect(factors):
    codes = factors[:, [3, 0, 4, 1, 2]] * np.array([1.0, -50.0, 1e-3, 7.0, -2.0]) + 11.0
    found = d.score(codes, factors)
    for name in ("disentanglement", "completeness", "informativeness"):
        assert getattr(found, name) == pytest.approx(1.0, abs=0.02), name
    assert found.sap > 0.9
    assert found.importance.argmax(0).tolist() == [1, 3, 4, 0, 2]


def test_a_turn_keeps_what_is_said_and_loses_the_order(factors):
    found = d.score(turned(factors), factors)
    assert found.informativeness > 0.98
    assert found.disentanglement < 0.5
    assert found.completeness < 0.5
    assert found.sap < 0.4


def test_noise_says_nothing(factors):
    found = d.score(noise(6), factors)
    assert found.informativeness < 0.03
    assert found.disentanglement == pytest.approx(0.0, abs=0.15)
    assert found.sap < 0.05


def test_codes_that_are_idle_or_still_change_nothing(factors):
    plain = d.score(factors, factors)
    for more in (noise(3), np.full((COUNT, 2), 4.0)):
        found = d.score(np.concatenate([factors, more], axis=1), factors)
        assert found.disentanglement == pytest.approx(plain.disentanglement, abs=0.02)
        assert found.completeness == pytest.approx(plain.completeness, abs=0.02)


def test_one_code_of_two_factors_is_complete_but_not_disentangled(factors):
    two = np.stack([factors[:, 0] + factors[:, 1], factors[:, 2]], axis=1)
    found = d.score(two, factors[:, :3])
    assert found.completeness > 0.95
    assert found.disentanglement < 0.9
    np.testing.assert_allclose(found.explained, [0.5, 0.5, 1.0], atol=0.1)


def test_scores_do_not_depend_on_units(factors):
    codes = turned(factors) + 0.3 * noise(FACTORS)
    scale, shift = np.array([1e-4, 3.0, -2.0, 1e3, 0.5]), np.arange(5.0)
    plain, other = d.score(codes, factors), d.score(codes * scale + shift, factors * scale[::-1] - shift)
    np.testing.assert_allclose(other[:4], plain[:4], atol=1e-6)


def test_more_noise_says_less(factors):
    said = [d.score(factors + sigma * noise(FACTORS), factors).informativeness for sigma in (0.0, 0.3, 1.0, 3.0)]
    assert said == sorted(said, reverse=True)
    assert said[1] == pytest.approx(1.0 / (1.0 + 0.09 * 3.0), abs=0.05)  # variance of U(-1, 1) is 1/3


def test_lasso_is_the_known_solution_of_codes_that_are_orthogonal():
    codes = np.sqrt(8) * np.linalg.qr(np.random.default_rng(0).normal(size=(8, 3)))[0]
    weights = np.array([[2.0], [-0.5], [0.05]])
    np.testing.assert_allclose(d.lasso(codes, codes @ weights, 0.1), [[1.9], [-0.4], [0.0]], atol=1e-9)


def test_entropy_by_hand():
    half = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, 0.0]])
    one_of_two = 1.0 - np.log(2.0) / np.log(3.0)
    assert d.disentangled(half) == pytest.approx((2.0 * one_of_two + 2.0) / 4.0)
    assert d.disentangled(half, equally=True) == pytest.approx((one_of_two + 1.0) / 3.0)


def test_slices_that_move_their_own_part():
    assert d.own_share(np.diag([1.0, 3.0])) == 1.0
    assert d.own_share(np.ones((4, 4))) == 0.25
    for wrong in (np.zeros((2, 2)), -np.eye(2)):
        with pytest.raises(ValueError, match="give numbers that are at least 0"):
            d.own_share(wrong)


@pytest.mark.parametrize(
    ("codes", "factors", "says"),
    [
        (np.ones((30, 2)), np.ones((29, 2)), "30 embeddings .* 29 rows"),
        (np.ones((9, 2)), np.ones((9, 2)), "give 20 clips or more"),
        (np.ones((30, 1)), np.ones((30, 2)), "two numbers and two factors"),
        (np.full((30, 2), np.nan), np.ones((30, 2)), "not finite"),
        (noise(2)[:30], np.stack([np.arange(30.0), np.ones(30)], axis=1), "factor 1 is the same in all 30"),
    ],
)
def test_wrong_input_is_one_sentence(codes, factors, says):
    with pytest.raises(ValueError, match=says):
        d.score(codes, factors)
