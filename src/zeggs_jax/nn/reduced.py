"""Weights of fewer bytes for inference: bfloat16, or int8 with one scale per row; activations and sums stay float32.

A network that writes its products as `product(weight, x)` takes plain and reduced weights alike. What one clip costs is
reading the weights, so that halving or quartering their bytes does the same to its time, where the kernel of
`native` runs; elsewhere `with_precision` gives back float32 weights of the same values.
"""

from typing import Any, Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from . import native

Kind = Literal["bfloat16", "int8"]
Precision = Literal["float32", "bfloat16", "int8"]
SMALLEST = 1 << 16  # entries of a matrix that is worth reducing: others cost nothing, the root's few rows drift
MANY = 8  # columns from which a product is no longer bound by reading its weight


class Reduced(NamedTuple):
    """A matrix in fewer bytes: its entries are weight, or weight * scale; for inference only, it has no gradient."""

    weight: Array  # [N, K] bfloat16 or int8
    scale: Float[Array, " N"] | None  # of int8 only


def reduce(weight: Float[ArrayLike, "N K"], kind: Kind) -> Reduced:
    """Rounds to the nearest: within 2^-8 of every entry (bfloat16), or within 1/254 of its row's largest (int8).

    Raises:
        ValueError: no matrix, entries that are not finite, more columns than the kernel can sum, an unknown kind.
    """
    array = np.asarray(weight, np.float32)
    if array.ndim != 2 or not array.size or not np.isfinite(array).all():
        raise ValueError(f"a weight of shape {array.shape} cannot be reduced; give a finite matrix [N, K].")
    if array.shape[1] > native.MOST_COLUMNS:
        raise ValueError(
            f"a weight with {array.shape[1]} columns cannot be reduced; {native.MOST_COLUMNS} are the most."
        )
    if kind == "bfloat16":
        return Reduced(jnp.asarray(array.astype(jnp.bfloat16)), None)
    if kind != "int8":
        raise ValueError(f"weights of kind '{kind}' are unknown; choose {' or '.join(get_args(Kind))}.")
    scale = np.abs(array).max(axis=1, initial=0.0) / np.float32(127)
    steps = np.rint(array / np.where(scale > 0, scale, np.float32(1))[:, None])
    return Reduced(jnp.asarray(np.clip(steps, -127, 127).astype(np.int8)), jnp.asarray(scale))


def restore(weight: Array | Reduced) -> Float[Array, "N K"]:
    """The float32 matrix that a reduced one stands for."""
    if not isinstance(weight, Reduced):
        return weight
    plain = weight.weight.astype(jnp.float32)
    return plain if weight.scale is None else plain * weight.scale[:, None]


def with_precision(tree: Any, precision: Precision) -> Any:
    """`tree` with its large matrices reduced; where the kernel does not run (`native.problem`), rounded alike.

    Raises:
        ValueError: an unknown precision, or a matrix that cannot be reduced.
    """
    if precision not in get_args(Precision):
        raise ValueError(f"weights of precision '{precision}' are unknown; choose {', '.join(get_args(Precision))}.")

    def one(leaf: Any) -> Any:
        if precision == "float32" or jnp.ndim(leaf) != 2 or jnp.size(leaf) < SMALLEST:
            return leaf
        small = reduce(leaf, precision)
        return restore(small) if native.problem() else small

    return jax.tree.map(one, tree)


def notes(precision: Precision) -> tuple[str, ...]:
    """What is worth knowing before weights of this precision are used: that they bring no speed here, and why."""
    found = None if precision == "float32" else native.problem()
    return () if found is None else (found,)


def product(weight: Array | Reduced, x: Float[Array, "K B"]) -> Float[Array, "N B"]:
    """`weight @ x`; a reduced weight is read once for all columns.

    Of `MANY` columns and more the entries are rounded to bfloat16, where the processor multiplies that several times as
    fast.
    """
    if not isinstance(weight, Reduced):
        return weight @ x
    if native.problem():
        return _restored(*weight, x)
    if x.shape[1] >= MANY and native.multiplies_bfloat16():
        return _many(*weight, x)
    kernel = _rounded_product if weight.scale is None else _scaled_product
    return jax.lax.platform_dependent(*weight, x, cpu=kernel, default=_restored)


def _restored(weight: Array, scale: Array | None, x: Array) -> Array:
    return restore(Reduced(weight, scale)) @ x


def _many(weight: Array, scale: Array | None, x: Array) -> Array:
    """The bytes of int8 are bfloat16 numbers too, so that only x is rounded."""
    small = weight.astype(jnp.bfloat16), x.astype(jnp.bfloat16)
    plain = jax.lax.dot(*small, preferred_element_type=jnp.float32)
    return plain if scale is None else plain * scale[:, None]


def _rounded_product(weight: Array, scale: None, x: Array) -> Array:
    return native.call("bfloat16", weight, x)


def _scaled_product(weight: Array, scale: Array, x: Array) -> Array:
    return native.call("int8", weight, scale, x)
