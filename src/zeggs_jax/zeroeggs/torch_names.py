"""What the PyTorch release calls each of our parameters; the table is in torch_weights.py."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .config import ZeroEggsConfig
from .decoder import DecoderConfig
from .style_encoder import StyleEncoderConfig

RELEASED = ("attn", "gru", "label")  # kinds of style encoder that the release has


def torch_names(config: ZeroEggsConfig) -> dict[str, str]:
    """The release's names of our parameters: 'speech/conv0/weight' -> 'speech_encoder/layer0.weight'."""
    if config.style.kind not in RELEASED:
        raise ValueError(
            f"the style kind is '{config.style.kind}'; the release, which has {', '.join(RELEASED)}, cannot hold it."
        )
    if not config.decoder.initialiser:
        raise ValueError("the decoder has no initialiser; the release's always has one: it cannot hold this model.")
    patterns = {
        **_under("speech", "speech_encoder", {"conv0": "layer0.{}", "conv1": "layer1.{}", "dense": "layer2.{}"}),
        **_under("style", "style_encoder", {} if config.labels else _style_patterns(config.style)),
        **_under("decoder", "decoder", _decoder_patterns(config.decoder)),
    }
    names = {}
    for ours, pattern in patterns.items():
        leaves = ("weight_ih", "weight_hh", "bias_ih", "bias_hh") if "{}_l" in pattern else ("weight", "bias")
        names |= {f"{ours}/{leaf}": pattern.format(leaf) for leaf in leaves}
    return names


def _under(ours: str, network: str, patterns: dict[str, str]) -> dict[str, str]:
    return {f"{ours}/{layer}": f"{network}/{pattern}" for layer, pattern in patterns.items()}


def _style_patterns(config: StyleEncoderConfig) -> dict[str, str]:
    attention = "encoder.blocks.0.attention."
    forward = "encoder.blocks.0.feed_forward."
    if config.kind == "gru":
        return {
            "encoder/conv0": "encoder.convs.0.conv.{}",
            "encoder/conv1": "encoder.convs.2.conv.{}",
            "encoder/forward": "encoder.rnn_layer.{}_l0",
            "encoder/backward": "encoder.rnn_layer.{}_l0_reverse",
            "encoder/dense": "encoder.projection_layer.linear_layer.{}",
        }
    return {
        "encoder/conv0": "encoder.convs.0.conv.{}",
        "encoder/norm0": "encoder.convs.2.{}",
        "encoder/conv1": "encoder.convs.4.conv.{}",
        "encoder/norm1": "encoder.convs.6.{}",
        "encoder/block/attention/project_in": attention + "multi_head_attention.in_proj_{}",
        "encoder/block/attention/project_out": attention + "multi_head_attention.out_proj.{}",
        "encoder/block/attention_norm": attention + "layer_norm.{}",
        "encoder/block/conv0": forward + "convs.0.conv.{}",
        "encoder/block/conv1": forward + "convs.2.conv.{}",
        "encoder/block/conv_norm": forward + "layer_norm.{}",
    }


def _decoder_patterns(config: DecoderConfig) -> dict[str, str]:
    film = config.conditioning == "film"
    after_gru = {"dense_mid": "layer2.{}", "dense_out": "layer3.{}"} if film else {"dense_out": "layer2.{}"}
    film_layers = {f"{name}": f"{name}s_predictor.linear_layer.{{}}" for name in ("gamma", "beta") if film}
    gru = {f"gru/layer{i}": f"layer1.{{}}_l{i}" for i in range(config.layers)}
    recurrent = {"dense_in": "layer0.{}", **gru, **after_gru, **film_layers}
    return {
        **{f"initialiser/dense{i}": f"cell_state_encoder.layer{i}.{{}}" for i in range(3)},
        **{f"recurrent/{ours}": f"recurrent_decoder.{theirs}" for ours, theirs in recurrent.items()},
    }


def rename(arrays: Mapping[str, np.ndarray], names: Mapping[str, str]) -> dict[str, Any]:
    """A nested dict with the array called names[path] at every path ('speech/conv0/weight')."""
    params: dict[str, Any] = {}
    for path, name in names.items():
        *parents, leaf = path.split("/")
        place = params
        for parent in parents:
            place = place.setdefault(parent, {})
        place[leaf] = np.asarray(arrays[name])
    return params
