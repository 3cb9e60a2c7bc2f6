"""Laws of streaming: it makes what `generate` makes, however the speech is pushed; bad input changes nothing."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import soxr
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.motion import bvh
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import wav
from zeggs_jax.zeroeggs import checkpoints, library, synthesis, timeline
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs.cue import Cue, Timeline
from zeggs_jax.zeroeggs.steering import Request
from zeggs_jax.zeroeggs.stream import StreamSession


@pytest.fixture(scope="module")
def wave(clips):
    return wav.read(clips / "speech.wav")


@pytest.fixture(scope="module")
def loudness(wave):
    return wav.loudness(wave)


@pytest.fixture(scope="module")
def points(gesturer):
    """Two places in the style space."""
    return np.random.default_rng(5).normal(size=(2, gesturer.config.style_size)).astype(np.float32)


@pytest.fixture(scope="module")
def begin(gesturer, clips, points):
    """Begins a session, with some of it changed."""

    def make(**changed):
        asked = {"style": points[0], "first_pose": str(clips / "old.bvh"), "loudness": -20.0} | changed
        return StreamSession(gesturer, **asked)

    return make


@pytest.fixture
def session(begin):
    return begin()


def offline(model, wave, style, clips, rows=None):
    """The poses of `generate`, before they are a clip; `style` is one point or one for each frame."""
    spectrum = g.read_speech(wave, model) if rows is None else rows
    start = g.starting_pose(Request(first_pose=str(clips / "old.bvh")), [], model)
    sequence = jnp.broadcast_to(jnp.asarray(style), (len(spectrum), model.config.style_size))
    return synthesis.synthesize(model, spectrum, sequence, start)


def streamed(session, wave, sizes):
    """All poses of a recording that is pushed in pieces of these sizes, over and over."""
    made, start = [], 0
    while start < len(wave):
        for size in sizes:
            made.append(session.push(wave[start : start + size]))
            start += size
    made.append(session.flush())
    return jax.tree.map(lambda *parts: np.concatenate(parts), *made)


def assert_same(one, other, atol=1e-5):
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, atol=atol, rtol=1e-5)


@settings(max_examples=8, deadline=None)
@given(st.integers(1, 16_000), st.lists(st.integers(1, 6000), min_size=1, max_size=4))
def test_streamed_is_offline_whatever_the_pushes(begin, gesturer, clips, points, wave, samples, sizes):
    samples = min(samples, 100 * sum(sizes))
    wave = wave[-samples:]
    if speech_features.frame_count(samples, 30.0) == 0:
        return
    session = begin(loudness=max(wav.loudness(wave), -70.0))
    assert_same(streamed(session, wave, sizes), offline(gesturer, wave, points[0], clips))


@pytest.fixture(scope="module", params=[4, 30])
def early(request, gesturer):
    """The same weights, told that they see so many frames ahead."""
    speech = replace(gesturer.config.speech, lookahead=request.param)
    return gesturer._replace(config=replace(gesturer.config, speech=speech))


def test_a_model_that_sees_less_far_ahead_streams_as_offline_and_answers_as_much_sooner(early, clips, points, wave):
    long, ahead = np.tile(wave, 4), early.config.speech.lookahead
    asked = {"style": points[0], "first_pose": str(clips / "old.bvh"), "loudness": wav.loudness(long)}
    expected = offline(early, long, points[0], clips)
    session = StreamSession(early, **asked)
    assert session.latency.least == pytest.approx(ahead / 30 + 0.025)
    assert_same(streamed(session, long, [641, 50_000]), expected)
    assert_same(streamed(StreamSession(early, **asked), long, [len(long)]), expected)
    with pytest.raises(ValueError, match=f"sees 0 to {ahead} frames ahead"):
        StreamSession(early, **asked, lookahead=ahead + 1)


def test_a_long_push_runs_in_whole_chunks(begin, gesturer, clips, points, wave):
    long = np.tile(wave, 5)
    session = begin(loudness=wav.loudness(long))
    assert_same(streamed(session, long, [len(long)]), offline(gesturer, long, points[0], clips))


def test_a_named_style_starts_and_moves_as_in_generate(gesturer, clips, wave, loudness):
    request = Request(styles=(str(clips / "old.bvh"), str(clips / "happy.bvh")), weights=(0.3, 0.7), seed=7)
    asked = g.prepare(wave, request, gesturer)
    made = streamed(StreamSession(gesturer, request, loudness=loudness), wave, [800])
    assert_same(made, synthesis.synthesize(gesturer, *asked.told))


@pytest.mark.parametrize("curve", ["smooth", "linear", "hard"])
def test_a_style_that_is_set_turns_as_a_cue_does(begin, gesturer, clips, points, wave, loudness, curve):
    session = begin(loudness=loudness)
    made = [session.push(wave[:12_000])]
    at = session.frame
    session.set_style(points[1], transition_s=0.4, curve=curve)
    made += [session.push(wave[12_000:]), session.flush()]
    cues = Timeline((Cue(0.0, (("a", 1.0),)), Cue(at / session.rate, (("b", 1.0),), 0.4, curve)))
    frames = sum(len(part.root.pos) for part in made)
    style = timeline.sequence(cues, {"a": points[0], "b": points[1]}, None, frames, session.rate)
    made = jax.tree.map(lambda *parts: np.concatenate(parts), *made)
    assert 0 < at < frames - 20
    assert_same(made, offline(gesturer, wave, style, clips))


def test_a_style_set_within_a_transition_goes_on_from_there(begin, points):
    session = begin()
    session.set_style(points[1], transition_s=10.0)
    session.push(np.zeros(80_000, np.float32))
    before = session._styles(np.array([session.frame]))[0]
    session.set_style(points[0], transition_s=10.0)
    np.testing.assert_array_equal(session._styles(np.array([session.frame]))[0], before)
    assert np.abs(before - points[0]).max() > 1e-2


@pytest.mark.parametrize("rate_hz", [44_100, 8_000])
def test_another_rate_is_resampled_as_a_file_is(begin, gesturer, clips, points, rate_hz):
    wave = np.random.default_rng(1).normal(size=rate_hz).astype(np.float32) * 0.1
    whole = soxr.resample(wave, rate_hz, 16_000, quality="HQ")
    session = begin(loudness=wav.loudness(whole), rate_hz=rate_hz)
    assert_same(streamed(session, wave, [701, 5000]), offline(gesturer, whole, points[0], clips))


def test_the_rate_can_change_while_it_runs(session, wave):
    made = [session.push(wave[:8000]), session.push(np.repeat(wave[8000:16_000], 3), rate_hz=48_000)]
    made += [session.push(wave[:8000], rate_hz=16_000), session.flush()]
    assert sum(len(part.root.pos) for part in made) == 45  # a second and a half, and the same time as without


@pytest.mark.parametrize("lookahead", [15, 6, 0])
def test_a_frame_comes_out_within_the_latency_told(begin, lookahead):
    session = begin(lookahead=lookahead)
    late = []
    for n in range(0, 24_000, 40):
        for k in range(len(session.push(np.zeros(40, np.float32)).root.pos)):
            late.append((n + 40) / 16_000 - (session.frame - 1 - k) / session.rate)
    least, most = session.latency
    assert least - 1e-6 <= min(late[1:]) < least + 80 / 16_000
    assert most - 80 / 16_000 < max(late[1:]) <= most + 41 / 16_000
    assert least == pytest.approx(lookahead / 30 + 0.025)


def test_the_paper_waits_275_to_288_ms(gesturer):
    assert gesturer.config.speech.kernel == 31
    paper = StreamSession.__new__(StreamSession)  # no weights are needed to know it
    paper.model, paper.rate, paper.lookahead = gesturer, bvh.rate_hz(0.016667), 15
    assert paper.latency == pytest.approx((0.275, 0.28333), abs=1e-4)


def test_a_look_ahead_cut_short_repeats_the_last_row_known(begin, gesturer, clips, points, wave, loudness):
    """Frame t of the stream is frame t of speech whose row t + L is held from there on."""
    session = begin(loudness=loudness, lookahead=2)
    made = streamed(session, wave, [6000])  # more at once than a frame waits for
    rows = np.asarray(g.read_speech(wave, gesturer))
    start = g.starting_pose(Request(first_pose=str(clips / "old.bvh")), [], gesturer)
    run, first = synthesis.ready(gesturer), jax.tree.map(lambda a: a[0], start.pose)
    given = synthesis.Frame(np.zeros(8, np.float32), points[0], start.gaze)
    state = synthesis.begin(run, gesturer.config, first, given)
    for t in range(1, len(rows)):
        seen = rows[np.arange(t - 15, t + 16).clip(0, min(t + 2, len(rows) - 1))]
        state, expected = synthesis.advance(run, gesturer.config, state, seen, points[:1], np.asarray(start.gaze)[None])
        np.testing.assert_allclose(made.joint_pos[t], expected.joint_pos[0], atol=1e-5)


def test_late_frames_are_dropped_whole_and_the_rest_keeps_its_time(session, wave):
    made = session.push(wave[:16_000], most=4)
    assert len(made.root.pos) == 4
    assert session.dropped == session.frame - 4 > 5
    rest = [session.push(wave[16_000:]), session.flush()]
    assert session.frame == round(30 * len(wave) / 16_000)
    assert sum(len(part.root.pos) for part in rest) + 4 + session.dropped == session.frame
    steps = np.linalg.norm(np.diff(np.concatenate([made.root.pos, rest[0].root.pos]), axis=0), axis=1)
    assert steps.max() < 5.0  # cm: the body goes on from where it was


def test_a_gap_is_silence_of_its_length(begin, wave):
    one, other = begin(), begin()
    for part in (lambda s: s.push(wave[:8000]), lambda s: s.gap(0.5) if s is one else s.push(np.zeros(8000))):
        assert_same(part(one), part(other), atol=0)


def test_silence_and_clipping_make_finite_motion(begin):
    session = begin(loudness=None)
    parts = [session.push(np.zeros(8000, np.float32)), session.push(1e6 * np.sign(np.sin(np.arange(8000.0))))]
    assert session.clipped == 7999
    parts.append(session.push(np.full(8000, 32767, np.int16)))
    assert session.clipped == 15_999
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(parts))


def test_nothing_compiles_after_the_start_and_memory_stays_flat(session):
    rng, held = np.random.default_rng(0), []
    session.push(rng.normal(size=100_000).astype(np.float32))  # one whole chunk
    compiled = synthesis.advance._cache_size()
    for _ in range(40):
        session.push(rng.normal(size=rng.integers(1, 3000)).astype(np.float32))
        arrays = [*vars(session).values(), *vars(session._features).values()]
        held.append(sum(a.size for a in arrays if isinstance(a, np.ndarray)))
    assert synthesis.advance._cache_size() == compiled
    assert max(held[20:]) <= max(held[:20]) + 81 * 2


BAD = {
    "NaN": (lambda s: s.push(np.array([0.0, np.nan])), "NaN or infinite"),
    "infinite in float32": (lambda s: s.push(np.array([1e300])), "NaN or infinite"),
    "integers": (lambda s: s.push(np.zeros(3, np.int32)), "type int32"),
    "complex": (lambda s: s.push(np.zeros(3, complex)), "type complex128"),
    "two channels": (lambda s: s.push(np.zeros((3, 2), np.float32)), r"shape \(3, 2\)"),
    "text": (lambda s: s.push("hello"), "shape"),
    "a rate of 0": (lambda s: s.push(np.zeros(3, np.float32), rate_hz=0), "rate is 0 Hz"),
    "most": (lambda s: s.push(np.zeros(3, np.float32), most=-1), "give 0 or more"),
    "gap": (lambda s: s.gap(-1.0), "gap of -1 s"),
    "unknown style": (lambda s: s.set_style("hapy"), "unknown style 'hapy'"),
    "point of another space": (lambda s: s.set_style(np.zeros(3, np.float32)), "8 finite numbers"),
    "NaN point": (lambda s: s.set_style(np.full(8, np.nan, np.float32)), "8 finite numbers"),
    "transition": (lambda s: s.set_style(np.zeros(8, np.float32), transition_s=-1.0), "transition is -1"),
    "styles over time": (lambda s: s.set_style(Request(styles=("old", "sad"), spans=(0.5, 0.5))), "use set_style"),
}


def test_bad_input_is_one_sentence_and_changes_nothing(begin, wave):
    one, other = begin(), begin()
    pieces = np.array_split(wave, len(BAD))
    for (act, sentence), piece in zip(BAD.values(), pieces, strict=True):
        with pytest.raises(ValueError, match=sentence) as error:
            act(one)
        assert str(error.value).endswith(".")
        assert "\n" not in str(error.value)
        assert_same(one.push(piece), other.push(piece), atol=0)
    assert_same(one.flush(), other.flush(), atol=0)


def test_a_stream_that_ended_takes_nothing(session):
    session.push(np.zeros(100, np.float32))
    session.flush()
    for act in (lambda: session.push(np.zeros(1, np.float32)), session.flush, lambda: session.gap(1.0)):
        with pytest.raises(ValueError, match="begin a new StreamSession"):
            act()


def test_a_style_of_another_checkpoint_is_refused(gesturer, session, clips, tmp_path):
    other = gesturer._replace(params=jax.tree.map(lambda a: a + 1.0, gesturer.params))
    assert checkpoints.digest(other) != checkpoints.digest(gesturer)
    library.save(tmp_path / "other.npz", library.embed([str(clips / "happy.bvh")], other))
    with pytest.raises(ValueError, match=r"other\.npz"):
        session.set_style(str(tmp_path / "other.npz"))
    assert len(session.push(np.zeros(16_000, np.float32)).root.pos) > 0


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"lookahead": 16}, "0 to 15"),
        ({"lookahead": -1}, "0 to 15"),
        ({"loudness": 90.0}, "LUFS"),
        ({"rate_hz": 5}, "Hz"),
    ],
)
def test_what_a_session_cannot_be(begin, wrong, sentence):
    with pytest.raises(ValueError, match=sentence):
        begin(**wrong)


def test_a_point_needs_a_first_pose(gesturer, points):
    with pytest.raises(ValueError, match="first-pose"):
        StreamSession(gesturer, points[0])


def test_nothing_pushed_is_nothing_made(session):
    for made in (session.push(np.zeros(0, np.float32)), session.flush()):
        assert [a.shape for a in made[1:]] == [(0, 3), (0, 3), (0, 75, 3), (0, 75, 2, 3), (0, 75, 3), (0, 75, 3)]
