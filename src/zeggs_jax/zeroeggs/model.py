"""ZeroEGGS Fig. 2: speech and an example motion are encoded, a style is drawn, a moving body is decoded.

    features --encode_speech--------------------------------\\
    example ---encode_style--> N(mean, var) --sample_style---+--> decode --> poses
    first pose, gaze target --------------------------------/

Every function is pure, takes one clip and is batched by `jax.vmap`; the parameters are a plain dict
{"speech", "style", "decoder"} in PyTorch's layouts. Models steered by labels have no "style".
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..data import scale
from ..data.scale import Scales
from ..motion.pose import Pose
from ..motion.skeleton import Skeleton
from ..nn.compute import PLAIN, Compute, operands
from ..training.plain import from_dict, to_dict
from . import encoders
from .config import ZeroEggsConfig
from .decoder import GAZE, Decoder, DecoderConfig, Frame, rollout
from .encoders import ENCODERS, Encoder
from .speech_encoder import SpeechEncoder, SpeechEncoderConfig
from .style_encoder import StyleDistribution, StyleEncoderConfig, reparameterise, sample_style

__all__ = [
    "ENCODERS",
    "Compute",
    "DecoderConfig",
    "Encoder",
    "Model",
    "Params",
    "SpeechEncoderConfig",
    "StyleDistribution",
    "StyleEncoderConfig",
    "ZeroEggsConfig",
    "check_params",
    "decode",
    "encode_speech",
    "encode_style",
    "from_dict",
    "init",
    "reparameterise",
    "sample_style",
    "to_dict",
]

Params = dict[str, Any]  # "speech", "style" (not with labels), "decoder"; weights (out, in) or (out, in, kernel)


class Model(NamedTuple):
    """Everything that generation needs: the networks, how their inputs are scaled, whom they move."""

    config: ZeroEggsConfig
    params: Params
    scales: Scales
    skeleton: Skeleton


def init(key: Array, config: ZeroEggsConfig) -> Params:
    """Draws parameters as PyTorch's and the release's initialisers do."""
    keys = dict(zip(("speech", "style", "decoder"), jax.random.split(key, 3), strict=True))
    seen = jnp.zeros(config.vector_size + GAZE)
    features = jnp.zeros((1, config.speech.features))
    given = Frame(jnp.zeros(config.speech.size), jnp.zeros(config.style_size), jnp.zeros(3))
    params = {"speech": SpeechEncoder(config.speech).init(keys["speech"], features)["params"]}
    if not config.labels:
        params["style"] = encoders.init(keys["style"], config.style, seen.shape[0])
    params["decoder"] = Decoder(config.decoder).init(keys["decoder"], seen, given)["params"]
    return params


def encode_speech(
    params: Params,
    config: ZeroEggsConfig,
    scales: Scales,
    features: Float[Array, "T F"],
    dropout_key: Array | None = None,
    compute: Compute = PLAIN,
) -> Float[Array, "T S"]:
    """Fig. 3a: features (`speech.features.extract`) -> speech embedding; dropout only with `dropout_key`."""
    encoder: Any = SpeechEncoder(config.speech, compute.matmul)
    return encoder.apply(
        {"params": operands(params["speech"], compute.matmul)},
        scale.apply(scales.speech, features),
        **_dropout(dropout_key),
    )


def encode_style(
    params: Params,
    config: ZeroEggsConfig,
    scales: Scales,
    example: Float[Array, "M P"],
    length: ArrayLike | None = None,
    dropout_key: Array | None = None,
    compute: Compute = PLAIN,
) -> StyleDistribution:
    """Fig. 3b: pose vectors of an example (`Pose.to_vector` of every frame, unscaled) -> style distribution.

    Frames from `length` on are padding. As released, the gaze columns are zeros before they are scaled.
    """
    gazeless = jnp.pad(example, ((0, 0), (0, GAZE)))
    return ENCODERS[config.style.kind].apply(
        operands(params["style"], compute.matmul),
        config.style,
        scale.apply(scales.pose_in, gazeless),
        example.shape[0] if length is None else length,
        dropout_key,
        compute.matmul,
    )


def decode(
    params: Params,
    config: ZeroEggsConfig,
    scales: Scales,
    first: Pose,
    speech: Float[Array, "T S"],
    style: Float[Array, "T Z"],
    gaze: Float[Array, "T 3"],
    compute: Compute = PLAIN,
) -> Pose:
    """Fig. 4: T poses, the first of which is `first`; `gaze` is the world position, in cm, that it faces."""
    given = Frame(speech, style, gaze)
    return rollout(params["decoder"], config.decoder, scales, first, given, config.frame_time, compute)


def check_params(params: Any, config: ZeroEggsConfig) -> None:
    """Raises a ValueError that names the first parameter which is missing, unknown or of another shape."""
    expected = _leaves(jax.eval_shape(lambda: init(jax.random.key(0), config)))
    found = _leaves(params)
    for name in [*expected, *found]:
        if name not in found:
            raise ValueError(f"parameter '{name}' is missing; the config asks for shape {expected[name]}.")
        if name not in expected:
            raise ValueError(f"parameter '{name}' with shape {found[name]} does not belong to this config.")
        if found[name] != expected[name]:
            raise ValueError(f"parameter '{name}' has shape {found[name]}; the config asks for {expected[name]}.")


def _leaves(params: Any) -> dict[str, tuple[int, ...]]:
    leaves = jax.tree_util.tree_leaves_with_path(params)
    return {"/".join(str(step.key) for step in path): tuple(leaf.shape) for path, leaf in leaves}


def _dropout(key: Array | None) -> dict[str, Any]:
    return {"deterministic": True} if key is None else {"deterministic": False, "rngs": {"dropout": key}}
