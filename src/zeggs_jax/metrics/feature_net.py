"""The frozen net that the Frechet gesture distance reads: a small autoencoder of windows of motion, and its trainer.

After Yoon et al. 2020 (convolutions over about 30 frames of joint positions, 32 features). Training is deterministic:
on one machine the same motions, in any order, and the same config give the same weights. A net carries its seed, a hash
of its data and one of its weights, in its file too (`net_file`); distances count only beside its `fingerprint`.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import linen as nn
from jaxtyping import Array, Float, Int

from ..motion.skeleton import Skeleton
from ..nn.layers import Dense
from . import movement
from .movement import Movement

ROUNDING = 1e-3  # cm: what the hash of the data does not see


@dataclass(frozen=True)
class FeatureNetConfig:
    """What is trained on what; windows are taken at a rate of their own, so a clip's frame rate does not matter."""

    rate_hz: float = 16.0
    frames: int = 32  # of a window: 2 s
    stride: int = 8  # frames from one window to the next: 0.5 s
    features: int = 32
    channels: int = 64
    steps: int = 2000
    batch: int = 64
    learning_rate: float = 1e-3
    seed: int = 0

    def __post_init__(self) -> None:
        if self.frames % 4 or self.frames < 4:
            raise ValueError(f"a window of {self.frames} frames cannot be halved twice; take a multiple of 4.")
        numbers = {k: v for k, v in asdict(self).items() if k != "seed"}
        if wrong := [name for name, number in numbers.items() if not number > 0]:
            raise ValueError(f"'{wrong[0]}' of the feature net is {numbers[wrong[0]]}; it must be above zero.")


class FeatureNet(NamedTuple):
    """A trained net with all that says where it comes from."""

    config: FeatureNetConfig
    joints: tuple[str, ...]  # names, in the order in which windows hold them
    mean: Float[np.ndarray, " C"]  # cm, of every coordinate
    spread: float  # cm, one for all coordinates, so that what moves more counts more
    params: Any
    data_hash: str
    error: float  # cm, RMS over coordinates, of decoded training windows

    @property
    def fingerprint(self) -> str:
        """Hash of the weights and of what scales their input."""
        leaves = jax.tree_util.tree_leaves(self.params)  # in the order of their names
        parts = [self.mean.astype(np.float32), np.float32(self.spread), *map(np.asarray, leaves)]
        return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


class _AutoEncoder(nn.Module):
    config: FeatureNetConfig

    @nn.compact
    def __call__(self, window: Float[Array, "F C"]) -> tuple[Float[Array, " D"], Float[Array, "F C"]]:
        """Features of a standardised window, and the window that they decode to."""
        quarter, channels = self.config.frames // 4, self.config.channels
        x = window
        for name in ("in0", "in1"):
            x = jax.nn.relu(Dense(channels, gain=2**0.5, name=name)(_with_neighbours(x)))
            x = x.reshape(-1, 2, channels).mean(axis=1)
        features = Dense(self.config.features, gain=1.0, name="features")(x.reshape(-1))
        x = jax.nn.relu(Dense(quarter * channels, gain=2**0.5, name="spread")(features)).reshape(quarter, channels)
        x = jax.nn.relu(Dense(channels, gain=2**0.5, name="out0")(_with_neighbours(jnp.repeat(x, 2, axis=0))))
        decoded = Dense(window.shape[-1], gain=1.0, name="out1")(_with_neighbours(jnp.repeat(x, 2, axis=0)))
        return features, decoded


def _with_neighbours(x: Float[Array, "F C"]) -> Float[Array, "F 3*C"]:
    """Each frame beside the ones before and after it: a product with these is a convolution of width 3.

    Written so because XLA's own is slow on a CPU inside a loop: 100 times at these sizes.
    """
    padded = jnp.concatenate([x[:1], x, x[-1:]])
    return jnp.concatenate([padded[:-2], x, padded[2:]], axis=-1)


def windows(config: FeatureNetConfig, motion: Movement) -> Float[np.ndarray, "N F C"]:
    """Windows of the major joints' positions, cm, each in its own heading over its own hips' ground point.

    Raises:
        ValueError: NaN, roles that are missing, or a motion shorter than a window.
    """
    motion = movement.sampled(movement.checked(motion), config.rate_hz)
    if len(motion.positions) < config.frames:
        seconds = config.frames / config.rate_hz
        raise ValueError(
            f"a motion of {len(motion.positions) / config.rate_hz:.1f} s is shorter than the feature net's window of "
            f"{seconds:g} s; give longer clips."
        )
    joints = movement.major(motion.skeleton)
    starts = range(0, len(motion.positions) - config.frames + 1, config.stride)
    parts = (motion._replace(positions=motion.positions[start : start + config.frames]) for start in starts)
    return np.stack([movement.in_heading(part).positions[:, joints].reshape(config.frames, -1) for part in parts])


