"""The decoder's training form: `decoder.rollout` with its reverse pass written out, a batch of clips as columns.

Autodiff of the recurrence keeps every intermediate of a frame, some of them three times. Here the forward pass keeps
what the products see and the gates of each GRU layer, the reverse pass walks back over them, and the gradients of the
weights follow afterwards, each as one product over all frames and clips (`nn.deferred`). Values and gradients are the
decoder's.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..data.scale import Scales
from ..motion import pose as poses
from ..motion.pose import Pose, Root
from ..nn import columns, deferred
from ..nn.compute import PLAIN, Compute, operand, operands, precision
from . import decoder
from .decoder import GAZE, DecoderConfig, Frame


class Course(NamedTuple):
    """What the recurrence is given: of one clip, or in the loops with the clips as a last axis, as below."""

    vector: Float[Array, "P *B"]  # the first pose, unscaled
    root: Root  # of the first pose: [3, *B] and [4, *B]
    hidden: tuple[Float[Array, "H *B"], ...]  # of every layer, before frame 1
    given: Float[Array, "T G *B"]  # speech and style of frames 1 to T
    target: Float[Array | np.ndarray, "T 3 *B"]  # cm, world


class Made(NamedTuple):
    """Frames 1 to T: the pose vectors, unscaled, and the roots."""

    vector: Float[Array, "T P *B"]
    root: Root  # [T, 3, *B] and [T, 4, *B]


class Gates(NamedTuple):
    """Of one GRU layer and all frames."""

    reset: Float[Array, "T H *B"]
    update: Float[Array, "T H *B"]
    new: Float[Array, "T H *B"]
    inner: Float[Array, "T H *B"]  # what the hidden state adds to `new`, before the reset


class Kept(NamedTuple):
    """What the products of the frames saw, and what the derivatives need besides."""

    inputs: Float[Array, "T I *B"]  # the first dense layer; observation, speech and style
    hidden: tuple[Float[Array, "T H *B"], ...]  # of every layer, after the frame
    gates: tuple[Gates, ...]  # of every layer


class Units(NamedTuple):
    """The decoder's scales as columns."""

    seen_mean: Float[Array, "O 1"]
    seen_std: Float[Array, "O 1"]
    out_mean: Float[Array, "P 1"]
    out_std: Float[Array, "P 1"]
    frame_time: Float[Array, ""]  # s


class Shared(NamedTuple):
    """What all clips have in common."""

    weights: Any  # of the decoder's recurrent part
    units: Units


def fits(config: DecoderConfig, compute: Compute = PLAIN) -> bool:
    """Whether there is a training form: not of FiLM, nor where the frames are to be computed again."""
    return config.conditioning == "normal" and not compute.remat


def rollout(
    params: Any,
    config: DecoderConfig,
    scales: Scales,
    first: Pose,
    given: Frame,
    frame_time: ArrayLike,
    compute: Compute = PLAIN,
) -> Pose:
    """As `decoder.rollout`, which it is where there is no training form; scales and frame time have no gradients."""
    if not fits(config, compute):
        return decoder.rollout(params, config, scales, first, given, frame_time, compute)
    params = operands(params, compute.matmul)
    state = decoder.begin(params, config, scales, first, jax.tree.map(lambda a: a[0], given), compute.matmul)
    heard = jnp.concatenate([given.speech, given.style], axis=-1)[1:]
    course = Course(poses.to_vector(first), first.root, tuple(state.hidden), heard, given.target[1:])
    made = _recur(Shared(params["recurrent"], _units(scales, frame_time)), course, config, compute)
    rest = poses.from_vector(made.vector, made.root)
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, rest)


def _units(scales: Scales, frame_time: ArrayLike) -> Units:
    pairs = ((s.mean, jnp.broadcast_to(s.std, jnp.shape(s.mean))) for s in (scales.pose_in, scales.pose_out))
    seen_mean, seen_std, out_mean, out_std = (jnp.asarray(a)[:, None] for pair in pairs for a in pair)
    return Units(seen_mean, seen_std, out_mean, out_std, jnp.asarray(frame_time))


