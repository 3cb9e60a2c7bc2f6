"""The layers of both papers in PyTorch's parameters: dense, convolution over frames, GRU cell, layer norm.

Weights keep PyTorch's layouts, (out, in) and (out, in, kernel), its two GRU biases and its initialisers, so
that converting a release's weights is pure renaming and training starts from the same distribution. All is
written for one clip: an array is a vector [C] or a sequence [T, C]; batches come from `jax.vmap`. With `matmul`
"bfloat16" the layers round what they multiply; the weights come rounded (`compute.operands`).
"""

import math
from typing import Literal

import jax
import jax.numpy as jnp
from flax import linen as nn
from flax.linen.initializers import Initializer
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .compute import Matmul, operand, precision
from .deferred import INPUTS


def uniform(bound: float) -> Initializer:
    """U(-bound, bound)."""

    def draw(key: Array, shape: tuple[int, ...], dtype=jnp.float32) -> Array:
        return jax.random.uniform(key, shape, dtype, -bound, bound)

    return draw


def torch_bound(fan_in: int) -> float:
    """Bound of PyTorch's default draw of a layer's weight and bias: 1 / sqrt(fan_in)."""
    return 1.0 / math.sqrt(fan_in)


def xavier_bound(gain: float, fan_in: int, fan_out: int) -> float:
    """Bound of PyTorch's xavier_uniform_: gain * sqrt(6 / (fan_in + fan_out)); fans include the kernel."""
    return gain * math.sqrt(6.0 / (fan_in + fan_out))


def multiply(
    layer: nn.Module, name: str, weight: Float[ArrayLike, "out in"], x: Float[Array, " in"], matmul: Matmul
) -> Float[Array, " out"]:
    """`weight @ x`, leaving x where a scan with deferred weight gradients looks for it (`nn.deferred`)."""
    x = operand(x, matmul)
    layer.sow(INPUTS, name, x, init_fn=lambda: x, reduce_fn=lambda _, new: new)
    return jnp.matmul(weight, x, precision=precision(matmul))


class Dense(nn.Module):
    """y = W x + b, weight (features, in); `gain` draws W by Xavier, else by PyTorch's default.

    A vector is multiplied as `W @ x`: inside a scan, `x @ W.T` makes XLA copy every weight at every frame.
    """

    features: int
    gain: float | None = None
    zero_bias: bool = False
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(self, x: Float[Array, "*T in"]) -> Float[Array, "*T out"]:
        fan_in = x.shape[-1]
        bound = torch_bound(fan_in)
        weight_bound = bound if self.gain is None else xavier_bound(self.gain, fan_in, self.features)
        weight = self.param("weight", uniform(weight_bound), (self.features, fan_in))
        bias = self.param("bias", uniform(0.0 if self.zero_bias else bound), (self.features,))
        if x.ndim == 1:
            return multiply(self, "weight", weight, x, self.matmul) + bias
        product = jnp.tensordot(operand(x, self.matmul), weight, axes=((-1,), (1,)), precision=precision(self.matmul))
        return product + jnp.broadcast_to(bias, product.shape)


class Conv(nn.Module):
    """Convolution over frames that keeps their number; weight (features, in, kernel), kernel odd.

    `padding` says what stands beyond both ends: zeros, or nothing, which gives kernel - 1 frames less.
    """

    features: int
    kernel: int
    padding: Literal["zero", "none"] = "zero"
    gain: float | None = None
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(self, x: Float[Array, "T in"]) -> Float[Array, "N out"]:
        fan_in = x.shape[-1] * self.kernel
        bound = torch_bound(fan_in)
        fan_out = self.features * self.kernel
        weight_bound = bound if self.gain is None else xavier_bound(self.gain, fan_in, fan_out)
        weight = self.param("weight", uniform(weight_bound), (self.features, x.shape[-1], self.kernel))
        bias = self.param("bias", uniform(bound), (self.features,))
        half = 0 if self.padding == "none" else self.kernel // 2
        padded = jnp.pad(x, ((half, half), (0, 0)))
        product = jax.lax.conv_general_dilated(
            operand(padded, self.matmul)[None],
            weight,
            window_strides=(1,),
            padding="VALID",
            dimension_numbers=("NWC", "OIW", "NWC"),
        )[0]
        return product + jnp.broadcast_to(bias, product.shape)


class Dropout(nn.Module):
    """Zeros a share `rate` of the entries in training and scales up the others; with the stream 'dropout' of keys.

    Two entries share a word of random bits: drawing those is most of what dropout costs on a CPU.
    """

    rate: float
    deterministic: bool

    @nn.compact
    def __call__(self, x: Float[Array, "*b"]) -> Float[Array, "*b"]:
        dropped = round(self.rate * 2**16)  # of so many values of the bits
        if self.deterministic or not dropped:
            return x
        words = jax.random.bits(self.make_rng("dropout"), (-(-x.size // 2),), jnp.uint32)
        halves = jax.lax.bitcast_convert_type(words, jnp.uint16).ravel()[: x.size]
        return jnp.where(halves.reshape(x.shape) >= dropped, x * (2**16 / (2**16 - dropped)), 0.0)


class GRUCell(nn.Module):
    """One step of PyTorch's GRU: gates stacked reset, update, new; the hidden bias of `new` inside the reset.

    r = sigmoid(W_ir x + b_ir + W_hr h + b_hr), z likewise, n = tanh(W_in x + b_in + r * (W_hn h + b_hn)),
    h' = (1 - z) n + z h. Both biases are kept: merged, they would train at half the step of PyTorch's.
    """

    features: int
    matmul: Matmul = "float32"

    @nn.compact
    def __call__(self, x: Float[Array, " in"], hidden: Float[Array, " H"]) -> Float[Array, " H"]:
        draw = uniform(torch_bound(self.features))
        weight_ih = self.param("weight_ih", draw, (3 * self.features, x.shape[-1]))
        weight_hh = self.param("weight_hh", draw, (3 * self.features, self.features))
        bias_ih = self.param("bias_ih", draw, (3 * self.features,))
        bias_hh = self.param("bias_hh", draw, (3 * self.features,))
        reset_x, update_x, new_x = jnp.split(multiply(self, "weight_ih", weight_ih, x, self.matmul) + bias_ih, 3)
        reset_h, update_h, new_h = jnp.split(multiply(self, "weight_hh", weight_hh, hidden, self.matmul) + bias_hh, 3)
        reset = jax.nn.sigmoid(reset_x + reset_h)
        update = jax.nn.sigmoid(update_x + update_h)
        new = jnp.tanh(new_x + reset * new_h)
        return (1.0 - update) * new + update * hidden


class LayerNorm(nn.Module):
    """PyTorch's layer norm over channels: eps 1e-5, two-pass variance."""

    @nn.compact
    def __call__(self, x: Float[Array, "T C"]) -> Float[Array, "T C"]:
        weight = self.param("weight", nn.initializers.ones, x.shape[-1:])
        bias = self.param("bias", nn.initializers.zeros, x.shape[-1:])
        centred = x - x.mean(-1, keepdims=True)
        variance = jnp.square(centred).mean(-1, keepdims=True)
        normal = centred * jax.lax.rsqrt(variance + 1e-5)
        return normal * jnp.broadcast_to(weight, x.shape) + jnp.broadcast_to(bias, x.shape)
