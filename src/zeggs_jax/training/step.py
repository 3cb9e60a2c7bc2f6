"""One update of any network: the state, the gradient over a batch at once or in parts, the optimiser, the average.

The state is all there is: batch k and the random keys of update k follow from k and the seed, so a run that
is stopped and resumed gives the same numbers as one that is not.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int

Metrics = dict[str, Float[Array, ""]]
LossFn = Callable[..., tuple[Array, Metrics]]
"""(params, batch, a key for each clip, step) -> mean over the clips of the loss and of its terms."""
Step = Callable[["TrainState", Any], tuple["TrainState", Metrics]]


class TrainState(NamedTuple):
    """All that an update reads and changes; `step` counts the updates done."""

    step: Int[Array, ""]
    params: Any
    opt_state: Any
    average: Any = None  # the moving average of params, if one is kept


def begin(params: Any, optimiser: optax.GradientTransformation, averaged: bool = False) -> TrainState:
    """The state before the first update."""
    average = jax.tree.map(jnp.array, params) if averaged else None
    return TrainState(jnp.zeros((), jnp.int32), params, optimiser.init(params), average)


def trained(state: TrainState) -> Any:
    """The parameters to use: their average where one is kept."""
    return state.params if state.average is None else state.average


def make_step(
    loss_fn: LossFn,
    optimiser: optax.GradientTransformation,
    seed: int,
    accumulate: int = 1,
    ema: float | None = None,
    frozen: Any = None,
) -> Step:
    """One update, jitted; the state that it is given is consumed (donated).

    Where `frozen` (a pytree of arrays, such as the parameters of networks that are not trained) is given, `loss_fn` is
    handed it as a last argument: an argument of the compiled update, not a constant in it.

    `accumulate` works through the batch in so many equal parts, one after the other: the keys of the clips and the
    mean are the same, so the update is the same up to rounding, with the memory of one part. `ema` is the decay of the
    average, which is (1 + k) / (10 + k) in update k while that is lower: the start counts little.
    """

    def step(state: TrainState, batch: Any, *fixed: Any) -> tuple[TrainState, Metrics]:
        clips = len(jax.tree.leaves(batch)[0])
        keys = jax.random.split(jax.random.fold_in(jax.random.key(seed), state.step), clips)
        gradient = jax.value_and_grad(loss_fn, has_aux=True)
        (loss, terms), grads = mean_over_parts(
            lambda part: gradient(state.params, *part, state.step, *fixed), (batch, keys), accumulate
        )
        updates, opt_state = optimiser.update(grads, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        average = state.average
        if ema is not None:
            decay = jnp.minimum(ema, (1.0 + state.step) / (10.0 + state.step))
            average = jax.tree.map(lambda a, p: a + (1.0 - decay) * (p - a), average, params)
        metrics = {"loss": loss, **terms, "gradient": optax.tree.norm(grads)}
        return TrainState(state.step + 1, params, opt_state, average), metrics

    jitted = jax.jit(step, donate_argnums=0)
    return jitted if frozen is None else lambda state, batch: jitted(state, batch, frozen)


def mean_over_parts(work: Callable[[Any], Any], rows: Any, parts: int) -> Any:
    """The mean of `work` over `parts` equal parts of `rows` (pytree, one row of each leaf per clip), one by one.

    Part i is rows i, i + parts, ...: rows that lie on different devices are in every part.
    """
    if parts == 1:
        return work(rows)
    cut = jax.tree.map(lambda leaf: jnp.moveaxis(leaf.reshape(-1, parts, *leaf.shape[1:]), 1, 0), rows)
    zeros = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(work, jax.tree.map(lambda a: a[0], cut)))

    def add(total: Any, part: Any) -> tuple[Any, None]:
        return jax.tree.map(jnp.add, total, work(part)), None

    total, _ = jax.lax.scan(add, zeros, cut)
    return jax.tree.map(lambda a: a / parts, total)
