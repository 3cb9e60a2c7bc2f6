"""Gestures that mean something: on time, smooth, human, told apart, over every style; legs of another style."""

from functools import cache

import numpy as np
import pytest

from zeggs_jax.motion import features
from zeggs_jax.synthetic import body, corpus, gestures, lexicon, meanings, prosody, ranges, styles

FRAMES, WHEN = 128, 1.9
TIMES = np.arange(0.5, 4.0, 0.35)
HEARD = prosody.Prosody(4.3, TIMES, np.where(np.arange(len(TIMES)) % 2, 0.9, 0.7), np.array([[0.3, 4.1]]))
EXTREME = ("still", "angry", "old", "oration")
EVERY = [(style, name) for style in EXTREME for name in meanings.SIGNS]


def meant(name: str, time: float = WHEN) -> lexicon.Meant:
    return lexicon.Meant(name, name, time, time + 0.2, False)


@cache
def clip(style: str, name: str):
    said = [meant(name)] if name else []
    return gestures.perform(HEARD, styles.find(style), FRAMES, 30, 0, None, said)


@cache
def world(style: str, name: str) -> np.ndarray:
    return np.asarray(features.world_positions(clip(style, name)))


def hands(style: str, name: str) -> np.ndarray:
    skeleton, place = body.rest_skeleton(), world(style, name)
    return np.stack([place[:, skeleton.index(f"{s}Hand")] - place[:, skeleton.index(f"{s}Arm")] for s in
                     ("Left", "Right")], axis=1)  # fmt: skip


def test_without_meanings_the_performance_is_as_it_always_was():
    example = corpus.style_clip("happy", 4.0, 30, 2)
    spread = [[0.00807, 0.00589, 0.00438], [0.06674, 0.09376, 0.08167], [0.0, 0.0, 0.03377]]
    joints = [example.skeleton.index(name) for name in ("Spine", "RightArm", "LeftLeg")]
    np.testing.assert_allclose(example.euler[:, joints].astype(np.float64).std(axis=0), spread, atol=2e-5)
    np.testing.assert_allclose(
        example.positions[:, 0].astype(np.float64).mean(axis=0), [2.6789, 92.7883, 0.3117], atol=1e-4
    )


def test_every_meaning_has_a_sign():
    assert set(meanings.SIGNS) == set(lexicon.MEANINGS)
    with pytest.raises(ValueError, match="'jolly'"):
        meanings.overlay([meant("jolly")], styles.find("happy"), np.arange(10) / 30.0)


@pytest.mark.parametrize(("style", "name"), EVERY)
def test_signs_are_human_and_go_round_the_body(style, name):
    assert ranges.joints_outside_range(clip(style, name)) == {}
    skeleton, place = body.rest_skeleton(), world(style, name)
    for side in ("Left", "Right"):
        for part in ("Hand", "HandMiddle1", "HandMiddle3", "ForeArm"):
            joint = place[:, skeleton.index(side + part)]
            for bone in ("Spine1", "Spine2", "Spine3"):
                way = joint - place[:, skeleton.index(bone)]
                inside = (way[:, 0] / 14.0) ** 2 + ((way[:, 2] - 1.0) / 10.0) ** 2 < 1.0
                assert not np.any(inside & (np.abs(way[:, 1]) < 6.0))


@pytest.mark.parametrize(("style", "name"), EVERY)
def test_signs_are_prepared_in_time_made_at_the_word_and_let_go(style, name):
    with_sign, without = hands(style, name), hands(style, "")
    moved = np.linalg.norm(with_sign - without, axis=-1).max(axis=1)
    time = np.arange(FRAMES) / 30.0
    assert moved[time < WHEN - 1.1].max() < 1e-6
    assert moved[(time > WHEN - 0.4) & (time < WHEN - 0.2)].max() > 3.0  # on the way before the word
    assert moved[(time > WHEN + 0.05) & (time < WHEN + 0.5)].max() > 8.0
    assert moved[time > WHEN + 2.2].max() < 1e-6


