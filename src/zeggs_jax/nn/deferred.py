"""A scan whose weight gradients are formed after the reverse pass, each as one product over all frames and clips.

Plain autodiff of a scan adds to every weight's gradient at every frame: as many passes over all weights as there
are frames. Here the reverse pass emits the cotangents of the frames' products W x + b, and the gradients follow as
dW = sum_t d_t x_t^T, which is one large product; under `jax.vmap` it runs over the clips as well.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .compute import PLAIN, Compute, precision

INPUTS = "inputs"  # the collection in which the layers leave x, under the name of the weight that multiplies it

Step = Callable[[Any, Any, Any], tuple[Any, Any, Any]]  # params, carry, x -> carry, y, inputs of the products


def scan(step: Step, params: Any, carry: Any, xs: Any, compute: Compute = PLAIN) -> tuple[Any, Any]:
    """`jax.lax.scan` of `step` over the leading axis of `xs`: the last carry and all y; same values, same gradients.

    `params` hold only products: a leaf 'weight...' has a leaf 'bias...' beside it, and `step` gives the vector that
    it was multiplied with under the weight's name. The reverse pass reads the products of the forward pass and computes
    what follows from them again; with `compute.remat` the products too. What `step` closes over
    is constant: a gradient of it raises in JAX. Not for forward-mode differentiation.
    """
    weights, biases = _leaves(params, "weight"), _leaves(params, "bias")
    frames = jax.tree.leaves(xs)[0].shape[0]
    repeated = {place: jnp.broadcast_to(bias, (frames, *bias.shape)) for place, bias in biases.items()}
    held = jax.lax.stop_gradient(weights)
    keep = None if compute.remat else jax.checkpoint_policies.dots_saveable

    def run(carry: Any, xs: Any, repeated: Any) -> tuple[Any, Any]:
        def body(carry: Any, given: tuple[Any, Any]) -> tuple[Any, Any]:
            x, bias = given
            carry, y, inputs = step(_with(params, held, bias), carry, x)
            return carry, (y, _leaves(inputs, "weight"))

        carry, (ys, inputs) = jax.lax.scan(jax.checkpoint(body, policy=keep, prevent_cse=False), carry, (xs, repeated))
        return (carry, ys), inputs

    outputs, pull, inputs = jax.vjp(run, *jax.lax.stop_gradient((carry, xs, repeated)), has_aux=True)
    inputs = jax.lax.stop_gradient(inputs)
    products = {place: product(weights[place], biases[place], inputs[place], compute) for place in weights}
    return attach(outputs, pull, carry, xs, products)


@jax.custom_vjp
def attach(outputs: Any, pull: Any, *sources: Any) -> Any:
    """`outputs`, with the gradients of `sources` that `pull(cotangents)` gives, a tuple of them.

    Products among the sources pass theirs on to the weights that they were made of, and are themselves never computed.
    """
    del pull, sources
    return outputs


def _attach_fwd(outputs: Any, pull: Any, *sources: Any) -> tuple[Any, Any]:
    del sources
    return outputs, pull


def _attach_bwd(pull: Any, cotangents: Any) -> tuple[Any, ...]:
    return (cotangents, None, *pull(cotangents))


attach.defvjp(_attach_fwd, _attach_bwd)


def product(
    weight: Float[Array, "out in"], bias: Float[Array, " out"], x: Float[Array, "T in"], compute: Compute
) -> Float[Array, "T out"]:
    """W x + b of all frames, x as it is multiplied."""
    made = jnp.tensordot(x, weight, axes=((-1,), (1,)), precision=precision(compute.matmul))
    return made + jnp.broadcast_to(bias, made.shape)


def _leaves(tree: Any, kind: str) -> dict[str, Any]:
    """The leaves whose own name starts with `kind`, by their path without this start: 'gru/layer0/_ih'."""
    found = {}
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        *parents, name = (str(key.key) for key in path)
        if name.startswith(kind):
            found["/".join([*parents, name.removeprefix(kind)])] = leaf
    return found


def _with(params: Any, weights: dict[str, Any], biases: dict[str, Any]) -> Any:
    """`params` with other leaves."""
    leaves = {"weight": weights, "bias": biases}

    def leaf(path: Any, _: Any) -> Any:
        *parents, name = (str(key.key) for key in path)
        kind = "weight" if name.startswith("weight") else "bias"
        return leaves[kind]["/".join([*parents, name.removeprefix(kind)])]

    return jax.tree_util.tree_map_with_path(leaf, params)
