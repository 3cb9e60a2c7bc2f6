"""The VQ-VAE: lengths, what a latent sees, parts kept apart, gradients through the codes, overfitting one clip."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data import scale
from zeggs_jax.diffuclip import body_parts, quantiser, vqvae
from zeggs_jax.diffuclip.config import CodesConfig

encode = jax.jit(vqvae.encode, static_argnames="config")
decode = jax.jit(vqvae.decode, static_argnames="config")
reconstruct = jax.jit(vqvae.reconstruct, static_argnames="config")
quantise = jax.jit(vqvae.quantise, static_argnames="config")


@pytest.fixture(scope="module")
def params(tiny, body, draw):
    """Drawn networks, and books whose entries are vectors of noise."""
    return codes_of(tiny, body, draw)


def codes_of(config, body, draw):
    return draw(lambda key: {"codes": vqvae.init(key, config, body)}, body, config.parts)["codes"]


def test_networks_are_drawn_and_books_wait_for_their_first_batch(tiny, body):
    few = dataclasses.replace(tiny, codes=dataclasses.replace(tiny.codes, halvings=1, depth=1))
    made, other = (vqvae.init(jax.random.key(seed), few, body) for seed in (0, 1))
    for part in few.parts:
        assert not made[part]["book"]["counts"].any()
        weights = [params[part]["encoder"]["out"]["weight"] for params in (made, made, other)]
        np.testing.assert_array_equal(weights[0], weights[1])
        assert np.abs(weights[0] - weights[2]).max() > 0.01
        assert 0.8 < np.abs(weights[0]).max() * np.sqrt(3 * few.codes.width) <= 1.0  # U(-1, 1) / sqrt(fan in)
    assert np.any(made["upper"]["encoder"]["out"]["bias"] != made["lower"]["encoder"]["out"]["bias"])


def motion_of(config, frames=48, seed=0):
    return jax.random.normal(jax.random.key(seed), (frames, config.motion_size))


def test_shapes_of_the_paper():
    assert CodesConfig().rate == 8
    assert CodesConfig().latent == 512


@pytest.mark.parametrize("frames", [1, 33])
def test_any_length_is_padded_with_its_last_frame_and_cut_back(params, tiny, frames):
    motion = motion_of(tiny, frames)
    z = encode(params, tiny, motion)
    latents = -(-frames // tiny.codes.rate)
    assert z.shape == (latents, tiny.latent_size)
    longer = np.pad(motion, ((0, latents * tiny.codes.rate - frames), (0, 0)), mode="edge")
    np.testing.assert_array_equal(encode(params, tiny, longer), z)
    assert reconstruct(params, tiny, motion).shape == motion.shape


def test_a_latent_sees_what_its_convolutions_reach(params, tiny):
    """Beyond its own 4 frames: 1 + 2 of the halvings, 2 and 4 times the dilations' sum 4, 4 of the last: 31."""
    motion = motion_of(tiny, 120)
    slope = jax.jit(jax.grad(lambda x: jnp.abs(vqvae.encode(params, tiny, x)[15]).sum()))(motion)
    seen = np.flatnonzero(np.abs(np.asarray(slope)).sum(axis=1))
    assert (seen[0], seen[-1]) == (15 * 4 - 31, 15 * 4 + 3 + 31)


def test_a_motion_one_latent_later_gives_latents_one_later(params, tiny):
    motion = motion_of(tiny, 120)
    z, later = encode(params, tiny, motion[:116]), encode(params, tiny, motion[4:])
    np.testing.assert_allclose(later[9:19], z[10:20], atol=1e-5)


def test_parts_are_encoded_and_decoded_apart(params, tiny, body):
    """Frames of the upper body change only its latents, and its latents only its columns."""
    upper, lower = body_parts.columns(body, tiny.parts)
    motion = motion_of(tiny)
    changed = motion.at[:, upper].add(1.0)
    z, other = encode(params, tiny, motion), encode(params, tiny, changed)
    own, foreign = body_parts.masks(tiny)
    np.testing.assert_array_equal(z[:, foreign], other[:, foreign])
    assert np.abs(z - other)[:, own].max() > 0.01
    made, moved = decode(params, tiny, z), decode(params, tiny, z + jnp.asarray(own)[None] * 0.5)
    np.testing.assert_array_equal(made[:, lower], moved[:, lower])
    assert np.abs(made - moved)[:, upper].max() > 0.01


def test_one_part_is_the_whole_body(tiny, body, draw):
    whole = dataclasses.replace(tiny, parts=())
    params = codes_of(whole, body, draw)
    motion = motion_of(whole)
    z = encode(params, whole, motion)
    assert z.shape == (12, 6)
    quantised, codes = quantise(params, whole, z)
    assert codes.shape == (12, 2)
    assert decode(params, whole, quantised).shape == motion.shape


def test_codes_of_the_parts_stand_side_by_side(params, tiny):
    z = encode(params, tiny, motion_of(tiny))
    quantised, codes = quantise(params, tiny, z)
    for k, part in enumerate(tiny.parts):
        own = jax.jit(quantiser.quantise)(vqvae.book(params[part]), z[:, 6 * k : 6 * k + 6])
        np.testing.assert_array_equal(codes[:, 2 * k : 2 * k + 2], own.codes)
        np.testing.assert_array_equal(quantised[:, 6 * k : 6 * k + 6], own.vectors)


def test_losses_of_the_motion_reach_latents_through_the_codes(params, tiny):
    def far(z):
        quantised, _ = vqvae.quantise(params, tiny, z)
        return jnp.square(vqvae.decode(params, tiny, quantised)).sum()

    z = encode(params, tiny, motion_of(tiny))
    slope = jax.jit(jax.grad(far))(z)
    assert np.isfinite(slope).all()
    assert (np.abs(np.asarray(slope)).max(axis=0) > 0).all()


def test_decoding_keeps_the_order_of_columns(params, tiny, body):
    """Each part's decoder writes the columns that its encoder reads: with biases told apart, they land in place."""
    marked = jax.tree.map(lambda x: x * 0, params)
    columns = body_parts.columns(body, tiny.parts)
    for part, own in zip(tiny.parts, columns, strict=True):
        marked[part]["columns"] = params[part]["columns"]
        marked[part]["decoder"]["out"]["bias"] = jnp.asarray(own, jnp.float32)
    made = decode(marked, tiny, jnp.zeros((12, tiny.latent_size)))
    np.testing.assert_array_equal(made, np.tile(np.arange(tiny.motion_size), (48, 1)))


def test_a_body_of_other_joints_is_refused(tiny, body):
    with pytest.raises(ValueError, match="has 13 joints and the config 75"):
        vqvae.init(jax.random.key(0), dataclasses.replace(tiny, joints=75), body)


def test_the_scale_of_latents_makes_them_unit(params, tiny):
    z = encode(params, tiny, motion_of(tiny, 120)).at[:, 3].set(2.0)
    fitted = vqvae.latent_scale(z)
    scaled = np.asarray(scale.apply(fitted, z))
    np.testing.assert_allclose(scaled.mean(axis=0), 0.0, atol=1e-3)
    np.testing.assert_allclose(np.delete(scaled.std(axis=0), 3), 1.0, rtol=1e-3)
    assert np.abs(scaled[:, 3]).max() < 1e-2  # a channel that never changes is not blown up