def _recur(shared: Shared, course: Course, config: DecoderConfig, compute: Compute) -> Made:
    """The frames of one clip, with the gradients of the weights and of what it is given."""
    fixed, held = jax.lax.stop_gradient((shared, course))
    made, kept = columns.one(partial(_forward, config, compute))(fixed, held)
    backward = columns.one(partial(_backward, config, compute))
    pull = jax.tree_util.Partial(
        lambda fixed, record, slopes: backward(fixed, (*record, slopes)), fixed, (held, made, kept)
    )
    return deferred.attach(made, pull, course, _products(shared.weights, held, kept, compute))


def _forward(config: DecoderConfig, compute: Compute, shared: Shared, course: Course) -> tuple[Made, Kept]:
    """The loop over the frames, on columns."""
    weights, units = shared

    def frame(carry: Any, given: Any) -> tuple[Any, Any]:
        vector, root, hidden = carry
        seen = (jnp.concatenate([vector, _gaze(root, given[1])]) - units.seen_mean) / units.seen_std
        if not config.facing:
            seen = seen.at[-GAZE:].set(0.0)
        seen = jnp.concatenate([seen, given[0]])
        inputs = jnp.concatenate([jax.nn.elu(_affine(weights["dense_in"], "", seen, compute)), seen])
        after, gates, below = [], [], inputs
        for layer, before in enumerate(hidden):
            below, opened = _cell(weights["gru"][f"layer{layer}"], below, before, compute)
            after.append(below)
            gates.append(opened)
        vector = _affine(weights["dense_out"], "", below, compute) * units.out_std + units.out_mean
        root = _moved(root, vector[:6], units.frame_time)
        return (vector, root, tuple(after)), (Made(vector, root), Kept(inputs, tuple(after), tuple(gates)))

    start = course.vector, course.root, course.hidden
    return jax.lax.scan(frame, start, (course.given, course.target), unroll=compute.unroll)[1]


def _cell(weights: Any, below: Array, hidden: Array, compute: Compute) -> tuple[Array, Gates]:
    """`nn.layers.GRUCell` on columns."""
    reset_x, update_x, new_x = jnp.split(_affine(weights, "_ih", below, compute), 3)
    reset_h, update_h, inner = jnp.split(_affine(weights, "_hh", hidden, compute), 3)
    reset, update = jax.nn.sigmoid(reset_x + reset_h), jax.nn.sigmoid(update_x + update_h)
    new = jnp.tanh(new_x + reset * inner)
    return (1.0 - update) * new + update * hidden, Gates(reset, update, new, inner)


def _affine(layer: Any, which: str, x: Float[Array, "in B"], compute: Compute) -> Float[Array, "out B"]:
    product = jnp.matmul(layer[f"weight{which}"], operand(x, compute.matmul), precision=precision(compute.matmul))
    return product + layer[f"bias{which}"][:, None]


def _gaze(root: Root, target: Float[Array, "3 B"]) -> Float[Array, "3 B"]:
    return poses.gaze_direction(Root(root.pos.T, root.rot.T), target.T).T


def _moved(root: Root, velocities: Float[Array, "6 B"], frame_time: ArrayLike) -> Root:
    vel, ang = velocities[:3].T, velocities[3:].T
    moved = poses.integrate(Root(root.pos.T, root.rot.T), vel, ang, frame_time)
    return Root(moved.pos.T, moved.rot.T)


def _products(weights: Any, course: Course, kept: Kept, compute: Compute) -> dict[str, Array]:
    """All frames' products of one clip, of which only the gradients are used; the cotangents are `_backward`'s."""

    def times(layer: Any, which: str, x: Array, rows: slice = slice(None)) -> Array:
        seen = operand(x, compute.matmul)
        return deferred.product(layer[f"weight{which}"][rows], layer[f"bias{which}"][rows], seen, compute)

    width, below = course.hidden[0].shape[0], kept.inputs
    made = {"dense_in": times(weights["dense_in"], "", below[:, width:])}
    for layer, (after, first) in enumerate(zip(kept.hidden, course.hidden, strict=True)):
        cell, before = weights["gru"][f"layer{layer}"], jnp.concatenate([first[None], after[:-1]])
        made[f"layer{layer}"] = times(cell, "_ih", below)
        made[f"layer{layer}/gates"] = times(cell, "_hh", before, slice(2 * width))
        made[f"layer{layer}/inner"] = times(cell, "_hh", before, slice(2 * width, None))
        below = after
    return made | {"dense_out": times(weights["dense_out"], "", below)}


