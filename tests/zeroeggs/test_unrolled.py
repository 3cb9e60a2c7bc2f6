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

FORMS = (unrolled.rollout, decoder.rollout)
SETTINGS = {
    "released": {},
    "one layer": {"layers": 1},
    "three layers": {"layers": 3},
    "blind": {"facing": False},
    "from zero": {"initialiser": False},
}


def case(build, changed=None, clips: int = 0):
    """A small model and what its decoder is given, one clip or several: config, scales, params, first pose, frames."""
    small = build()
    config = replace(small.config, decoder=replace(small.config.decoder, **(changed or {})))
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))["decoder"]
    rng = np.random.default_rng(0)
    params = jax.tree.map(lambda a: rng.normal(size=a.shape) / a.shape[-1] ** 0.5, shapes)
    lead = (clips,) if clips else ()
    first, given = jax.tree.map(
        lambda a: np.asarray(a, float) + 0.1 * rng.normal(size=(*lead, *a.shape)),
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
    """Of one clip, or with `jax.vmap` of many."""

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


def test_values_and_gradients_with_rounded_products(build):
    config, scales, *given = case(build)
    rounded = both(values_and_slopes(config, scales, Compute("bfloat16")), given)
    close(*rounded, tolerance=1e-6)
    with pytest.raises(AssertionError):
        close(rounded[0], both(values_and_slopes(config, scales), given)[0], tolerance=1e-6)


def test_values_and_gradients_of_a_batch(build):
    """Gradients of the mean over the clips, and those of each clip by itself."""
    config, scales, *given = case(build, clips=3)

    def mean(form, params, first, frames):
        losses = jax.vmap(partial(total, form, config, scales), (None, 0, 0))(params, first, frames)
        return jnp.mean(losses)

    def slopes(form, *given):
        each = jax.vmap(partial(values_and_slopes(config, scales), form), (None, 0, 0))
        return jax.grad(partial(mean, form), (0, 1, 2))(*given), each(*given)

    (ours, each), theirs = both(slopes, given)
    close((ours, each), theirs)
    close(ours[0], jax.tree.map(lambda a: np.asarray(a).mean(0), each[1][0]))


def test_a_batch_of_parameters(build):
    config, scales, params, *given = case(build)
    several = jax.tree.map(lambda a: np.stack([a, 0.5 * a]), params)

    def slopes(form, params, first, frames):
        return jax.vmap(partial(values_and_slopes(config, scales), form), (0, None, None))(params, first, frames)

    close(*both(slopes, (several, *given)))


def test_one_frame_is_the_first_pose(build):
    config, *given = case(build)
    scales, params, first, given = jax.tree.map(jnp.float32, given)
    alone = unrolled.rollout(params, config.decoder, scales, first, jax.tree.map(lambda a: a[:1], given), 1 / 60)
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a, b[None]), alone, first)


@pytest.mark.parametrize("changed", [{"conditioning": "film"}, {}])
def test_what_has_no_training_form_is_the_decoder(build, changed, monkeypatch):
    config, scales, params, first, given = case(build, changed)
    compute = Compute(remat=not changed)
    assert not unrolled.fits(config.decoder, compute)
    assert unrolled.fits(config.decoder) is not bool(changed)
    monkeypatch.setattr(decoder, "rollout", lambda *given: given[3])
    assert unrolled.rollout(params, config.decoder, scales, first, given, 1 / 60, compute) is first
