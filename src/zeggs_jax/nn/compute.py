"""How the networks compute: the precision of their products, memory against time, all clips at once or one by one."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

Matmul = Literal["float32", "bfloat16"]


class Compute(NamedTuple):
    """What changes how a result is computed, but not what is computed; nothing of it belongs to the parameters.

    With "bfloat16" the operands of every matrix product and convolution, but for the decoder's weight gradients, are
    rounded to bfloat16, and the products summed and kept in float32; state, losses and optimiser stay in float32. It
    pays where the processor multiplies bfloat16: GPUs, and CPUs with instructions for it; on others it costs time.
    """

    matmul: Matmul = "float32"
    remat: bool = False  # the backward pass computes each frame of the decoder again: less memory, more time


PLAIN = Compute()


@jax.custom_jvp
def _rounded(x: Float[ArrayLike, "*b"]) -> Float[Array, "*b"]:
    return jax.lax.reduce_precision(x, exponent_bits=8, mantissa_bits=7)


@_rounded.defjvp
def _rounded_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return _rounded(*primals), tangents[0]


def operand(x: Float[ArrayLike, "*b"], matmul: Matmul) -> Float[Array, "*b"]:
    """An operand of a product, with bfloat16's 8 digits of mantissa if so wished; its gradient is not rounded."""
    return jnp.asarray(x) if matmul == "float32" else _rounded(x)


def operands(params: Any, matmul: Matmul) -> Any:
    """`params` with all matrices and kernels as operands: rounded once, not at every frame."""
    return jax.tree.map(lambda leaf: operand(leaf, matmul) if leaf.ndim > 1 else leaf, params)


def precision(matmul: Matmul) -> jax.lax.DotAlgorithmPreset | None:
    """What a product of operands is told, so that a GPU multiplies in bfloat16; None is the platform's default."""
    return None if matmul == "float32" else jax.lax.DotAlgorithmPreset.BF16_BF16_F32


def factors(params: Any, matmul: Matmul) -> Any:
    """`params` with all matrices in the type that they are multiplied in: bfloat16 is half the bytes to read."""
    small = matmul == "bfloat16"
    return jax.tree.map(lambda leaf: leaf.astype(jnp.bfloat16) if small and leaf.ndim > 1 else leaf, params)


def multiply(weight: Float[Array, "out in"], x: Float[Array, "in B"]) -> Float[Array, "out B"]:
    """`weight @ x` in the weight's type (`factors`), summed in x's; not to be differentiated."""
    return jax.lax.dot(weight, x.astype(weight.dtype), preferred_element_type=x.dtype)


def each(function: Callable[..., Any], *clips: Any) -> Any:
    """`jax.vmap(function)(*clips)`, on a CPU one clip after the other, and computed again in the backward pass.

    For element-wise work with many intermediate arrays, no products: those of one clip stay in the processor's cache.
    Clips that lie on several devices are never taken apart.
    """
    if jax.default_backend() == "cpu" and jax.device_count() == 1:
        return jax.lax.map(jax.checkpoint(lambda clip: function(*clip)), clips)
    return jax.vmap(function)(*clips)
