"""The decoder's training form: `decoder.rollout` of a batch, with its reverse pass written out, the clips as columns.

A recurrent network reads all its weights at every frame; over a batch its fastest form on a CPU is `W @ x` with x as
[features, clips]. `jax.vmap` would keep the clips in front and turn the arrays about, so this is written for a batch.
Autodiff of the recurrence keeps every intermediate of a frame, some of them three times, and adds to all weights'
gradients at every frame. Here the forward pass keeps what the products see and the gates of each GRU layer, the reverse
pass walks back over them, and each weight's gradient follows as one product over all frames and clips, of rows that
both loops have already turned. Values and gradients are the decoder's.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..data.scale import Scales
from ..motion import pose as poses
from ..motion.pose import Pose, Root
from ..nn.compute import PLAIN, Compute, factors, multiply, operands
from . import decoder
from .decoder import GAZE, DecoderConfig, Frame


class Course(NamedTuple):
    """What the recurrence is given."""

    vector: Float[Array, "P B"]  # the first pose, unscaled
    root: Root  # of the first pose: [3, B] and [4, B]
    hidden: tuple[Float[Array, "H B"], ...]  # of every layer, before frame 1
    given: Float[Array, "T G B"]  # speech and style of frames 1 to T
    target: Float[Array, "T 3 B"]  # cm, world


class Made(NamedTuple):
    """Frames 1 to T: the pose vectors, unscaled, and the roots."""

    vector: Float[Array, "T P B"]
    root: Root  # [T, 3, B] and [T, 4, B]


class Gates(NamedTuple):
    """Of one GRU layer and all frames."""

    reset: Float[Array, "T H B"]
    update: Float[Array, "T H B"]
    new: Float[Array, "T H B"]
    inner: Float[Array, "T H B"]  # what the hidden state adds to `new`, before the reset


class Rows(NamedTuple):
    """What the products of the frames saw."""

    inputs: Float[Array, "T B I"]  # the first dense layer; observation, speech and style
    hidden: tuple[Float[Array, "T B H"], ...]  # of every layer, after the frame


class Kept(NamedTuple):
    """What the reverse pass needs of every frame."""

    dense: Float[Array, "T H B"]  # the first dense layer
    hidden: tuple[Float[Array, "T H B"], ...]  # of every layer, before the frame
    gates: tuple[Gates, ...]  # of every layer
    rows: Rows


class Units(NamedTuple):
    """The decoder's scales as columns."""

    seen_mean: Float[Array, "O 1"]
    seen_std: Float[Array, "O 1"]
    out_mean: Float[Array, "P 1"]
    out_std: Float[Array, "P 1"]
    frame_time: Float[Array, ""]  # s


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
    """As `decoder.rollout` of every clip of `first` and `given`, the leading axis of their arrays.

    Where there is no training form it is that. Scales and frame time have no gradients.
    """
    if not fits(config, compute):
        alone = partial(decoder.rollout, params, config, scales, frame_time=frame_time, compute=compute)
        return jax.vmap(lambda first, given: alone(first=first, given=given))(first, given)
    params = operands(params, compute.matmul)
    begin = partial(decoder.begin, params, config, scales, matmul=compute.matmul)
    state = jax.vmap(begin)(first, jax.tree.map(lambda a: a[:, 0], given))
    heard = jnp.concatenate([given.speech, given.style], axis=-1)
    start = poses.to_vector(first), first.root, tuple(jnp.moveaxis(state.hidden, 1, 0)), heard[:, 1:]
    course = Course(*jax.tree.map(lambda a: jnp.moveaxis(a, 0, -1), (*start, given.target[:, 1:])))
    made = _recur(config, compute, params["recurrent"], _units(scales, frame_time), course)
    rest = poses.from_vector(*jax.tree.map(lambda a: jnp.moveaxis(a, -1, 0), made))
    return jax.tree.map(lambda a, b: jnp.concatenate([a[:, None], b], axis=1), first, rest)


def _units(scales: Scales, frame_time: ArrayLike) -> Units:
    pairs = ((s.mean, jnp.broadcast_to(s.std, jnp.shape(s.mean))) for s in (scales.pose_in, scales.pose_out))
    seen_mean, seen_std, out_mean, out_std = (jnp.asarray(a)[:, None] for pair in pairs for a in pair)
    return Units(seen_mean, seen_std, out_mean, out_std, jnp.asarray(frame_time))


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def _recur(config: DecoderConfig, compute: Compute, weights: Any, units: Units, course: Course) -> Made:
    """The frames of all clips, with the gradients of the weights and of what it is given."""
    return _forward(config, compute, weights, units, course)[0]