def train(motions: Sequence[Movement], config: FeatureNetConfig | None = None) -> FeatureNet:
    """A net trained on recorded motion.

    Raises:
        ValueError: no motions, of different skeletons, too short, NaN, or too few windows for the features.
    """
    config = FeatureNetConfig() if config is None else config
    motions = movement.alike(motions)
    clips = sorted((windows(config, motion) for motion in motions), key=_digest)
    data = np.concatenate(clips)
    if len(data) < 2 * config.features:
        raise ValueError(
            f"{len(data)} windows are too few for {config.features} features; give {2 * config.features} or more, "
            f"one for every {config.stride / config.rate_hz:g} s of motion."
        )
    stamp = json.dumps(asdict(config), sort_keys=True) + "".join(map(_digest, clips))
    mean = data.mean(axis=(0, 1))
    spread = float(np.sqrt(np.square(data - mean).mean()))
    if not spread > 0.0:
        raise ValueError("the motions stand still, so there is nothing to learn from them; give motion that moves.")
    scaled = ((data - mean) / spread).astype(np.float32)
    order = np.random.default_rng([config.seed, 1]).integers(0, len(data), (config.steps, config.batch))
    params = jax.device_get(_fit(jnp.asarray(scaled), jnp.asarray(order), config))
    decoded = np.asarray(_decode(params, jnp.asarray(scaled), config))
    error = spread * float(np.sqrt(np.square(decoded - scaled).mean()))
    joints = tuple(motions[0].skeleton.names[joint] for joint in movement.major(motions[0].skeleton))
    digest = hashlib.sha256(stamp.encode()).hexdigest()
    return FeatureNet(config, joints, mean.astype(np.float32), spread, params, digest, error)


@partial(jax.jit, static_argnames="config")
def _fit(data: Float[Array, "N F C"], order: Int[Array, "S B"], config: FeatureNetConfig) -> Any:
    """Parameters after Adam on the mean squared error of the windows that `order` names."""
    net, optimiser = _AutoEncoder(config), optax.adam(config.learning_rate)
    params = net.init(jax.random.key(config.seed), data[0])["params"]

    def loss(params: Any, batch: Float[Array, "B F C"]) -> Array:
        decoded = _decode(params, batch, config)
        return jnp.square(decoded - batch).mean()

    def step(state: tuple[Any, Any], rows: Int[Array, " B"]) -> tuple[tuple[Any, Any], None]:
        params, memory = state
        updates, memory = optimiser.update(jax.grad(loss)(params, data[rows]), memory, params)
        return (optax.apply_updates(params, updates), memory), None

    (params, _), _ = jax.lax.scan(step, (params, optimiser.init(params)), order)
    return params


@partial(jax.jit, static_argnames="config")
def _decode(params: Any, data: Float[Array, "N F C"], config: FeatureNetConfig) -> Float[Array, "N F C"]:
    """The windows that the net makes of the features of windows."""
    return jax.vmap(lambda window: cast(Any, _AutoEncoder(config).apply({"params": params}, window))[1])(data)


def check(net: FeatureNet, skeleton: Skeleton) -> None:
    """ValueError for a skeleton whose major joints are not the net's."""
    names = tuple(skeleton.names[joint] for joint in movement.major(skeleton))
    if names != net.joints:
        odd = next((name for name in (*names, *net.joints) if (name in names) != (name in net.joints)), "their order")
        raise ValueError(
            f"the feature net was trained on {len(net.joints)} joints and the motion has {len(names)}, "
            f"first difference: {odd}; train a net on this skeleton."
        )


def embed(net: FeatureNet, motion: Movement) -> Float[np.ndarray, "N D"]:
    """Features of all windows of a motion.

    Raises:
        ValueError: joints that are not the net's, NaN, or a motion shorter than a window.
    """
    check(net, motion.skeleton)
    scaled = (windows(net.config, motion) - net.mean) / net.spread
    return np.asarray(_features(net.params, jnp.asarray(scaled, jnp.float32), net.config), np.float64)


@partial(jax.jit, static_argnames="config")
def _features(params: Any, data: Float[Array, "N F C"], config: FeatureNetConfig) -> Float[Array, "N D"]:
    return jax.vmap(lambda window: cast(Any, _AutoEncoder(config).apply({"params": params}, window))[0])(data)


def _digest(clip: Float[np.ndarray, "N F C"]) -> str:
    """Hash of a clip's windows, rounded to a thousandth of a centimetre."""
    return hashlib.sha256(np.rint(clip / ROUNDING).astype("<i8").tobytes()).hexdigest()
