"""Beats: known times, what the scores see and what they do not, chance beside them; stops on stressed words."""

import numpy as np
import pytest

from zeggs_jax.metrics import beats, movement
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.synthetic import corpus, recording

RATE = 30.0


def strokes(times, rate_hz=RATE, seconds=12.0):
    """A path that stops fully at each of `times` and moves between them."""
    frames = np.arange(round(seconds * rate_hz)) / rate_hz
    edges = np.concatenate([[0.0], times, [seconds]])
    at = np.clip(np.searchsorted(edges, frames, "right") - 1, 0, len(edges) - 2)
    share = (frames - edges[at]) / (edges[at + 1] - edges[at])
    smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    height = np.where(at % 2 == 0, 20.0 * smooth, 20.0 * (1.0 - smooth))
    return np.stack([np.zeros_like(height), height, np.zeros_like(height)], axis=-1)


def with_hands(motion, path):
    positions = np.repeat(motion.positions[:1], len(path), axis=0)
    for hand in ("left_hand", "right_hand"):
        positions[:, motion.skeleton.role(hand)] += path
    return Movement(positions, motion.rate_hz, motion.skeleton)


TIMES = np.array([0.9, 1.7, 2.9, 3.5, 4.4, 5.8, 6.5, 7.6, 8.2, 9.5, 10.3, 11.1])


def test_beats_of_a_slowing_circle_are_where_it_is_slowest():
    time = np.arange(300) / RATE
    angle = 6.0 * time + np.sin(2.0 * np.pi * time) * 0.6  # slowest at 0.5, 1.5, ... s
    path = 10.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * time], axis=-1)
    np.testing.assert_allclose(beats.motion_beats(path, RATE), np.arange(0.5, 10.0), atol=1.0 / RATE)


def test_strokes_are_fastest_halfway_between_stops():
    halfway = 0.5 * (np.append(0.0, TIMES) + np.append(TIMES, 12.0))
    np.testing.assert_allclose(beats.strokes(strokes(TIMES), RATE), halfway, atol=1.5 / RATE)


@pytest.mark.parametrize("rate_hz", [30.0, 60.0, 120.0])
def test_stops_are_found_at_any_rate(rate_hz):
    np.testing.assert_allclose(beats.stops(strokes(TIMES, rate_hz), rate_hz), TIMES, atol=1.5 / RATE)


def test_full_stops_are_no_beats_of_the_published_kind_unless_asked_for():
    path = strokes(TIMES)
    assert len(beats.motion_beats(path, RATE)) < 0.5 * len(TIMES)
    assert len(beats.motion_beats(path, RATE, moving=-1.0)) >= len(TIMES)


def test_units_do_not_matter_and_a_usual_speed_decides_what_rests():
    path = strokes(TIMES) + 0.3 * np.sin(np.arange(360) * 0.9)[:, None]
    np.testing.assert_array_equal(beats.motion_beats(10.0 * path, RATE), beats.motion_beats(path, RATE))
    np.testing.assert_array_equal(beats.stops(10.0 * path, RATE), beats.stops(path, RATE))
    assert not len(beats.motion_beats(path, RATE, mean_speed=1e6))


def test_a_held_pose_has_no_beats():
    held = np.ones((90, 3))
    assert not len(beats.motion_beats(held, RATE))
    assert not len(beats.stops(held, RATE))
    assert not len(beats.strokes(held, RATE))


def test_closeness_is_the_formula():
    found = beats.closeness(np.array([1.0, 2.0]), np.array([1.3, 5.0]), sigma=0.3)
    assert found == pytest.approx((np.exp(-0.5) + np.exp(-0.5 * (0.7 / 0.3) ** 2)) / 2.0)
    assert beats.closeness(TIMES, TIMES) == 1.0
    assert beats.closeness(TIMES, np.zeros(0)) == 0.0 == beats.closeness(np.zeros(0), TIMES)


def test_consistency_asks_the_sounds_and_alignment_the_beats():
    half = TIMES[::2]
    assert beats.alignment([half], TIMES) == 1.0 > beats.consistency([half], TIMES)
    assert beats.consistency([TIMES], half) == 1.0 > beats.alignment([TIMES], half)
    assert beats.consistency([TIMES, np.zeros(0)], TIMES) == 0.5
    assert beats.consistency([], TIMES) == 0.0