def _recur_fwd(config: DecoderConfig, compute: Compute, weights: Any, units: Units, course: Course) -> Any:
    made, kept = _forward(config, compute, weights, units, course)
    return made, (weights, units, course, made, kept)


def _recur_bwd(config: DecoderConfig, compute: Compute, record: Any, cotangents: Made) -> tuple[Any, None, Course]:
    weights, units, course, made, kept = record
    along, deltas = _backward(config, compute, weights, units, _frames(cotangents, course, made, kept))
    return _gradients(course, kept.rows, deltas), None, along


_recur.defvjp(_recur_fwd, _recur_bwd)


def _forward(config: DecoderConfig, compute: Compute, weights: Any, units: Units, course: Course) -> tuple[Made, Kept]:
    """The loop over the frames."""
    weights = factors(weights, compute.matmul)

    def frame(carry: Any, given: Any) -> tuple[Any, Any]:
        vector, root, hidden = carry
        seen = (jnp.concatenate([vector, _gaze(root, given[1])]) - units.seen_mean) / units.seen_std
        if not config.facing:
            seen = seen.at[-GAZE:].set(0.0)
        seen = jnp.concatenate([seen, given[0]])
        dense = jax.nn.elu(_affine(weights["dense_in"], "", seen))
        inputs = jnp.concatenate([dense, seen])
        after, gates, below = [], [], inputs
        for layer, before in enumerate(hidden):
            below, opened = _cell(weights["gru"][f"layer{layer}"], below, before)
            after.append(below)
            gates.append(opened)
        vector = _affine(weights["dense_out"], "", below) * units.out_std + units.out_mean
        root = _moved(root, vector[:6], units.frame_time)
        rows = jax.tree.map(jnp.transpose, Rows(inputs, tuple(after)))
        return (vector, root, tuple(after)), (Made(vector, root), Kept(dense, hidden, tuple(gates), rows))

    start = course.vector, course.root, course.hidden
    return jax.lax.scan(frame, start, (course.given, course.target))[1]


def _cell(weights: Any, below: Array, hidden: Array) -> tuple[Array, Gates]:
    """`nn.layers.GRUCell` on columns."""
    reset_x, update_x, new_x = jnp.split(_affine(weights, "_ih", below), 3)
    reset_h, update_h, inner = jnp.split(_affine(weights, "_hh", hidden), 3)
    reset, update = jax.nn.sigmoid(reset_x + reset_h), jax.nn.sigmoid(update_x + update_h)
    new = jnp.tanh(new_x + reset * inner)
    return (1.0 - update) * new + update * hidden, Gates(reset, update, new, inner)


def _affine(layer: Any, which: str, x: Float[Array, "in B"]) -> Float[Array, "out B"]:
    return multiply(layer[f"weight{which}"], x) + layer[f"bias{which}"][:, None]


def _gaze(root: Root, target: Float[Array, "3 B"]) -> Float[Array, "3 B"]:
    return poses.gaze_direction(Root(root.pos.T, root.rot.T), target.T).T


def _moved(root: Root, velocities: Float[Array, "6 B"], frame_time: ArrayLike) -> Root:
    vel, ang = velocities[:3].T, velocities[3:].T
    moved = poses.integrate(Root(root.pos.T, root.rot.T), vel, ang, frame_time)
    return Root(moved.pos.T, moved.rot.T)


class _Frame(NamedTuple):
    """What the reverse pass reads of a frame."""

    slopes: Made  # cotangents of what it made
    vector: Float[Array, "P B"]
    root: Root  # before it
    target: Float[Array, "3 B"]
    dense: Float[Array, "H B"]
    hidden: tuple[Float[Array, "H B"], ...]  # before it
    gates: tuple[Gates, ...]


def _frames(slopes: Made, course: Course, made: Made, kept: Kept) -> _Frame:
    root = jax.tree.map(_before, course.root, made.root)
    return _Frame(slopes, made.vector, root, course.target, kept.dense, kept.hidden, kept.gates)


