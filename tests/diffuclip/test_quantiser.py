"""Codebooks: nearest by brute force, moving averages against numpy, revival, gradients straight through, residuals."""

import jax
import jax.numpy as jnp
import numpy as np

from zeggs_jax.diffuclip import quantiser
from zeggs_jax.diffuclip.quantiser import Book

RNG = np.random.default_rng(0)


def book(quantisers=3, codes=8, size=4):
    vectors = RNG.normal(size=(quantisers, codes, size)) * 0.5 ** np.arange(quantisers)[:, None, None]
    counts = RNG.uniform(2, 5, (quantisers, codes))
    made = (vectors, counts, vectors * counts[..., None])
    return Book(*(jnp.asarray(x, jnp.float32) for x in made))


def latents(count=40, size=4):
    return jnp.asarray(RNG.normal(size=(count, size)), jnp.float32)


def test_the_nearest_entry_is_that_of_brute_force():
    entries, z = book().vectors[0], latents()
    apart = np.linalg.norm(np.asarray(z)[:, None] - np.asarray(entries)[None], axis=-1)
    np.testing.assert_array_equal(quantiser.nearest(entries, z), apart.argmin(axis=1))


def test_each_book_codes_what_those_before_left_over():
    own, z = book(), latents()
    made = quantiser.quantise(own, z)
    left = np.asarray(z, np.float64)
    for q, entries in enumerate(np.asarray(own.vectors, np.float64)):
        index = np.linalg.norm(left[:, None] - entries[None], axis=-1).argmin(axis=1)
        np.testing.assert_array_equal(made.codes[:, q], index)
        left = left - entries[index]
    np.testing.assert_allclose(made.vectors, np.asarray(z) - left, atol=1e-5)
    np.testing.assert_allclose(quantiser.lookup(own, made.codes), made.vectors, atol=1e-5)


def test_an_entry_is_its_own_code():
    own = book(quantisers=1)
    made = quantiser.quantise(own, own.vectors[0])
    np.testing.assert_array_equal(made.codes[:, 0], np.arange(8))
    np.testing.assert_allclose(made.vectors, own.vectors[0], atol=1e-6)
    np.testing.assert_allclose(made.commit, 0.0, atol=1e-10)


def test_the_gradient_goes_straight_through_and_entries_get_none():
    own, z = book(), latents()
    weights = latents()
    to_z, to_book = jax.grad(lambda z, b: (quantiser.quantise(b, z).vectors * weights).sum(), argnums=(0, 1))(z, own)
    np.testing.assert_allclose(to_z, weights, atol=1e-6)
    assert not any(np.any(leaf) for leaf in jax.tree.leaves(to_book))


def test_commitment_draws_latents_to_their_codes():
    """Mean over the books of the square distance, by numpy; one small step down its gradient makes it less."""
    own, z = book(), latents()
    codes = np.asarray(quantiser.quantise(own, z).codes)
    so_far, apart = np.zeros(z.shape), []
    for q in range(3):
        so_far = so_far + np.asarray(own.vectors)[q][codes[:, q]]
        apart.append(np.square(np.asarray(z) - so_far).mean())
    commit, slope = jax.value_and_grad(lambda z: quantiser.quantise(own, z).commit)(z)
    np.testing.assert_allclose(commit, np.mean(apart), rtol=1e-5)
    assert quantiser.quantise(own, z - 0.5 * slope).commit < commit


def test_the_moving_average_is_that_of_numpy():
    own, z, decay = book(), latents(), 0.9
    made = quantiser.update(own, z, jax.random.key(0), decay, 0.0)
    left = np.asarray(z, np.float64)
    for q in range(3):
        entries, counts, sums = (np.array(x[q], np.float64) for x in own)
        index = np.linalg.norm(left[:, None] - entries[None], axis=-1).argmin(axis=1)
        for k in range(len(entries)):
            counts[k] = decay * counts[k] + (1 - decay) * (index == k).sum()
            sums[k] = decay * sums[k] + (1 - decay) * left[index == k].sum(axis=0)
        np.testing.assert_allclose(made.counts[q], counts, rtol=1e-5)
        np.testing.assert_allclose(made.vectors[q], sums / counts[:, None], rtol=1e-4, atol=1e-5)
        left = left - entries[index]


def test_an_unused_entry_is_drawn_from_the_batch_and_gets_time():
    own, z = book(quantisers=1), latents()
    dead = own._replace(
        vectors=own.vectors.at[0, 3].set(1e3), counts=own.counts.at[0, 3].set(0.4), sums=own.sums.at[0, 3].set(4e2)
    )
    made = quantiser.update(dead, z, jax.random.key(1), 0.99, 0.5)
    assert np.abs(np.asarray(z) - np.asarray(made.vectors)[0, 3]).sum(axis=1).min() < 1e-5
    assert np.abs(np.asarray(made.vectors)[0, [0, 1, 2, 4, 5, 6, 7]]).max() < 5  # the others follow as before
    again = quantiser.update(made, z, jax.random.key(2), 0.99, 0.5)
    np.testing.assert_allclose(again.vectors[0, 3], made.vectors[0, 3], atol=0.5)  # not drawn again


def test_books_begin_with_their_first_batch():
    made = quantiser.update(quantiser.init(2, 8, 4), latents(), jax.random.key(0), 0.99, 1.0)
    assert len(np.unique(np.asarray(made.vectors[0]), axis=0)) > 4
    assert np.isfinite(made.vectors).all()


def test_perplexity_counts_codes_that_are_used_alike():
    codes = jnp.asarray(np.stack([np.arange(40) % 8, np.zeros(40, int), np.arange(40) % 2], axis=1))
    spread, used = quantiser.perplexity(codes, 16)
    np.testing.assert_allclose(spread, [8, 1, 2], rtol=1e-5)
    np.testing.assert_array_equal(used, [8, 1, 2])