def test_more_beats_win_consistency_but_not_alignment():
    """The trap: beating all the time is as good as beating in time."""
    always = np.arange(0.0, 12.0, 0.1)
    assert beats.consistency([always], TIMES) > 0.95
    assert beats.alignment([always], TIMES, sigma=0.1) < 0.6


def test_twice_the_frames_taken_for_the_same_rate_are_seen():
    """The trap of mixing 31.25 Hz audio frames with 30 Hz motion frames: times drift apart over a minute."""
    times = np.arange(1.0, 60.0)
    drifted = beats.closeness(times * 31.25 / 30.0, times, sigma=0.1)
    assert drifted < 0.4 < beats.closeness(times, times, sigma=0.1)


def test_a_shift_in_time_lowers_the_scores_to_chance(gesture):
    stopping = with_hands(gesture(seconds=1.0), strokes(TIMES))
    found = [beats.with_stresses(stopping, beats.moved(TIMES, shift, 12.0), "stops") for shift in (0.0, 0.05, 0.1, 0.2)]
    scores = [f.agreement.matched for f in found]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] > 0.95 > 0.5 > found[0].agreement.shifted
    assert found[0].agreement.share_below == 1.0
    assert found[0].lag == pytest.approx(0.0, abs=1.0 / RATE)
    assert found[2].lag == pytest.approx(-0.1, abs=1.0 / RATE)
    far = beats.with_stresses(stopping, beats.moved(TIMES, 5.3, 12.0), "stops").agreement
    assert far.matched < 0.7


def test_frozen_and_mean_poses_go_with_no_speech(gesture, damage):
    for name in ("frozen", "mean_pose"):
        held = damage[name](gesture())
        consistent, aligned = beats.with_speech(held, TIMES[:8])
        assert consistent.matched == aligned.matched == consistent.shifted == 0.0
        stressed = beats.with_stresses(held, TIMES[:8])
        assert stressed.agreement.matched == 0.0
        assert np.isnan(stressed.lag)


def test_gestures_that_do_not_know_the_speech_score_like_chance(gesture):
    draw = np.random.default_rng(0)
    found = [beats.with_speech(gesture(k, seconds=10.0), np.sort(draw.uniform(0.0, 10.0, 15)))[1] for k in range(8)]
    assert abs(np.mean([f.matched - f.shifted for f in found])) < 0.1
    assert 0.2 < np.mean([f.share_below for f in found]) < 0.8


def test_the_synthetic_body_is_fastest_on_its_stressed_words():
    take = corpus.Take("x", "happy", corpus.styles.find("happy"), "train", 12.0, 3)
    _, heard, clip = corpus.perform(take, recording.speak(12.0, 3))
    motion, inside = movement.of(clip), heard.time[heard.time < 12.0]
    found = beats.with_stresses(motion, inside)
    assert found.agreement.matched > found.agreement.shifted + 0.2
    assert found.agreement.share_below == 1.0
    assert -0.1 < found.lag < 0.05
    assert beats.with_stresses(motion, inside, "stops").agreement.matched < found.agreement.matched


def test_what_has_no_beats_to_find_is_refused(gesture):
    with pytest.raises(ValueError, match="2 frames is too short"):
        beats.stops(np.zeros((2, 3)), RATE)
    with pytest.raises(ValueError, match="NaN"):
        beats.motion_beats(np.full((30, 3), np.nan), RATE)
    with pytest.raises(ValueError, match=r"2\.0 s are too short"):
        beats.with_stresses(gesture(seconds=2.0), TIMES[:2])
    with pytest.raises(ValueError, match=r"not all within the 8\.00 s"):
        beats.with_speech(gesture(), TIMES)
    with pytest.raises(ValueError, match="resample"):
        beats.onsets(np.zeros(100, np.float32), 22050)


@pytest.mark.slow
def test_onsets_of_clicks_are_where_they_sound():
    wave = np.zeros(16000 * 3, np.float32)
    for when in (0.5, 1.2, 2.1):
        wave[round(16000 * when) :][:200] = np.random.default_rng(0).normal(size=200) * np.hanning(200)
    np.testing.assert_allclose(beats.onsets(wave), (0.5, 1.2, 2.1), atol=512 / 16000 * 1.5)
