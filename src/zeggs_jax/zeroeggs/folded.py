"""The decoder's fast form, derived from its params: the same poses for fewer bytes a frame.

`decoder.py` is the definition. At batch 1 a frame costs the reading of its weights, so here
  what is known before the loop (speech, style) is multiplied before it, for all its frames at once;
  what leaves the network and re-enters it (output layer, unscaling, scaling, the pose's columns of the first two
  products) is one matrix, made once; only the six velocities of the root are formed in the loop;
  whatever one vector is multiplied with, for this frame or the next, is one product;
  the joints are formed after the loop, in one product for all its frames.
Weights are arguments of the executable and stand on the left: `x @ W.T` in a loop copies W at every frame.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..data import scale
from ..data.scale import Scale, Scales
from ..motion import pose as poses
from ..motion.pose import Pose, Root
from ..nn.reduced import Reduced, product
from . import decoder
from .decoder import GAZE, DecoderConfig, Frame

CHUNK = 64  # frames of one executable, whatever the length of what is decoded
VELOCITIES = 6  # numbers that the root is moved by


class Product(NamedTuple):
    """W x + b."""

    weight: Float[Array, "out in"] | Reduced
    bias: Float[Array, " out"]


class Folded(NamedTuple):
    """The weights of the fast form, plain or by `nn.reduced.with_precision`; H hidden, S speech, Z style, J joints.

    W = 4H rows are the dense layer's, then the G = 3H of the first gates.
    """

    given: Product  # (4H, S + Z), with the biases of both layers
    gaze: Float[Array, "W 3"] | Reduced
    gaze_in: Scale
    embedded: Float[Array, "G H"] | Reduced  # the dense layer's output to the first gates
    layers: tuple[Product, ...]  # (6H, H): the next layer's gates, then what its own state adds to its next gates;
    # the last (7H, H): the rows of the next pose's columns, then the same
    root: Product  # (6, H): velocities in cm/s and rad/s; too small to be reduced
    joints: Product  # (15J, H): the rest of the pose vector, unscaled
    frame_time: Float[Array, ""]


class FoldedState(NamedTuple):
    """What a frame hands on to the next; the joints of its pose only as what they add to the next products."""

    root: Root
    hidden: tuple[Float[Array, "H *B"], ...]  # of every layer
    products: tuple[Float[Array, "R *B"], ...]  # of every layer's weight with it, without the bias


def fits(config: DecoderConfig) -> bool:
    """Whether there is a fast form; with 'film' the style multiplies what would have to be folded."""
    return config.conditioning == "normal"


def fold(params: Any, config: DecoderConfig, scales: Scales, frame_time: float) -> Folded:
    """The fast form of the decoder's `params`; products in float64, once, rounded to the parameters' own precision.

    Raises:
        ValueError: a decoder without a fast form.
    """
    if not fits(config):
        raise ValueError(f"a decoder with '{config.conditioning}' conditioning has no folded form; use its plain form.")
    net = params["recurrent"]
    dtype = net["dense_out"]["weight"].dtype
    exact, cells, hidden = _exact(net["dense_out"]), net["gru"], config.hidden
    wide = _wide(net, hidden)
    size = len(exact["bias"])
    pose_in, pose_out = _exact(scales.pose_in), _exact(scales.pose_out)
    out_std = np.broadcast_to(pose_out.std, (size,))
    weight, bias = exact["weight"] * out_std[:, None], exact["bias"] * out_std + pose_out.mean  # unscaled
    seen_std = np.broadcast_to(pose_in.std, pose_in.mean.shape)
    again = _exact(wide["weight"][:, :size]) / seen_std[:size]
    ahead = (again @ weight).astype(dtype), (again @ (bias - pose_in.mean[:size])).astype(dtype)
    rows = [cells[f"layer{i}"] for i in range(config.layers)]
    follows = [*((cell["weight_ih"], cell["bias_ih"]) for cell in rows[1:]), ahead]
    layers = tuple(
        Product(_stacked(up[0], cell["weight_hh"]), _stacked(up[1], cell["bias_hh"]))
        for up, cell in zip(follows, rows, strict=True)
    )
    folded = Folded(
        given=Product(wide["weight"][:, size + GAZE :], wide["bias"]),
        gaze=wide["weight"][:, size : size + GAZE],
        gaze_in=Scale(pose_in.mean[size:], seen_std[size:]),
        embedded=rows[0]["weight_ih"][:, :hidden],
        layers=layers,
        root=Product(weight[:VELOCITIES], bias[:VELOCITIES]),
        joints=Product(weight[VELOCITIES:], bias[VELOCITIES:]),
        frame_time=_exact(frame_time),
    )
    return jax.tree.map(lambda a: jax.device_put(np.asarray(a, dtype)), folded)  # jnp.asarray compiles each shape


def _exact(tree: Any) -> Any:
    return jax.tree.map(lambda a: np.asarray(a, np.float64), tree)


def _stacked(*parts: Any) -> Any:
    return np.concatenate(parts)


def _wide(net: Any, hidden: int) -> Any:
    """The dense layer above the first gates: all that multiplies (pose, gaze, speech, style)."""
    dense, first = net["dense_in"], net["gru"]["layer0"]
    weight = _stacked(dense["weight"], np.asarray(first["weight_ih"])[:, hidden:])
    return {"weight": weight, "bias": _stacked(dense["bias"], first["bias_ih"])}


def begin(params: Any, folded: Folded, config: DecoderConfig, scales: Scales, first: Pose, given: Frame) -> FoldedState:
    """The state before frame 1, from the first pose and frame 0's style and target; `params` are the plain ones.

    The first pose is no prediction, so that it is multiplied as the plain form does.
    """
    state = decoder.begin(params, config, scales, first, given)
    net, size = params["recurrent"], poses.to_vector(first).shape[-1]
    seen = decoder.observe(first, given.target, scales.pose_in)[:size]
    columns = (net["dense_in"]["weight"], net["gru"]["layer0"]["weight_ih"][:, config.hidden :])
    projected = jnp.concatenate([weight[:, :size] @ seen for weight in columns])
    made = [product(layer.weight, h[:, None])[:, 0] for layer, h in zip(folded.layers, state.hidden, strict=True)]
    gates, last = -3 * config.hidden, folded.layers[-1].bias
    made[-1] = jnp.concatenate([projected - last[:gates], made[-1][gates:]])
    return FoldedState(first.root, tuple(state.hidden), tuple(made))


def advance(folded: Folded, config: DecoderConfig, state: FoldedState, given: Frame) -> tuple[FoldedState, Pose]:
    """K frames on: the state after them, and their poses; `given` has a leading axis of K."""
    state, poses = advance_many(folded, config, *jax.tree.map(lambda a: jnp.asarray(a)[..., None], (state, given)))
    return jax.tree.map(lambda a: a[..., 0], state), jax.tree.map(lambda a: a[0], poses)


def advance_many(folded: Folded, config: DecoderConfig, state: FoldedState, given: Frame) -> tuple[FoldedState, Pose]:
    """K frames on in B clips at once, which are the last axis of `state` and `given`, and the first of the poses."""
    known = jnp.concatenate([given.speech, given.style], axis=1)
    told = jax.vmap(partial(_apply, folded.given))(known)
    xs = told, jnp.asarray(given.target)
    state, (root, velocity, output) = jax.lax.scan(partial(_frame, folded, config), state, xs)
    joints = jax.vmap(partial(_apply, folded.joints))(output)
    vector, root = jax.tree.map(lambda a: jnp.moveaxis(a, -1, 0), (jnp.concatenate([velocity, joints], axis=1), root))
    return state, poses.from_vector(vector, root)


def _frame(
    folded: Folded, config: DecoderConfig, state: FoldedState, x: tuple[Float[Array, "W B"], Float[Array, "3 B"]]
) -> tuple[FoldedState, tuple[Root, Array, Array]]:
    """One frame: its state; its root, the velocities of the root and the GRU's output. All arrays are columns."""
    told, target = x
    gates = -3 * config.hidden
    before = [made + layer.bias[:, None] for layer, made in zip(folded.layers, state.products, strict=True)]
    inputs = before[-1][:gates] + told
    if config.facing:
        seen = scale.apply(folded.gaze_in, jax.vmap(poses.gaze_direction, -1)(state.root, target))
        inputs += product(folded.gaze, seen.T)
    ahead = product(folded.embedded, jax.nn.elu(inputs[: config.hidden])) + inputs[config.hidden :]
    hidden, products = [], []
    for layer, own, last in zip(folded.layers, before, state.hidden, strict=True):
        hidden.append(_gru(ahead, own[gates:], last))
        products.append(product(layer.weight, hidden[-1]))
        ahead = products[-1][:gates] + layer.bias[:gates, None]
    velocity = _apply(folded.root, hidden[-1])
    moved = partial(poses.integrate, frame_time=folded.frame_time)
    root = jax.vmap(moved, -1, -1)(state.root, velocity[:3], velocity[3:])
    return FoldedState(root, tuple(hidden), tuple(products)), (root, velocity, hidden[-1])


def _apply(layer: Product, x: Float[Array, "in B"]) -> Float[Array, "out B"]:
    return product(layer.weight, x) + layer.bias[:, None]


def _gru(x: Float[Array, "G B"], own: Float[Array, "G B"], hidden: Float[Array, "H B"]) -> Float[Array, "H B"]:
    """`nn.layers.GRUCell` from its two products."""
    (reset_x, update_x, new_x), (reset_h, update_h, new_h) = (jnp.split(a, 3) for a in (x, own))
    update = jax.nn.sigmoid(update_x + update_h)
    new = jnp.tanh(new_x + jax.nn.sigmoid(reset_x + reset_h) * new_h)
    return (1.0 - update) * new + update * hidden


def rollout(params: Any, folded: Folded, config: DecoderConfig, scales: Scales, first: Pose, given: Frame) -> Pose:
    """As `decoder.rollout`: `first` verbatim, then one pose per frame of `given` from frame 1 on."""
    state = begin(params, folded, config, scales, first, jax.tree.map(lambda a: a[0], given))
    _, rest = advance(folded, config, state, jax.tree.map(lambda a: a[1:], given))
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, rest)
