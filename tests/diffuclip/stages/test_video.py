"""The stage of video prompts (Eq. 18): films of motions by random cameras, come to lie where the motions do."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import prompts, rendering, video_encoder
from zeggs_jax.diffuclip.stages import video

MASK = np.arange(40) < 25


@pytest.fixture(scope="module")
def frozen(tiny, body, draw):
    """Prompt encoders, as the stage before leaves them."""

    def made(config):
        return draw(lambda key: prompts.init(key, config, body), body)

    return made


@pytest.fixture
def shown(config, leaning):
    """A film of a motion, as a function of (motion, mask, key)."""
    return jax.jit(partial(video.film, config, leaning.skeleton))


def test_a_batch_follows_from_its_number(config, leaning, frozen):
    stage = video.stage(config, leaning, {"prompts": frozen(config)})
    first, again, other = stage.batch(3), stage.batch(3), stage.batch(4)
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert np.any(first.motion != other.motion)
    assert first.motion.shape == (8, 39, config.motion_size)
    assert not first.motion[~first.mask].any()


def test_a_film_shows_the_motion_that_is_there_and_no_more(shown, leaning):
    motion = leaning.takes[0].motion[:40]
    film = shown(motion, MASK)
    assert film.shape == (2, 16, 16, 3)
    assert film.min() >= 0.0
    assert film.max() <= 1.0
    assert np.abs(film[0] - film[1]).max() > 0.1  # the first and the last frame that is there
    beyond = np.where(MASK[:, None], motion, np.roll(motion, 7, axis=0))
    np.testing.assert_allclose(shown(beyond, MASK), film, atol=1e-6)
    assert np.abs(shown(motion, np.ones(40, bool))[1] - film[1]).max() > 0.1


def test_cameras_are_drawn_by_the_key_and_without_one_look_from_the_front(shown, leaning):
    motion = leaning.takes[0].motion[:40]
    first, again, other = (shown(motion, MASK, jax.random.key(seed)) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.1
    assert np.abs(first - shown(motion, MASK)).max() > 0.1
    assert rendering.camera(jax.random.key(0), jnp.zeros(3)) is not None


@pytest.mark.slow
def test_equation_18_is_one_minus_the_cosine_and_the_motion_encoder_stays(config, leaning, frozen, draw, body):
    """By hand for one window; no gradient comes to the frozen side."""
    networks = video.Frozen(frozen(config), None, leaning.motion_scale)
    params = draw(lambda key: video_encoder.init(key, config), body, seed=3)
    motion = leaning.takes[0].motion[:39]
    batch = video.Batch(motion[None], np.ones((1, 39), bool))
    keys = jax.random.split(jax.random.key(2), 1)

    def lost(params, networks):
        return video.loss_fn(config, leaning.skeleton, params, batch, keys, None, networks)[0]

    @jax.jit
    def by_hand(params, networks):
        place, grain, _ = jax.random.split(keys[0], 3)
        scaled = (motion - leaning.motion_scale.mean) / leaning.motion_scale.std
        aim = prompts.encode_motion(networks.prompts, config, scaled, batch.mask[0])
        film = video.film(config, leaning.skeleton, motion, batch.mask[0], place)
        film = film + video.NOISE * jax.random.normal(grain, film.shape)
        return 1.0 - jnp.dot(aim, video_encoder.encode(params, config, film))

    slopes = jax.jit(jax.value_and_grad(lost, argnums=(0, 1), allow_int=True))
    found, (towards_video, towards_motion) = slopes(params, networks)
    np.testing.assert_allclose(found, by_hand(params, networks), atol=1e-5)
    assert max(np.abs(leaf).max() for leaf in jax.tree.leaves(towards_video)) > 1e-4
    assert not any(np.any(leaf) for leaf in jax.tree.leaves(towards_motion.prompts["motion"]))


@pytest.mark.slow
def test_videos_come_to_lie_where_their_motions_do(config, leaning, frozen):
    before = frozen(config)
    stage = video.stage(config, leaning, {"prompts": jax.tree.map(np.array, before)})
    state, losses = stage.begin(jax.random.key(0)), []
    for k in range(30):
        state, told = stage.step(state, stage.batch(k))
        losses.append(float(told["loss"]))
    assert np.mean(losses[-5:]) < 0.6 * losses[0]
    assert stage.validate(state)["loss"] < 0.8 * losses[0]
    params = stage.finish(state)
    jax.tree.map(np.testing.assert_array_equal, before, {name: params[name] for name in before})
    film = video.film(config, leaning.skeleton, leaning.takes[0].motion[:40], np.ones(40, bool))
    np.testing.assert_allclose(np.linalg.norm(prompts.encode_video(params, config, film[None])), 1.0, atol=1e-5)


def test_without_valid_takes_nothing_is_validated(config, leaning, frozen):
    alone = leaning._replace(takes=[take._replace(split="train") for take in leaning.takes])
    assert video.stage(config, alone, {"prompts": frozen(config)}).validate is None
    few = dataclasses.replace(config, learn_video=dataclasses.replace(config.learn_video, batch=2))
    assert len(video._batch(few, leaning, 0, "valid").mask) == 2
