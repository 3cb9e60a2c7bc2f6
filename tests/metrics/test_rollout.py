"""What a validation reports: a perfect rollout, a moved one, a trembling one, bodies without hands."""

import dataclasses

import numpy as np
import pytest

from zeggs_jax.metrics import rollout
from zeggs_jax.motion import bvh, edit
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.skeleton import Roles
from zeggs_jax.zeroeggs import examples


@pytest.fixture(scope="module")
def clip() -> Clip:
    return edit.trim(bvh.read(examples.bundled()["happy"]), 0, 120)


@pytest.fixture(scope="module")
def energy() -> np.ndarray:
    return np.random.default_rng(0).normal(size=120)


def test_the_recording_itself_is_perfect(clip, energy):
    values = rollout.measure(clip, clip, energy)
    assert values["position_cm"] == 0.0
    assert values["jerk_ratio"] == values["hand_speed_ratio"] == 1.0
    assert values["beat"] == values["beat_recorded"]


def test_a_body_elsewhere_is_as_far_as_it_is(clip, energy):
    moved = clip.positions.copy()
    moved[:, 0] += np.array([3.0, 0.0, 4.0])
    values = rollout.measure(clip._replace(positions=moved), clip, energy)
    assert values["position_cm"] == pytest.approx(5.0, rel=1e-4)
    assert values["hand_speed_ratio"] == pytest.approx(1.0, rel=1e-4)


def test_trembling_and_freezing_show(clip, energy):
    trembling = clip._replace(euler=clip.euler + 0.05 * np.random.default_rng(1).normal(size=clip.euler.shape))
    assert rollout.measure(trembling, clip, energy)["jerk_ratio"] > 1.5
    still = clip._replace(euler=clip.euler[:1].repeat(120, 0), positions=clip.positions[:1].repeat(120, 0))
    assert rollout.measure(still, clip, energy)["hand_speed_ratio"] < 1e-3


def test_a_body_without_hands_is_measured_without_them(clip, energy):
    handless = clip._replace(skeleton=dataclasses.replace(clip.skeleton, roles=Roles(hips="Hips")))
    assert rollout.measure(handless, handless, energy).keys() == {"position_cm", "jerk_ratio"}
