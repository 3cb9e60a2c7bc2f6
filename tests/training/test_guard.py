"""When a run must stop, and when it must not."""

import math

import pytest

from zeggs_jax.training.guard import find_fault

CALM = [{"step": k, "loss": 2.0 + 0.1 * (k % 3), "near": 1.0, "far": 1.0, "gradient": 3.0} for k in range(20)]


def values(near: float = 1.0, far: float = 1.0, gradient: float = 3.0) -> dict[str, float]:
    return {"loss": near + far, "near": near, "far": far, "gradient": gradient}


def test_usual_numbers_pass():
    assert find_fault(values(), CALM, 100.0) is None
    assert find_fault(values(near=150.0), CALM, 100.0) is None
    assert find_fault(values(gradient=1e9), CALM, 100.0) is None


def test_an_explosion_names_the_loss_and_the_term():
    told = find_fault(values(far=900.0), CALM, 100.0)
    assert told == "the loss is 901, more than 100 times the usual 2.1; most of it comes from 'far'"
    assert find_fault(values(far=900.0), CALM, None) is None


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_the_term_that_is_not_finite_is_named(wrong):
    assert find_fault(values(far=wrong), CALM, None) == "'far' is not finite"
    assert find_fault(values() | {"loss": wrong}, [], 100.0) == "'loss' is not finite"
    assert find_fault(values(gradient=wrong), [], 100.0) == "'gradient' is not finite"


def test_the_first_updates_may_do_anything_finite():
    assert find_fault(values(far=1e20), CALM[:4], 100.0) is None
    assert find_fault(values(far=1e20), CALM[:5], 100.0) is not None


def test_a_loss_that_falls_and_is_annealed_passes():
    """The paper's schedule: the loss falls, its divergence term appears from nothing."""
    log = [{"step": k, "loss": 60.0 / (1 + k), "kl": 1e-12} for k in range(50)]
    assert find_fault({"loss": 3.0, "kl": 2.9}, log, 100.0) is None


def test_logs_of_nothing_but_zeros_do_not_stop():
    assert find_fault({"loss": 1e-3}, [{"step": k, "loss": 0.0} for k in range(9)], 100.0) is None