def _before(first: Float[Array, "*F"], after: Float[Array, "T *F"]) -> Float[Array, "T *F"]:
    """What was before each frame, from what was before the first and after each."""
    return jnp.concatenate([first[None], after[:-1]])


def _backward(
    config: DecoderConfig, compute: Compute, weights: Any, units: Units, frames: _Frame
) -> tuple[Course, dict[str, Array]]:
    """The loop from the last frame to the first: the cotangents of the course and, [T, B, out], of the products."""
    turned = jax.tree.map(jnp.transpose, factors(weights, compute.matmul))
    width = config.hidden

    def frame(ahead: tuple[Array, Root, tuple[Array, ...]], at: _Frame) -> tuple[Any, Any]:
        vector, root, hidden = ahead[0] + at.slopes.vector, jax.tree.map(jnp.add, ahead[1], at.slopes.root), []
        root, velocities = jax.vjp(partial(_moved, frame_time=units.frame_time), at.root, at.vector[:6])[1](root)
        deltas = {"dense_out": vector.at[:6].add(velocities) * units.out_std}
        below = multiply(turned["dense_out"]["weight"], deltas["dense_out"])
        for layer in reversed(range(config.layers)):
            cell, gates, before = turned["gru"][f"layer{layer}"], at.gates[layer], at.hidden[layer]
            delta, inner, kept_back = _cell_slopes(ahead[2][layer] + below, gates, before)
            deltas |= {f"layer{layer}": delta, f"layer{layer}/inner": inner}
            hidden.append(kept_back + multiply(cell["weight_hh"], jnp.concatenate([delta[: 2 * width], inner])))
            below = multiply(cell["weight_ih"], delta)
        deltas["dense_in"] = below[:width] * jnp.where(at.dense > 0, 1.0, at.dense + 1.0)
        seen = below[width:] + multiply(turned["dense_in"]["weight"], deltas["dense_in"])
        observed, given = jnp.split(seen, [len(units.seen_std)])
        vector, gaze = jnp.split(observed / units.seen_std, [len(vector)])
        turn, target = jax.vjp(_gaze, at.root, at.target)[1](gaze if config.facing else jnp.zeros_like(gaze))
        rows = jax.tree.map(jnp.transpose, deltas)
        return (vector, jax.tree.map(jnp.add, root, turn), tuple(hidden[::-1])), (given, target, rows)

    end = jax.tree.map(lambda a: jnp.zeros_like(a[0]), (frames.vector, frames.root, frames.hidden))
    start, (given, target, rows) = jax.lax.scan(frame, end, frames, reverse=True)
    vector, root, hidden = start
    return Course(vector, root, hidden, given, target), rows


def _cell_slopes(after: Array, gates: Gates, before: Array) -> tuple[Array, Array, Array]:
    """From the cotangent of a cell's new state: of its three sums, of `inner`, and of the old state by itself."""
    reset, update, new, inner = gates
    d_new = after * (1.0 - update) * (1.0 - new * new)
    d_update = after * (before - new) * update * (1.0 - update)
    d_reset = d_new * inner * reset * (1.0 - reset)
    return jnp.concatenate([d_reset, d_update, d_new]), d_new * reset, after * update


def _gradients(course: Course, rows: Rows, deltas: dict[str, Float[Array, "T B out"]]) -> Any:
    """Of all weights and biases, each over all frames and clips."""
    width, below, cells = course.hidden[0].shape[0], rows.inputs, {}
    made = {"dense_in": _gradient("", deltas["dense_in"], below[..., width:])}
    for layer, (after, first) in enumerate(zip(rows.hidden, course.hidden, strict=True)):
        delta, inner, before = deltas[f"layer{layer}"], deltas[f"layer{layer}/inner"], _before(first.T, after)
        parts = (_gradient("_hh", d, before) for d in (delta[..., : 2 * width], inner))
        cells[f"layer{layer}"] = _gradient("_ih", delta, below) | jax.tree.map(lambda *a: jnp.concatenate(a), *parts)
        below = after
    return made | {"gru": cells, "dense_out": _gradient("", deltas["dense_out"], below)}


def _gradient(which: str, delta: Float[Array, "T B out"], x: Float[Array, "T B in"]) -> dict[str, Array]:
    """Of one weight and its bias."""
    delta, x = (a.reshape(-1, a.shape[-1]) for a in (delta, x))
    return {f"weight{which}": delta.T @ x, f"bias{which}": delta.sum(0)}
