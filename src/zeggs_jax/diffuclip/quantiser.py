"""Sec. 4: vectors to the nearest entries of codebooks that follow them by moving averages, one after another (RVQ)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


class Book(NamedTuple):
    """Q residual codebooks of K entries each: book q + 1 codes what book q left over."""

    vectors: Float[Array, "Q K C"]
    counts: Float[Array, "Q K"]  # moving count of the latents of a batch that chose the entry
    sums: Float[Array, "Q K C"]  # moving sum of these latents (of what was left of them)


class Quantised(NamedTuple):
    """L latents by their codes."""

    vectors: Float[Array, "L C"]  # sums of entries; their gradient goes straight through to the latents
    codes: Int[Array, "L Q"]
    commit: Float[Array, ""]  # mean square distance of the latents to what is coded so far, over the books


def init(quantisers: int, codes: int, size: int) -> Book:
    """Books without users: the first update draws all entries from its batch."""
    return Book(
        jnp.zeros((quantisers, codes, size)), jnp.zeros((quantisers, codes)), jnp.zeros((quantisers, codes, size))
    )


def nearest(entries: Float[Array, "K C"], z: Float[Array, "L C"]) -> Int[Array, " L"]:
    """Index of the entry at the least distance to each latent; of equal ones the first."""
    product = z @ entries.T
    return jnp.argmin(jnp.broadcast_to(jnp.square(entries).sum(-1), product.shape) - 2.0 * product, axis=-1)


def assign(book: Book, z: Float[Array, "L C"]) -> tuple[Int[Array, "Q L"], Float[Array, "Q L C"], Float[Array, "L C"]]:
    """Codes of all books, what each was given to code, and what is left at last."""

    def code(left: Array, entries: Array) -> tuple[Array, tuple[Array, Array]]:
        index = nearest(entries, left)
        return left - entries[index], (index, left)

    left, (codes, given) = jax.lax.scan(code, z, book.vectors)
    return codes, given, left


def quantise(book: Book, z: Float[Array, "L C"]) -> Quantised:
    """Latents as sums of one entry of each book; entries get no gradient, they follow by `update`."""
    codes, given, left = assign(book, jax.lax.stop_gradient(z))
    before = jnp.concatenate([given[1:], left[None]])  # after book q: what z differs by from its code so far
    coded = jax.lax.stop_gradient(z)[None] - before
    commit = jnp.square(z[None] - coded).mean()
    return Quantised(z + jax.lax.stop_gradient(coded[-1] - z), codes.T, commit)


def lookup(book: Book, codes: Int[Array, "L Q"]) -> Float[Array, "L C"]:
    """The latents that codes stand for."""
    return jnp.take_along_axis(book.vectors, codes.T[..., None], axis=1).sum(axis=0)


def update(book: Book, z: Float[Array, "N C"], key: Array, decay: float, revive: float) -> Book:
    """The books after a batch: entries move to the moving mean of the latents that chose them.

    Entries that fewer than `revive` latents choose in a batch (as a moving count) are drawn anew from what their
    book was given to code, and count as chosen as often as the average one, so that they have time to be found.
    """
    codes, given, _ = assign(book, z)
    return jax.vmap(_follow, in_axes=(0, 0, 0, 0, None, None))(
        book, codes, given, jax.random.split(key, len(book.vectors)), decay, revive
    )


def _follow(
    book: Book, codes: Int[Array, " N"], given: Float[Array, "N C"], key: Array, decay: float, revive: float
) -> Book:
    """One book."""
    entries = book.vectors.shape[0]
    chosen = jax.nn.one_hot(codes, entries)
    counts = decay * book.counts + (1.0 - decay) * chosen.sum(axis=0)
    sums = decay * book.sums + (1.0 - decay) * (chosen.T @ given)
    dead = counts < revive
    drawn = given[jax.random.randint(key, (entries,), 0, len(given))]
    average = max(len(given) / entries, revive)
    counts = jnp.where(dead, average, counts)
    sums = jnp.where(dead[:, None], average * drawn, sums)
    return Book(sums / counts[:, None], counts, sums)


def perplexity(codes: Int[Array, "N Q"], entries: int) -> tuple[Float[Array, " Q"], Int[Array, " Q"]]:
    """Of each book: exp of the entropy (nats) of its codes' shares, and how many of its entries occur."""
    chosen = jax.vmap(lambda index: jnp.bincount(index, length=entries))(codes.T)
    shares = chosen / jnp.maximum(chosen.sum(axis=-1, keepdims=True), 1)
    entropy = -jnp.where(shares > 0, shares * jnp.log(jnp.where(shares > 0, shares, 1.0)), 0.0).sum(axis=-1)
    return jnp.exp(entropy), (chosen > 0).sum(axis=-1)
