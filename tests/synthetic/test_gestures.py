"""The performed body: planted, human, on the beat, and of the style that was asked for."""

import itertools
from functools import cache

import numpy as np
import pytest

from zeggs_jax.motion import features
from zeggs_jax.synthetic import body, corpus, gestures, prosody, ranges, sentences, strokes, styles, voice

FRAMES = 512
EVERY = [*styles.STYLES, "random1", "random2", "random3"]


@cache
def speech():
    wave, words = voice.speak(sentences.monologue(1, 60), 1)
    return prosody.known(words, wave), wave


def factors(name: str) -> styles.StyleFactors:
    return styles.random_style(int(name[6:])) if name.startswith("random") else styles.STYLES[name]


@cache
def clip(name: str):
    return gestures.perform(speech()[0], factors(name), FRAMES)


@cache
def world(name: str) -> np.ndarray:
    return np.asarray(features.world_positions(clip(name)))


def joint(name: str, joint_name: str) -> np.ndarray:
    return world(name)[:, body.rest_skeleton().index(joint_name)]


def hand_height(name: str) -> np.ndarray:
    """Height of both wrists over their shoulder joints, cm."""
    return np.stack([joint(name, f"{s}Hand")[:, 1] - joint(name, f"{s}Arm")[:, 1] for s in ("Left", "Right")])


def test_the_rest_body_is_human():
    skeleton = body.rest_skeleton()
    positions = np.zeros((len(skeleton), 3))
    for j, parent in enumerate(skeleton.parents):
        positions[j] = skeleton.offsets[j] + (positions[parent] if parent >= 0 else 0.0)
    assert 170.0 < positions[skeleton.index("HeadEnd"), 1] < 180.0
    assert 0.0 < positions[skeleton.index("LeftToeBase"), 1] < 4.0
    span = positions[skeleton.index("LeftHandMiddle4"), 0] - positions[skeleton.index("RightHandMiddle4"), 0]
    assert 160.0 < span < 185.0
    mirrored = positions[list(skeleton.mirror_map())] * np.array([[-1.0, 1.0, 1.0]])
    np.testing.assert_allclose(mirrored, positions, atol=1e-9)


@pytest.mark.parametrize("name", EVERY)
def test_feet_stay_planted(name):
    for side in ("Left", "Right"):
        for part in ("Foot", "ToeBase"):
            place = joint(name, f"{side}{part}")
            assert np.linalg.norm(np.diff(place, axis=0), axis=1).max() * 30.0 < 0.5
        np.testing.assert_allclose(joint(name, f"{side}Foot")[:, 1], body.ANKLE, atol=0.05)


@pytest.mark.parametrize("name", EVERY)
def test_joints_stay_inside_human_ranges(name):
    assert ranges.joints_outside_range(clip(name)) == {}


def test_a_broken_elbow_is_outside_its_range():
    euler = clip("neutral").euler.copy()
    euler[:50, body.rest_skeleton().index("LeftForeArm")] = [0.0, 1.0, 0.0]  # bent backwards
    broken = clip("neutral")._replace(euler=euler)
    assert ranges.share_outside_range(broken) == pytest.approx(50 / FRAMES)
    assert set(ranges.joints_outside_range(broken)) == {"LeftForeArm"}


@pytest.mark.parametrize("name", EVERY)
def test_knees_bend_forward_and_elbows_stay_out_of_the_trunk(name):
    for side in ("Left", "Right"):
        knee, hip, ankle = (joint(name, f"{side}{part}") for part in ("Leg", "UpLeg", "Foot"))
        assert np.all(knee[:, 2] > 0.5 * (hip + ankle)[:, 2])
        elbow, shoulder = joint(name, f"{side}ForeArm"), joint(name, f"{side}Arm")
        assert np.all(np.abs(elbow[:, 0]) > np.abs(shoulder[:, 0]) - 4.0)
        wrist, chest = joint(name, f"{side}Hand"), joint(name, "Spine2")
        beside = np.abs(wrist[:, 0] - chest[:, 0]) > 17.0
        assert np.all(beside | (wrist[:, 2] - joint(name, "Hips")[:, 2] > 9.0))


def test_same_seed_same_clip():
    again = gestures.perform(speech()[0], factors("happy"), FRAMES)
    other = gestures.perform(speech()[0], factors("happy"), FRAMES, seed=1)
    np.testing.assert_array_equal(again.euler, clip("happy").euler)
    assert np.abs(other.euler - again.euler).max() > 1e-3


@pytest.mark.parametrize("name", styles.STYLES)
def test_strokes_surround_stresses(name):
    heard, style = speech()[0], factors(name)
    found = [p for p in strokes.schedule(heard, style) if p.kind == "stroke"]
    assert len(found) > 10
    for phase in found:
        nearest = heard.time[np.argmin(np.abs(heard.time - (phase.start + 0.55 * phase.seconds)))]
        assert phase.start < nearest < phase.start + phase.seconds
        assert nearest - phase.start <= strokes.LONGEST_LEAD + 1e-9


