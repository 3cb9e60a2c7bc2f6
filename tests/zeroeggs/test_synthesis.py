"""Pieces of a fixed number of frames are the whole clip, alone or in a batch, and no length compiles anew."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import monitoring

from zeggs_jax.motion.features import Motion
from zeggs_jax.nn import reduced
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs import synthesis as s
from zeggs_jax.zeroeggs.folded import CHUNK

LENGTHS = (1, 2, CHUNK, CHUNK + 1, CHUNK + 2, 2 * CHUNK + 20)
COMPILED = "/jax/core/compile/backend_compile_duration"
plain = jax.jit(m.decode, static_argnames="config")


def close(ours, expected, atol=1e-4):
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=atol), ours, expected)


def told(clip, frames, seed=0):
    """Random speech features and a style of every frame."""
    rng = np.random.default_rng(seed)
    spectrum, style = (rng.normal(size=(frames, k)).astype(np.float32) for k in (9, 4))
    return s.Told(spectrum, style, Motion(jax.tree.map(lambda a: a[None], clip.first), np.array([9.0, 0, 50])))


@pytest.fixture(scope="module", params=["normal", pytest.param("film", marks=pytest.mark.slow)])
def clip(request, build):
    return build(request.param)


@pytest.fixture(scope="module")
def model(clip):
    params = clip.params | {"decoder": jax.tree.map(lambda a: 0.7 * a, clip.params["decoder"])}
    return m.Model(clip.config, params, clip.scales, None)  # pyright: ignore


def whole(model, told):
    """The networks of Fig. 2 on the whole clip at once, in their plain form."""
    speech = m.encode_speech(model.params, model.config, model.scales, jnp.asarray(told.spectrum))
    first = jax.tree.map(lambda a: a[0], told.start.pose)
    gaze = jnp.tile(jnp.asarray(told.start.gaze, jnp.float32)[None], (len(speech), 1))
    return plain(model.params, model.config, model.scales, first, speech, jnp.asarray(told.style), gaze)


def test_pieces_are_the_whole(clip, model):
    one = told(clip, LENGTHS[-1])
    ours = s.synthesize(model, *one)
    close(ours, whole(model, one))
    assert ours.joint_pos.shape == (LENGTHS[-1], 5, 3)
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a[0], b), ours, clip.first)


def test_what_comes_later_changes_nothing_before(clip, model):
    """An end inside a piece is an end: but for the look-ahead, a clip is the start of a longer one."""
    long, frames = told(clip, 2 * CHUNK + 20), CHUNK + 30
    short = s.Told(long.spectrum[:frames], long.style[:frames], long.start)
    ours, expected = s.synthesize(model, *short), s.synthesize(model, *long)
    sure = frames - model.config.speech.ahead
    close(jax.tree.map(lambda a: a[:sure], ours), jax.tree.map(lambda a: a[:sure], expected))
    assert np.abs(ours.joint_pos[-1] - expected.joint_pos[frames - 1]).max() > 1e-4


@pytest.mark.parametrize("lookahead", [0, 1, 4])
def test_a_pose_is_of_the_speech_up_to_the_look_ahead_and_no_further(clip, model, lookahead):
    config = replace(model.config, speech=replace(model.config.speech, lookahead=lookahead))
    model, one = model._replace(config=config), told(clip, CHUNK + 20)
    for at in (30, CHUNK + 10):
        later = np.where(np.arange(len(one.spectrum))[:, None] < at, one.spectrum, one.spectrum + 5.0)
        ours, theirs = (s.synthesize(model, *one._replace(spectrum=x)).joint_pos for x in (one.spectrum, later))
        apart = np.abs(ours - theirs).max((1, 2))
        np.testing.assert_allclose(apart[: at - lookahead], 0.0, atol=1e-6)
        assert apart[at - lookahead] > 1e-3


def test_many_are_each_alone_in_their_order(clip, model):
    clips = [told(clip, frames, seed) for seed, frames in enumerate(reversed(LENGTHS))]
    for one, poses in zip(clips, s.synthesize_many(model, clips), strict=True):
        assert len(poses.joint_pos) == len(one.spectrum)
        close(poses, s.synthesize(model, *one))
    assert s.synthesize_many(model, []) == []


def test_more_clips_than_are_decoded_at_once(clip, model):
    clips = [told(clip, 3, seed) for seed in range(s.WIDTHS[-1] + 1)]
    for number, poses in enumerate(s.synthesize_many(model, clips)):
        if number % 16 == 0:
            close(poses, s.synthesize(model, *clips[number]))


@pytest.mark.parametrize("precision", ["bfloat16", "int8"])
@pytest.mark.parametrize("count", [2, 5])
def test_many_with_weights_of_fewer_bytes_are_near_each_alone(build, monkeypatch, precision, count):
    """Two clips by the kernel, where there is one; five, filled up to eight, in bfloat16 where that pays."""
    monkeypatch.setattr(reduced, "SMALLEST", 64)
    small = build("normal")
    params = small.params | {"decoder": jax.tree.map(lambda a: 0.7 * a, small.params["decoder"])}
    model = m.Model(small.config, params, small.scales, None)  # pyright: ignore
    clips = [told(small, 9, seed) for seed in range(count)]
    for one, poses in zip(clips, s.synthesize_many(model, clips, precision), strict=True):
        exact = s.synthesize(model, *one)
        apart = np.abs(poses.joint_axes - exact.joint_axes).max()
        assert 0 < apart < 0.1
        assert np.abs(poses.joint_axes - s.synthesize(model, *one, precision).joint_axes).max() < 0.05


def test_a_model_is_made_ready_once_and_another_is_not_taken_for_it(clip, model):
    run = s.ready(model)
    assert s.ready(model._replace(params=dict(model.params))) is run
    other = model._replace(params=jax.tree.map(lambda a: 2.0 * a, model.params))
    assert s.ready(other) is not run
    one = told(clip, 5)
    assert np.abs(s.synthesize(other, *one).joint_pos - s.synthesize(model, *one).joint_pos).max() > 1e-3


def test_reduced_weights_need_the_folded_form(build):
    film = build("film")
    with pytest.raises(ValueError, match="'film' conditioning has no folded form"):
        s.synthesize(m.Model(film.config, film.params, film.scales, None), *told(film, 5), "int8")  # pyright: ignore


def compilations(run):
    """How many programs XLA compiles, or takes from its cache, while `run` runs."""
    found = []

    def listen(event: str, _: float, **__: object) -> None:
        found.append(event)

    monitoring.register_event_duration_secs_listener(listen)
    try:
        run()
    finally:
        monitoring.unregister_event_duration_listener(listen)
    return found.count(COMPILED)


def test_no_audio_length_compiles_anew(clips, gesturer):
    """The whole of `generate`, from samples to joint angles, over 20 lengths of up to 12 s."""
    rng = np.random.default_rng(0)
    request = g.Request(styles=(str(clips / "old.bvh"),))
    make = lambda samples: g.generate(rng.normal(size=samples) * 0.1, request, model=gesturer)  # noqa: E731
    assert compilations(lambda: jax.jit(lambda x: x + len(LENGTHS))(0.0)) == 1  # the count counts
    make(16_000)
    make(16_000 * 12)
    lengths = np.linspace(9_000, 16_000 * 12, 20).astype(int)
    assert len(set(lengths)) == 20
    assert compilations(lambda: [make(int(samples)) for samples in lengths]) == 0
