"""A function written on columns, every array with the clips along its last axis, seen as a function of one clip.

A recurrent network reads all its weights at every frame. Over a batch its fastest form on a CPU is `W @ x` with x as
[features, clips]; `jax.vmap` alone would keep the clips in front and turn the arrays about at every frame. So the loop
is written once, on columns: one clip is one column, and `jax.vmap` hands over as many as there are clips.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap


def one(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """`function(shared, columns)` as a function of `shared` and of one clip: the same arrays without the last axis.

    What is `shared` (weights) has no axis of clips; where `jax.vmap` maps over it, every clip is a single column.
    Not to be differentiated: it belongs into both halves of a `jax.custom_vjp`.
    """

    @custom_vmap
    def single(shared: Any, clip: Any) -> Any:
        made = function(shared, jax.tree.map(lambda a: a[..., None], clip))
        return jax.tree.map(lambda a: a[..., 0], made)

    @partial(single.def_vmap)
    def _(clips: int, mapped: Any, shared: Any, clip: Any) -> tuple[Any, Any]:
        if any(jax.tree.leaves(mapped[0])):
            axes = jax.tree.map(lambda is_mapped: 0 if is_mapped else None, tuple(mapped))
            made = jax.vmap(single.fun, axes, axis_size=clips)(shared, clip)
        else:
            columns = jax.tree.map(partial(_last, clips), clip, mapped[1])
            made = jax.tree.map(lambda a: jnp.moveaxis(a, -1, 0), function(shared, columns))
        return made, jax.tree.map(lambda _: True, made)

    return single


def _last(clips: int, array: Any, is_mapped: bool) -> Any:
    return jnp.moveaxis(array, 0, -1) if is_mapped else jnp.broadcast_to(array[..., None], (*array.shape, clips))
