"""The folded decoder: the plain one's poses, in pieces and in batches; nothing compiled anew, no weight copied."""

import re
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data.scale import Scale
from zeggs_jax.nn import reduced
from zeggs_jax.zeroeggs import decoder as d
from zeggs_jax.zeroeggs import folded as f
from zeggs_jax.zeroeggs import model as m

FRAMES = 600
VARIED = [
    {},
    {"layers": 1, "facing": False},
    pytest.param({"layers": 3, "initialiser": False}, marks=pytest.mark.slow),
    pytest.param({"facing": False, "initialiser": False}, marks=pytest.mark.slow),
    pytest.param({"layers": 1}, marks=pytest.mark.slow),
    pytest.param({"layers": 3}, marks=pytest.mark.slow),
]
plain = jax.jit(d.rollout, static_argnames="config")
fast = jax.jit(f.rollout, static_argnames="config")
advance = jax.jit(f.advance, static_argnames="config")


def close(ours, expected, atol):
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=atol), ours, expected)


def parts(clip, **varied):
    """Config, params, scales, first pose, what is given; weights small enough that rounding does not grow."""
    config = replace(clip.config.decoder, **varied)
    params = jax.tree.map(lambda a: 0.7 * a, clip.params["decoder"])
    return config, params, clip.scales, clip.first, d.Frame(clip.speech, clip.style, clip.gaze)


def both(clip, **varied):
    config, params, scales, first, given = parts(clip, **varied)
    folded = f.fold(params, config, scales, clip.config.frame_time)
    ours = fast(params, folded, config, scales, first, given)
    return ours, plain(params, config, scales, first, given, clip.config.frame_time)


@pytest.mark.parametrize("varied", VARIED, ids=str)
def test_the_forms_agree_over_600_frames(build, varied):
    ours, expected = both(build("normal", varied.get("layers", 2), frames=FRAMES), **varied)
    assert ours.joint_pos.shape == (FRAMES, 5, 3)
    assert np.ptp(np.asarray(expected.joint_pos[-100:]), axis=0).max() > 0.1  # it has not come to rest
    close(ours, expected, 1e-4)


@pytest.mark.parametrize("varied", VARIED[1:], ids=str)
def test_in_float64_they_are_one(build, varied):
    """Rounding aside nothing differs, whatever the weights; columns that never change fold too."""
    clip = build("normal", varied.get("layers", 2), frames=40)
    with jax.enable_x64(True):
        clip = jax.tree.map(lambda a: jnp.asarray(a, jnp.float64), clip._replace(config=None))._replace(
            config=clip.config
        )
        still = Scale(clip.scales.pose_out.mean, clip.scales.pose_out.std.at[::3].set(0.0))
        ours, expected = both(clip._replace(scales=clip.scales._replace(pose_out=still)), **varied)
        assert ours.joint_pos.dtype == np.float64
        close(ours, expected, 1e-10)


def test_first_frame_is_verbatim_and_the_root_is_the_sum_of_its_velocities(small):
    ours, _ = both(small)
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a[0], b), ours, small.first)
    move = d.poses.integrate(d.poses.Root(*(a[:-1] for a in ours.root)), ours.root_vel[1:], ours.root_ang[1:], 0.016667)
    close(move, jax.tree.map(lambda a: a[1:], ours.root), 1e-5)


def test_pieces_are_the_whole(small):
    config, params, scales, first, given = parts(small)
    folded = f.fold(params, config, scales, 0.016667)
    state = jax.jit(f.begin, static_argnames="config")(
        params, folded, config, scales, first, jax.tree.map(lambda a: a[0], given)
    )
    whole = advance(folded, config, state, jax.tree.map(lambda a: a[1:], given))
    one, poses = advance(folded, config, state, jax.tree.map(lambda a: a[1:3], given))
    last, more = advance(folded, config, one, jax.tree.map(lambda a: a[3:], given))
    joined = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), poses, more)
    close((last, joined), whole, 1e-5)


def test_a_batch_is_its_clips(small, build):
    other = build(seed=3)
    config, params, scales, *_ = parts(small)
    folded = f.fold(params, config, scales, 0.016667)
    clips = [parts(each)[3:] for each in (small, other)]
    firsts, given = jax.tree.map(lambda *a: jnp.stack(a, -1), *clips)
    start = jax.jit(jax.vmap(partial(f.begin, params, folded, config, scales), -1, -1))
    states = start(firsts, jax.tree.map(lambda a: a[0], given))
    advance_many = jax.jit(f.advance_many, static_argnames="config")
    _, together = advance_many(folded, config, states, jax.tree.map(lambda a: a[1:], given))
    for i, (first, told) in enumerate(clips):
        alone = fast(params, folded, config, scales, first, told)
        close(jax.tree.map(lambda a, i=i: a[i], together), jax.tree.map(lambda a: a[1:], alone), 1e-5)


