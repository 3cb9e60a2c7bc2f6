"""Laws of timelines: shares sum to 1, no jump but where one is asked for, editing undoes itself, bad cues are named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.speech.transcript import Sentence, Word
from zeggs_jax.zeroeggs import timeline as tl
from zeggs_jax.zeroeggs.timeline import Cue, Timeline

RATE = 30.0
POINTS = {"old": np.array([1.0, 0.0, 2.0]), "happy": np.array([0.0, 3.0, -1.0]), "sad": np.array([-2.0, 1.0, 0.0])}
CENTRE = np.array([0.5, 0.5, 0.5])


def cue(time: float, style: str = "old", transition: float = 1.0, curve: str = "smooth", intensity: float = 1.0) -> Cue:
    return Cue(time, ((style, 1.0),), transition, curve, intensity)  # pyright: ignore


@st.composite
def timelines(draw) -> Timeline:
    """One to five cues whose transitions fill up to the whole time between them."""
    count = draw(st.integers(1, 5))
    gaps = [draw(st.floats(0.1, 3.0)) for _ in range(count)]
    times = np.cumsum([0.0, *gaps[:-1]]).tolist()
    kinds = [draw(st.sampled_from(["smooth", "linear", "hard"])) for _ in range(count)]
    parts = st.just(0.0) | st.floats(1e-9, 1.0)  # shorter is no time: halved, the smallest number is 0
    lengths = [gap * draw(parts) for gap in gaps]
    styles = [draw(st.sampled_from(sorted(POINTS))) for _ in range(count)]
    amounts = [draw(st.floats(0.0, 2.0)) for _ in range(count)]
    return Timeline(tuple(map(cue, times, styles, lengths, kinds, amounts)))


@settings(max_examples=60, deadline=None)
@given(timelines())
def test_every_frame_is_a_weighted_mean_of_cues(timeline):
    shares = tl.shares(timeline, 500, RATE)
    assert shares.shape == (500, len(timeline.cues))
    assert shares.min() >= -1e-9
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(timelines())
def test_a_cue_is_there_when_its_transition_is_over_until_the_next_begins(timeline):
    shares, time = tl.shares(timeline, 500, RATE), np.arange(500) / RATE
    for k, one in enumerate(timeline.cues):
        begin = one.time + (one.transition if k and one.curve != "hard" else 0.0)
        end = timeline.cues[k + 1].time if k + 1 < len(timeline.cues) else np.inf
        held = shares[(time >= begin + 1e-6) & (time < end - 1e-6), k]
        np.testing.assert_allclose(held, 1.0, atol=1e-12)


def test_smooth_has_no_jump_in_speed_or_acceleration():
    """At 1 kHz: the largest second difference of minimum jerk is 5.77 / T^2, of its third 60 / T^3."""
    share = tl.shares(Timeline((cue(0.0), cue(1.0, "sad", 2.0))), 4000, 1000.0)[:, 1]
    assert np.abs(np.diff(share, 2)).max() * 1e6 == pytest.approx(10.0 / np.sqrt(3.0) / 4.0, rel=0.01)
    assert np.abs(np.diff(share, 3)).max() * 1e9 <= 60.0 / 8.0 + 1e-3


def test_linear_has_one_speed_and_hard_switches_in_one_frame():
    linear = tl.shares(Timeline((cue(0.0), cue(1.0, "sad", 2.0, "linear"))), 120, RATE)[:, 1]
    np.testing.assert_allclose(np.diff(linear)[31:89], 1.0 / 60.0)
    hard = tl.shares(Timeline((cue(0.0), cue(1.0, "sad", 2.0, "hard"))), 120, RATE)[:, 1]
    np.testing.assert_array_equal(hard, np.arange(120) >= 30)


def test_the_middle_of_a_transition_is_half_of_both():
    made = tl.sequence(Timeline((cue(0.0), cue(1.0, "sad", 2.0))), POINTS, None, 120, RATE)
    np.testing.assert_allclose(made[60], 0.5 * (POINTS["old"] + POINTS["sad"]), atol=1e-6)


def test_mix_and_intensity_are_measured_from_the_centre():
    mix = Cue(0.0, (("old", 0.3), ("happy", 0.7)), intensity=1.5)
    blended = 0.3 * POINTS["old"] + 0.7 * POINTS["happy"]
    made = tl.sequence(Timeline((mix,)), POINTS, CENTRE, 3, RATE)
    np.testing.assert_allclose(made, np.tile(CENTRE + 1.5 * (blended - CENTRE), (3, 1)), atol=1e-6)
    none = tl.sequence(Timeline((mix._replace(intensity=0.0),)), POINTS, CENTRE, 3, RATE)
    np.testing.assert_allclose(none[0], CENTRE, atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(timelines(), st.floats(0.1, 9.0))
def test_shifting_there_and_back_and_stretching_there_and_back(timeline, by):
    back = tl.shift(tl.shift(timeline, by), -by)
    assert [one._replace(time=0.0) for one in back.cues] == [one._replace(time=0.0) for one in timeline.cues]
    np.testing.assert_allclose([one.time for one in back.cues], [one.time for one in timeline.cues], atol=1e-9)
    again = tl.stretch(tl.stretch(timeline, by), 1.0 / by)
    for a, b in zip(again.cues, timeline.cues, strict=True):
        np.testing.assert_allclose([a.time, a.transition], [b.time, b.transition], rtol=1e-9)


def test_shifting_earlier_keeps_the_style_of_that_time():
    timeline = Timeline((cue(0.0), cue(2.0, "sad"), cue(5.0, "happy")))
    assert tl.shift(timeline, -3.0) == Timeline((cue(0.0, "sad"), cue(2.0, "happy")))


def test_putting_and_removing_undo_each_other_and_the_original_stays():
    timeline = Timeline((cue(0.0), cue(4.0, "sad")))
    more = tl.put(timeline, cue(2.0, "happy"))
    assert [one.mix[0][0] for one in more.cues] == ["old", "happy", "sad"]
    assert tl.remove(more, 2.0) == timeline
    assert tl.put(more, cue(2.0, "old")).cues[1] == cue(2.0, "old")
    assert tl.names(more) == ("old", "happy", "sad")


@pytest.mark.parametrize(
    ("cues", "told"),
    [
        ([], "has no cues"),
        ([cue(1.0)], "cue 1 of the timeline is at 1 s; the first one must be at 0 s"),
        ([cue(0.0), cue(2.0), cue(2.0)], "cue 3 of the timeline is at 2 s, after one at 2 s"),
        ([cue(0.0), cue(3.0), cue(2.0)], "cue 3 of the timeline is at 2 s, after one at 3 s"),
        ([cue(0.0), cue(2.0, transition=3.0), cue(4.0)], "within the transition before it, which ends at 5 s"),
        ([cue(0.0), cue(-2.0)], "has the time -2"),
        ([cue(0.0), cue(float("nan"))], "has the time nan"),
        ([cue(0.0), cue(2.0, transition=-1.0)], "has the transition -1"),
        ([cue(0.0, intensity=float("inf"))], "has the intensity inf"),
        ([cue(0.0, curve="bouncy")], "has the curve 'bouncy'; give one of smooth, linear, hard"),
        ([Cue(0.0, (("old", 0.3), ("sad", 0.3)))], "sum to 0.6"),
        ([Cue(0.0, (("old", float("nan")),))], "sum to nan"),
        ([Cue(0.0, (("old", 0.5), ("old", 0.5)))], "each once"),
        ([Cue(0.0, ())], "one style or more"),
        ([cue(0.0), cue(5.0)], "is at 5 s, but the speech ends at 5 s"),
        ([cue(0.0, "olde")], "cue 1 has the unknown style 'olde'; nearest: old"),
        ([cue(0.0), cue(1.0, intensity=2.0)], "cue 2 has the intensity 2, which needs the centre"),
    ],
)
def test_a_timeline_that_cannot_be_played_is_one_sentence(cues, told):
    with pytest.raises(ValueError, match=told) as caught:
        tl.sequence(Timeline(tuple(cues)), POINTS, None, 150, RATE)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_transitions_may_touch_and_the_first_has_none():
    tl.check(Timeline((cue(0.0, transition=9.0), cue(1.0, transition=1.0), cue(2.0, transition=1.0))))


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (lambda t: tl.remove(t, 3.0), "no cue at 3 s; the cues are at 0, 2 s"),
        (lambda t: tl.remove(t, 0.0), "begins with"),
        (lambda t: tl.put(t, cue(1.5, "sad")), "within the transition before it"),
        (lambda t: tl.stretch(t, 0.0), "cannot be stretched by 0"),
    ],
)
def test_an_edit_that_cannot_be_is_one_sentence(edit, told):
    with pytest.raises(ValueError, match=told):
        edit(Timeline((cue(0.0), cue(2.0, "happy"))))


def said(*spans: tuple[float, float]) -> list[Sentence]:
    return [Sentence((Word("so", start, start), Word("it goes.", start, end))) for start, end in spans]


def test_sentences_take_styles_in_turn_with_transitions_in_their_pauses():
    timeline = tl.by_sentence(said((0.2, 3.0), (4.0, 8.0), (8.2, 12.0)), ["old", "0.5 old + 0.5 sad"], 0.8)
    assert [one.mix for one in timeline.cues] == [(("old", 1.0),), (("old", 0.5), ("sad", 0.5)), (("old", 1.0),)]
    np.testing.assert_allclose([one.time for one in timeline.cues], [0.0, 3.1, 7.7])
    assert [one.transition for one in timeline.cues] == [0.8, 0.8, 0.8]


def test_sentences_that_no_style_is_given_for_keep_the_one_before():
    timeline = tl.by_sentence(said((0.0, 1.0), (2.0, 3.0), (4.0, 5.0), (6.0, 7.0)), {0: "old", 2: "sad", 3: "sad"})
    assert [(one.time, one.mix[0][0]) for one in timeline.cues] == [(0.0, "old"), (3.0, "sad")]


def test_a_hard_switch_is_in_the_middle_of_the_pause():
    timeline = tl.by_sentence(said((0.0, 2.0), (3.0, 5.0)), ["old", "sad"], curve="hard")
    share = tl.shares(timeline, 150, 30.0)
    np.testing.assert_array_equal(share.argmax(1), np.repeat([0, 1], 75))
    assert set(share.ravel()) == {0.0, 1.0}


def test_short_sentences_shorten_their_transitions():
    timeline = tl.by_sentence(said((0.0, 0.4), (0.4, 0.8), (0.8, 1.0), (1.0, 9.0)), ["old", "sad"], 2.0)
    assert len(timeline.cues) == 4  # and `check` found no overlap


@pytest.mark.parametrize(
    ("count", "styles", "told"),
    [
        (0, ["old"], "got 0 sentences and 1 styles"),
        (2, [], "got 2 sentences and 0 styles"),
        (2, {0: "old", 2: "sad"}, "for sentence 2, but sentences go from 0 to 1"),
        (2, {1: "old"}, "no style for sentence 0"),
        (1, ["0.3 old + sad"], "is no mix of styles"),
    ],
)
def test_styles_that_do_not_fit_the_sentences_are_one_sentence(count, styles, told):
    with pytest.raises(ValueError, match=told):
        tl.by_sentence(said((0.0, 1.0), (2.0, 3.0))[:count], styles)
