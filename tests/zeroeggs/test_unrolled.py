"""The training form is the decoder: values and gradients, of one clip and of many, in every setting that it takes."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.nn.compute import PLAIN, Compute
from zeggs_jax.zeroeggs import decoder, unrolled
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs.decoder import Frame


def plainly(params, config, scales, first, given, frame_time, compute=PLAIN):
    """The decoder, of every clip."""
    alone = partial(decoder.rollout, params, config, scales, frame_time=frame_time, compute=compute)
    return jax.vmap(lambda first, given: alone(first=first, given=given))(first, given)


FORMS = (unrolled.rollout, plainly)
SETTINGS = {
    "released": {},
    "one layer": {"layers": 1},
    "three layers": {"layers": 3},
    "blind": {"facing": False},
    "from zero": {"initialiser": False},
}


def case(build, changed=None, clips: int = 1):
    """A small model and what its decoder is given of some clips: config, scales, params, first poses, frames."""
    small = build()
    config = replace(small.config, decoder=replace(small.config.decoder, **(changed or {})))
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))["decoder"]
    rng = np.random.default_rng(0)
    params = jax.tree.map(lambda a: rng.normal(size=a.shape) / a.shape[-1] ** 0.5, shapes)
    first, given = jax.tree.map(
        lambda a: np.asarray(a, float) + 0.1 * rng.normal(size=(clips, *a.shape)),
        (small.first, Frame(small.speech, small.style, small.gaze)),
    )
    return config, jax.tree.map(lambda a: np.asarray(a, float), small.scales), params, first, given


def total(form, config, scales, params, first, given, compute=PLAIN):
    """A number that every pose changes."""
    made = form(params, config.decoder, scales, first, given, config.frame_time, compute)
    return sum(jnp.sum(jnp.sin(a)) for a in jax.tree.leaves(made))


def both(function, given, precise=True):
    """The same function of both forms."""
    with jax.enable_x64(precise):
        return [jax.jit(partial(function, form))(*given) for form in FORMS]


def close(ours, theirs, tolerance=1e-9):
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance), ours, theirs)


def values_and_slopes(config, scales, compute=PLAIN):
    """Poses, and the gradients of what they were made of."""

    def run(form, params, first, given):
        of = partial(total, form, config, scales, compute=compute)
        return (
            form(params, config.decoder, scales, first, given, config.frame_time, compute),
            jax.grad(of, (0, 1, 2))(params, first, given),
        )

    return run


@pytest.mark.parametrize("changed", SETTINGS.values(), ids=SETTINGS)
def test_values_and_gradients_of_a_clip(build, changed):
    config, scales, *given = case(build, changed)
    close(*both(values_and_slopes(config, scales), given))


def test_values_and_gradients_in_single_precision(build):
    config, scales, *given = jax.tree.map(
        lambda a: a if isinstance(a, m.ZeroEggsConfig) else np.float32(a), case(build)
    )
    close(*both(values_and_slopes(config, scales), given, precise=False), tolerance=3e-4)


def test_values_with_rounded_products(build):
    config, scales, *given = case(build)
    rounded = both(values_and_slopes(config, scales, Compute("bfloat16")), given)
    close(rounded[0][0], rounded[1][0], tolerance=1e-6)
    with pytest.raises(AssertionError):
        close(rounded[0][0], both(values_and_slopes(config, scales), given)[0][0], tolerance=1e-6)


def test_gradients_with_rounded_products(build):
    """Here the cotangents are rounded before they are multiplied, so that the slopes are near those of the other."""
    config, scales, *given = case(build)
    ours, theirs = (slopes for _, slopes in both(values_and_slopes(config, scales, Compute("bfloat16")), given))
    exact = both(values_and_slopes(config, scales), given)[0][1]

    def apart(one, other):
        pairs = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
        pairs = [(np.asarray(a), np.asarray(b)) for a, b in pairs]
        squares = [(np.sum((a - b) ** 2), np.sum(b**2)) for a, b in pairs]
        return float(np.divide(*np.sum(squares, axis=0)) ** 0.5)

    assert apart(ours, theirs) < 2.0**-8 < apart(ours, exact) < 0.1


def test_clips_of_a_batch_are_apart(build):
    """Each clip's gradients are those of it alone, the parameters' are the sum."""
    config, scales, params, *given = case(build, clips=3)
    with jax.enable_x64(True):
        run = jax.jit(partial(values_and_slopes(config, scales), unrolled.rollout))
        made, slopes = run(params, *given)
        each = [run(params, *jax.tree.map(lambda a, i=i: a[i : i + 1], given)) for i in range(3)]
        close((made, slopes[1:]), jax.tree.map(lambda *a: np.concatenate(a), *((m, s[1:]) for m, s in each)))
        close(slopes[0], jax.tree.map(lambda *a: np.sum(a, axis=0), *(s[0] for _, s in each)))


def test_values_and_gradients_of_a_batch(build):
    config, scales, *given = case(build, clips=3)
    close(*both(values_and_slopes(config, scales), given))


def test_a_batch_of_parameters(build):
    config, scales, params, *given = case(build)
    several = jax.tree.map(lambda a: np.stack([a, 0.5 * a]), params)

    def slopes(form, params, first, frames):
        return jax.vmap(partial(values_and_slopes(config, scales), form), (0, None, None))(params, first, frames)

    close(*both(slopes, (several, *given)))


def test_one_frame_is_the_first_pose(build):
    config, *given = case(build)
    scales, params, first, given = jax.tree.map(jnp.float32, given)
    alone = unrolled.rollout(params, config.decoder, scales, first, jax.tree.map(lambda a: a[:, :1], given), 1 / 60)
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a, b[:, None]), alone, first)


@pytest.mark.parametrize("changed", [{"conditioning": "film"}, {}])
def test_what_has_no_training_form_is_the_decoder(build, changed, monkeypatch):
    config, scales, params, first, given = case(build, changed)
    compute = Compute(remat=not changed)
    assert not unrolled.fits(config.decoder, compute)
    assert unrolled.fits(config.decoder) is not bool(changed)
    monkeypatch.setattr(decoder, "rollout", lambda *_, first, **__: first)
    made = unrolled.rollout(params, config.decoder, scales, first, given, 1 / 60, compute)
    jax.tree.map(np.testing.assert_allclose, made, first)