class _Frame(NamedTuple):
    """What the reverse pass reads of a frame, beside its gates."""

    slopes: Made  # cotangents of what it made
    vector: Float[Array, "P B"]
    root: Root  # before it
    target: Float[Array, "3 B"]
    inputs: Float[Array, "I B"]
    hidden: tuple[Float[Array, "H B"], ...]  # before it
    gates: tuple[Gates, ...]


def _backward(config: DecoderConfig, compute: Compute, shared: Shared, record: Any) -> tuple[Course, dict[str, Array]]:
    """The loop over the frames from the last to the first, on columns: the cotangents of course and products."""
    course, made, kept, slopes = record
    turned, units, width = jax.tree.map(jnp.transpose, shared.weights), shared.units, course.hidden[0].shape[0]

    def times(layer: Any, which: str, x: Float[Array, "out B"]) -> Float[Array, "in B"]:
        return jnp.matmul(layer[f"weight{which}"], x, precision=precision(compute.matmul))

    def frame(ahead: tuple[Array, Root, tuple[Array, ...]], at: _Frame) -> tuple[Any, Any]:
        vector, root, hidden = ahead[0] + at.slopes.vector, jax.tree.map(jnp.add, ahead[1], at.slopes.root), []
        root, velocities = jax.vjp(partial(_moved, frame_time=units.frame_time), at.root, at.vector[:6])[1](root)
        deltas = {"dense_out": vector.at[:6].add(velocities) * units.out_std}
        below = times(turned["dense_out"], "", deltas["dense_out"])
        for layer in reversed(range(config.layers)):
            cell, gates, before = turned["gru"][f"layer{layer}"], at.gates[layer], at.hidden[layer]
            delta, inner, kept_back = _cell_slopes(ahead[2][layer] + below, gates, before)
            deltas |= {f"layer{layer}": delta, f"layer{layer}/inner": inner}
            hidden.append(kept_back + times(cell, "_hh", jnp.concatenate([delta[: 2 * width], inner])))
            below = times(cell, "_ih", delta)
        dense = at.inputs[:width]
        deltas["dense_in"] = below[:width] * jnp.where(dense > 0, 1.0, dense + 1.0)
        seen = below[width:] + times(turned["dense_in"], "", deltas["dense_in"])
        observed, given = jnp.split(seen, [len(units.seen_std)])
        vector, gaze = jnp.split(observed / units.seen_std, [len(vector)])
        turn, target = jax.vjp(_gaze, at.root, at.target)[1](gaze if config.facing else jnp.zeros_like(gaze))
        return (vector, jax.tree.map(jnp.add, root, turn), tuple(hidden[::-1])), (given, target, deltas)

    frames = _Frame(
        slopes, made.vector, _before(course.root, made.root), course.target, kept.inputs,
        _before(course.hidden, kept.hidden), kept.gates,
    )  # fmt: skip
    end = jax.tree.map(jnp.zeros_like, (course.vector, course.root, course.hidden))
    start, (given, target, deltas) = jax.lax.scan(frame, end, frames, reverse=True, unroll=compute.unroll)
    gates = {f"layer{layer}/gates": deltas[f"layer{layer}"][:, : 2 * width] for layer in range(config.layers)}
    vector, root, hidden = start
    return Course(vector, root, hidden, given, target), deltas | gates


def _cell_slopes(after: Array, gates: Gates, before: Array) -> tuple[Array, Array, Array]:
    """From the cotangent of a cell's new state: of its three sums, of `inner`, and of the old state by itself."""
    reset, update, new, inner = gates
    d_new = after * (1.0 - update) * (1.0 - new * new)
    d_update = after * (before - new) * update * (1.0 - update)
    d_reset = d_new * inner * reset * (1.0 - reset)
    return jnp.concatenate([d_reset, d_update, d_new]), d_new * reset, after * update


def _before(first: Any, after: Any) -> Any:
    """What was before each frame, from what was before the first and after each."""
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b[:-1]]), first, after)
