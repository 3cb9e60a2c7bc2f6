"""A function as its operations one after another: what converters to other formats read best.

They stumble on functions within the function, on loops of one turn and on pieces of no size; and what a function within
is given and does not use need not be written down.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
from jax.extend import core
from jaxtyping import Array

INNER = {"jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "custom_jvp_call": "call_jaxpr"}


def straightened(function: Callable[..., Sequence[Array]], *example: Any) -> Callable[..., tuple[Array, ...]]:
    """The function for arguments of these shapes and types, with nothing but plain operations in it.

    Loops of several turns and branches stay as they are.
    """
    closed = jax.make_jaxpr(lambda *given: tuple(function(*given)))(*example)
    return lambda *given: tuple(_run(closed, given))


def _run(closed: Any, given: Sequence[Any]) -> list[Any]:
    """What the operations of a jaxpr make of its arguments."""
    jaxpr, known = closed.jaxpr, {}

    def write(names: Sequence[Any], values: Sequence[Any]) -> None:
        known.update(zip(names, values, strict=True))

    def read(names: Sequence[Any]) -> list[Any]:
        return [one.val if isinstance(one, core.Literal) else known[one] for one in names]

    write(jaxpr.constvars, closed.consts)
    write(jaxpr.invars, given)
    for equation in jaxpr.eqns:
        write(equation.outvars, _made(equation, read(equation.invars)))
    return read(jaxpr.outvars)


def _made(equation: Any, given: list[Any]) -> list[Any]:
    name, told = equation.primitive.name, equation.params
    if name in INNER:
        return _run(told[INNER[name]], given)
    if name == "scan" and told["length"] == 1:
        kept, carried = told["num_consts"] + told["num_carry"], told["num_carry"]
        made = _run(told["jaxpr"], [*given[:kept], *(jax.lax.squeeze(x, (0,)) for x in given[kept:])])
        return [*made[:carried], *(jax.lax.expand_dims(x, (0,)) for x in made[carried:])]
    if name == "concatenate":
        return [jax.lax.concatenate([x for x in given if x.size] or given[:1], told["dimension"])]
    made = equation.primitive.bind(*given, **told)
    return list(made) if equation.primitive.multiple_results else [made]
