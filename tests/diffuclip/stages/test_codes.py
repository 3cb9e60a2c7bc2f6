"""The stage of the codes: batches by number, books by averages, networks by gradients, what is told, learning."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import representation, vqvae
from zeggs_jax.diffuclip.stages import codes
from zeggs_jax.diffuclip.stages.stage import Material, Take
from zeggs_jax.motion import features
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.skeleton import Skeleton

FRAMES = 24  # of a window: 0.8 s


@pytest.fixture(scope="module")
def tiny(tiny):
    """Networks of few layers, which compile fast."""
    return dataclasses.replace(tiny, codes=dataclasses.replace(tiny.codes, halvings=1, depth=1))


def material_of(clips: list[Clip], body: Skeleton) -> Material:
    motions = [representation.encode(clip) for clip in clips]
    takes = [
        Take(
            str(k), "calm", "valid" if k == 1 else "train", motion, np.zeros((len(motion) // 4, 2), np.float32), (), ()
        )
        for k, motion in enumerate(motions)
    ]
    return Material(takes, representation.scale(motions, body), body)


@pytest.fixture(scope="module")
def material(clip, body):
    pieces = (slice(60), slice(30, 90))
    halves = [clip._replace(euler=clip.euler[piece], positions=clip.positions[piece]) for piece in pieces]
    return material_of([*halves, clip], body)


@pytest.fixture(scope="module")
def learnt(tiny, material):
    """The stage, its first state, the state after 30 updates, and the metrics of each."""
    stage = codes.stage(tiny, material, {})
    state, told = stage.begin(jax.random.key(0)), []
    first = state
    for k in range(tiny.learn_codes.steps):
        state, metrics = stage.step(state, stage.batch(k))
        told.append({name: float(value) for name, value in metrics.items()})
    return stage, first, state, told


def test_a_batch_is_a_function_of_its_number(tiny, material):
    stage = codes.stage(tiny, material, {})
    assert stage.batch(3).shape == (8, FRAMES, tiny.motion_size)
    np.testing.assert_array_equal(stage.batch(3), codes.stage(tiny, material, {}).batch(3))
    assert np.any(stage.batch(3) != stage.batch(4))


def test_windows_are_scaled_pieces_of_the_training_takes(tiny, material):
    scaled = [(take.motion - material.motion_scale.mean) / material.motion_scale.std for take in material.takes]
    train = np.concatenate([piece for piece, take in zip(scaled, material.takes, strict=True) if take.split == "train"])
    for window in codes.stage(tiny, material, {}).batch(0):
        assert np.abs(train - window[0]).max(axis=1).min() < 1e-4


@pytest.mark.slow
def test_it_learns(learnt):
    _, _, _, told = learnt
    assert np.mean([t["loss"] for t in told[-5:]]) < 0.95 * np.mean([t["loss"] for t in told[:5]])
    assert all(np.isfinite(list(t.values())).all() for t in told)


@pytest.mark.slow
def test_the_loss_is_its_terms(tiny, learnt):
    told = learnt[3][-1]
    own = tiny.codes
    total = told["reconstruction"] + own.velocity * told["velocity"] + own.acceleration * told["acceleration"]
    np.testing.assert_allclose(told["loss"], total + own.commit * told["commit"], rtol=1e-5)


@pytest.mark.slow
def test_networks_learn_by_gradients_and_books_by_averages(learnt):
    _, first, state, _ = learnt
    assert int(state.step) == 30
    for part in ("upper", "lower"):
        np.testing.assert_array_equal(state.params[part]["columns"], first.params[part]["columns"])
        book = vqvae.book(state.params[part])
        np.testing.assert_allclose(book.vectors, book.sums / book.counts[..., None], rtol=1e-5)
        before, after = (s.params[part]["encoder"]["out"]["weight"] for s in (first, state))
        assert np.any(before != after)
    kept = jax.tree.leaves(state.average)
    assert len(kept) == len(jax.tree.leaves(codes._nets(state.params)))  # no book has an average or an optimiser


@pytest.mark.slow
def test_the_model_gets_the_averaged_networks_and_the_books_as_they_are(learnt):
    stage, first, state, _ = learnt
    kept = stage.finish(state)
    assert jax.tree.structure(kept) == jax.tree.structure(first.params)
    np.testing.assert_array_equal(
        kept["upper"]["encoder"]["out"]["bias"], state.average["upper"]["encoder"]["out"]["bias"]
    )
    assert np.any(kept["upper"]["encoder"]["out"]["bias"] != state.params["upper"]["encoder"]["out"]["bias"])
    np.testing.assert_array_equal(kept["lower"]["book"]["vectors"], state.params["lower"]["book"]["vectors"])


@pytest.mark.slow
def test_the_same_update_twice_is_the_same(tiny, material, learnt):
    stage, first, _, told = learnt
    _, again = codes.stage(tiny, material, {}).step(first, stage.batch(0))
    assert {name: float(value) for name, value in again.items()} == told[0]


@pytest.mark.slow
def test_centimetres_are_those_of_the_decoded_clips(tiny, material, learnt, body):
    """By the BVH of one window's truth and reconstruction, both above the truth's way."""
    stage, _, state, _ = learnt
    params, fitted = stage.finish(state), material.motion_scale
    window = stage.batch(0)[0]
    made = np.asarray(jax.jit(vqvae.reconstruct, static_argnames="config")(params, tiny, jnp.asarray(window)))
    places = []
    for scaled in (window, made):
        clip = representation.decode(scaled * fitted.std + fitted.mean, body, tiny.frame_time)
        world = features.world_positions(clip)
        places.append(world - world[:, :1] * [1.0, 0.0, 1.0])
    apart = np.linalg.norm(places[0] - places[1], axis=-1).mean(axis=0)
    found, *_ = codes._compare(params, tiny, fitted, window[None], np.asarray(body.offsets, np.float32), body.parents)
    np.testing.assert_allclose(found, apart, atol=2e-3)


@pytest.mark.slow
def test_validation_tells_of_parts_ends_and_codes(tiny, learnt):
    stage, _, state, _ = learnt
    told = stage.validate(state)
    for name in ("loss", "error_cm", "drift_cm", "upper_cm", "lower_cm", "hand_cm", "foot_cm"):
        assert np.isfinite(told[name]), name
    for name in ("upper0", "upper1", "lower0", "lower1"):
        assert 1 <= told[f"{name}_perplexity"] <= told[f"{name}_used"] + 1e-3 <= tiny.codes.codes + 1e-3


def test_clips_shorter_than_a_window_are_told(tiny, material):
    longer = dataclasses.replace(tiny, learn_codes=dataclasses.replace(tiny.learn_codes, seconds=9.0))
    with pytest.raises(ValueError, match="no clip of the split 'train' is 270 frames long; shorten"):
        codes.stage(longer, material, {})


@pytest.mark.slow
def test_one_clip_is_learnt_to_two_millimetres(clip, body, tiny):
    """Sec. 4's networks with room enough and many codes: what is lost is not in the wiring."""
    roomy = dataclasses.replace(
        tiny,
        codes=dataclasses.replace(
            tiny.codes, halvings=2, depth=2, latent=32, codes=64, quantisers=8, width=64, decay=0.95
        ),
        learn_codes=dataclasses.replace(tiny.learn_codes, steps=3000, learning_rate=2e-3, warmup=50, ema=0.98),
    )
    stage = codes.stage(roomy, material_of([clip], body), {})
    state = stage.begin(jax.random.key(0))
    for k in range(roomy.learn_codes.steps):
        state, _ = stage.step(state, stage.batch(k))
    assert stage.validate(state)["error_cm"] < 0.2