def test_phases_come_in_mcneills_order():
    phases = strokes.schedule(speech()[0], factors("neutral"))
    kinds = [p.kind for p in phases]
    assert {"preparation", "stroke", "retraction"} <= set(kinds)
    for before, after in itertools.pairwise(kinds):
        assert not (before == "preparation" and after != "stroke")
        assert not (before == "retraction" and after not in ("preparation", "stroke"))
    assert all(a.start <= b.start + 1e-9 for a, b in itertools.pairwise(phases))


def test_moves_are_minimum_jerk():
    u = np.linspace(0.0, 1.0, 101)
    s = strokes.minimum_jerk(u)
    np.testing.assert_allclose(s + s[::-1], 1.0, atol=1e-12)
    np.testing.assert_allclose(np.gradient(s, u)[[0, -1]], 0.0, atol=1e-3)
    assert np.gradient(s, u).max() == pytest.approx(1.875, abs=1e-3)


@pytest.mark.parametrize("name", ["neutral", "happy", "angry", "scared", "oration"])
def test_hands_move_with_the_voice(name):
    level = prosody.envelope(speech()[1])
    loud = np.interp(np.arange(FRAMES) / 30.0, np.arange(len(level)) / prosody.ENVELOPE_HZ, level)
    loud = np.convolve(loud, np.ones(7) / 7.0, mode="same")
    hands = np.stack([joint(name, f"{s}Hand") for s in ("Left", "Right")])
    speed = np.linalg.norm(np.gradient(hands, axis=1), axis=-1).mean(axis=0)
    speed = np.convolve(speed, np.ones(7) / 7.0, mode="same")
    matched = np.corrcoef(speed, loud)[0, 1]
    shifted = [np.corrcoef(speed, np.roll(loud, k))[0, 1] for k in range(45, FRAMES - 45, 15)]
    assert matched > 0.45
    assert matched > np.max(shifted)


def test_hands_rest_without_speech_and_louder_speech_gives_larger_strokes():
    none = np.zeros(0)
    silent = gestures.perform(prosody.Prosody(10.0, none, none, np.zeros((0, 2))), factors("happy"), 256)
    hand = np.asarray(features.world_positions(silent))[:, body.rest_skeleton().index("RightHand")]
    assert np.ptp(hand[:, 1]) < 2.0
    heard = speech()[0]
    travel = []
    for scale in (0.5, 1.0):
        moves = strokes.schedule(heard._replace(strength=scale * np.ones_like(heard.time)), factors("happy"))
        path = strokes.follow(moves, strokes.stance(factors("happy")), np.arange(FRAMES) / 30.0)
        travel.append(np.abs(np.diff(path[:, 1, :3], axis=0)).sum())
    assert travel[1] > 1.4 * travel[0]


def test_factors_show_in_the_motion():
    assert hand_height("oration").min() > 0.0  # oration: hands above the shoulders
    order = ["sad", "relaxed", "neutral", "happy", "oration"]
    heights = [hand_height(name).mean() for name in order]
    assert heights == sorted(heights)
    lean = {n: (joint(n, "Spine3") - joint(n, "Hips"))[:, 2].mean() for n in ("relaxed", "neutral", "old")}
    assert lean["relaxed"] < lean["neutral"] < lean["old"]
    assert joint("sneaky", "Hips")[:, 1].mean() < joint("neutral", "Hips")[:, 1].mean() - 4.0
    speed = {n: np.abs(np.diff(joint(n, "RightHand"), axis=0)).mean() for n in ("still", "sad", "neutral", "angry")}
    assert list(speed.values()) == sorted(speed.values())
    nod = {n: np.ptp(joint(n, "HeadEnd")[:, 1] - joint(n, "Neck")[:, 1]) for n in ("neutral", "agreement")}
    assert nod["agreement"] > 3.0 * nod["neutral"]
    old = [np.abs(np.diff(joint("old", f"{s}Hand"), axis=0)).sum() for s in ("Right", "Left")]
    assert old[0] > 1.5 * old[1]


def test_example_clips_come_by_name_or_factors():
    example = corpus.style_clip("happy", seconds=3.0)
    assert example.euler.shape == (90, 75, 3)
    same = corpus.style_clip(factors("happy"), seconds=3.0)
    np.testing.assert_array_equal(example.euler, same.euler)


def test_impossible_performances_are_refused():
    with pytest.raises(ValueError, match="0 frames"):
        gestures.perform(speech()[0], factors("happy"), 0)
    other = clip("neutral")._replace(skeleton=clip("neutral").skeleton.__class__(("Hips",), (-1,), np.zeros((1, 3))))
    with pytest.raises(ValueError, match="Spine"):
        ranges.share_outside_range(other)