@pytest.mark.parametrize(("style", "name"), EVERY)
def test_signs_are_smooth(style, name):
    for side in range(2):
        path = hands(style, name)[:, side]
        speed = np.linalg.norm(np.diff(path, axis=0), axis=1) * 30.0
        bound = max(500.0, 1.2 * np.linalg.norm(np.diff(hands(style, "")[:, side], axis=0), axis=1).max() * 30.0)
        assert speed.max() < bound
        assert np.abs(np.diff(speed)).max() * 30.0 < 9000.0


def test_right_hands_differ_more_between_signs_than_between_styles():
    window = slice(round((WHEN - 0.1) * 30), round((WHEN + 0.8) * 30))
    shapes = {(style, name): hands(style, name)[window, 1] for style, name in EVERY}
    for style, name in EVERY:
        ways = {
            other: np.mean([np.abs(shapes[style, name] - shapes[s, other]).mean() for s in EXTREME if s != style])
            for other in meanings.SIGNS
        }
        assert min(ways, key=lambda other: ways[other]) == name


def test_what_the_hands_say():
    at = round((WHEN + 0.3) * 30)
    place = {name: hands("neutral", name)[at] for name in meanings.SIGNS}
    apart = {name: place[name][0, 0] - place[name][1, 0] for name in ("big", "small")}
    assert apart["big"] > apart["small"] + 50.0
    assert place["up"][1, 1] > 30.0 > place["down"][1, 1] + 60.0
    assert place["you"][1, 2] > 45.0
    assert place["me"][1, 2] < 20.0
    assert -place["far"][1, 0] > 30.0


def test_heads_nod_and_shake():
    skeleton = body.rest_skeleton()
    turned = {name: clip("still", name).euler[:, skeleton.index("Head")] for name in ("", "yes", "no")}
    assert np.ptp(turned["yes"][:, 2]) > 0.15 + np.ptp(turned[""][:, 2])
    assert np.ptp(turned["no"][:, 1]) > 0.15 + np.ptp(turned[""][:, 1])


def test_signs_in_quick_succession_are_both_made_smoothly():
    style = styles.find("neutral")
    both = gestures.perform(HEARD, style, FRAMES, 30, 0, None, [meant("up", 1.2), meant("big", 2.3)])
    place = np.asarray(features.world_positions(both))
    hand = place[:, body.rest_skeleton().index("RightHand")]
    assert hand[round(1.4 * 30), 1] > 170.0
    assert hand[round(2.6 * 30), 0] < -45.0
    assert np.linalg.norm(np.diff(hand, axis=0), axis=1).max() * 30.0 < 500.0


def test_lower_halves_are_of_their_own_style():
    sneaky, happy = styles.find("sneaky"), styles.find("happy")
    same = gestures.perform(HEARD, happy, FRAMES, lower=happy)
    np.testing.assert_allclose(same.euler, clip("happy", "").euler, atol=2e-4)
    mixed = gestures.perform(HEARD, happy, FRAMES, lower=sneaky)
    skeleton = body.rest_skeleton()
    legs = [j for j, name in enumerate(skeleton.names) if "Leg" in name or "Foot" in name]
    below = gestures.perform(HEARD, sneaky, FRAMES)
    np.testing.assert_allclose(mixed.positions[:, 0], below.positions[:, 0], atol=1e-3)
    np.testing.assert_allclose(mixed.euler[:, legs], below.euler[:, legs], atol=1e-3)
    chest = skeleton.index("Spine2")
    np.testing.assert_allclose(mixed.euler[:, chest, 0], clip("happy", "").euler[:, chest, 0], atol=0.05)
    wrists = np.asarray(features.world_positions(mixed))[:, [skeleton.index("RightHand"), skeleton.index("RightArm")]]
    np.testing.assert_allclose(wrists[:, 0] - wrists[:, 1], hands("happy", "")[:, 1], atol=2.5)
    assert ranges.joints_outside_range(mixed) == {}