def test_film_has_no_fast_form(build):
    config, params, scales, *_ = parts(build("film"))
    assert not f.fits(config)
    assert f.fits(replace(config, conditioning="normal"))
    with pytest.raises(ValueError, match="'film' conditioning has no folded form"):
        f.fold(params, config, scales, 0.016667)


def loop_text(compiled: str) -> str:
    """The computations of a compiled program that run inside its while loops."""
    computations = dict(re.findall(r"^(?:ENTRY )?%?([\w.\-]+) \(.*?\{\n(.*?)^\}", compiled, re.M | re.S))
    inside, waiting = set(), re.findall(r"body=%?([\w.\-]+)", compiled)
    assert waiting, "no loop found"
    while waiting:
        name = waiting.pop()
        if name not in inside:
            inside.add(name)
            waiting += re.findall(r"(?:calls|to_apply|body)=%?([\w.\-]+)", computations[name])
    return "".join(computations[name] for name in inside)


def large(layers=2):
    """Config and shapes of a decoder whose weights are larger than anything else in it."""
    config = m.ZeroEggsConfig(joints=8, decoder=m.DecoderConfig(hidden=256, layers=layers))
    params = m.init(jax.random.key(0), config)["decoder"]
    n = config.vector_size
    scales = m.Scales(*(Scale(jnp.zeros(k), jnp.ones(k)) for k in (81, n + 3, n)))
    return config.decoder, f.fold(params, config.decoder, scales, 0.016667)


def compiled(folded, config, frames, batch=()):
    """The text of the compiled program, with donated state as it runs."""
    hidden, layers = config.hidden, config.layers
    shape = lambda *s: jax.ShapeDtypeStruct((*s, *batch), jnp.float32)  # noqa: E731
    root = d.poses.Root(shape(3), shape(4))
    rows = [6 * hidden] * (layers - 1) + [7 * hidden]
    state = f.FoldedState(root, (shape(hidden),) * layers, tuple(map(shape, rows)))
    run = jax.jit(f.advance_many if batch else f.advance, static_argnums=1, donate_argnums=2)
    given = d.Frame(shape(frames, 64), shape(frames, 64), shape(frames, 3))
    return run.lower(folded, config, state, given).compile().as_text()


def moved(text):
    """Shapes, sorted, of all arrays that are copied, transposed or converted in a program."""
    found = re.findall(r"= \w+\[([\d,]+)\]\S* (?:copy|transpose|convert)\(", text)
    return {tuple(sorted(int(n) for n in shape.split(","))) for shape in found}


@pytest.mark.parametrize("batch", [(), (4,)], ids=["one clip", "batch"])
def test_no_weight_is_copied(batch):
    """Neither in the loop, nor around it, where a copy would cost as much as a frame."""
    config, folded = large()
    text = compiled(folded, config, f.CHUNK, batch)
    weights = {tuple(sorted(a.shape)) for a in jax.tree.leaves(folded) if a.size > 30000}
    assert (256, 7 * 256) in weights
    assert not moved(text) & weights
    assert max(map(np.prod, moved(loop_text(text))), default=0) < 65536
    assert "input_output_alias" in text  # the state is donated


def test_a_planted_copy_is_found():
    """What XLA writes when a loop has `x @ W.T` in it."""
    body = "%b (p: f32[9,8]) -> f32[9,8] {\n  %copy.3 = f32[9,8]{0,1} copy(%w)\n}\n"
    text = f"{body}ENTRY %main (w: f32[9,8]) -> f32[9,8] {{\n  ROOT %while.1 = while(%i), body=%b\n}}\n"
    assert moved(loop_text(text)) == {(8, 9)}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["bfloat16", "int8"])
def test_reduced_weights_are_near(build, kind, monkeypatch):
    monkeypatch.setattr(reduced, "SMALLEST", 64)
    config, params, scales, first, given = parts(build(frames=60))
    exact = f.fold(params, config, scales, 0.016667)
    less = reduced.with_precision(exact, kind)
    ours, expected = (fast(params, each, config, scales, first, given) for each in (less, exact))
    assert not np.array_equal(ours.joint_pos, expected.joint_pos)
    close(ours.joint_axes, expected.joint_axes, 0.1)
