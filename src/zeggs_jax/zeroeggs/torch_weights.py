"""The PyTorch release's weights and statistics as a Model of ours, and back; imports no torch.

Parameters keep PyTorch's layouts, so converting renames and nothing else: there and back is bit for bit.

    release, in .pt files                       ours                                    paper
    ------------------------------------------  --------------------------------------  ----------------------
    speech_encoder  layer0, layer1              speech  conv0, conv1                    Fig. 3a, convolutions
                    layer2                              dense                           Fig. 3a, linear
    style_encoder   encoder.convs.0, .4         style   encoder/conv0, conv1            Fig. 3b, convolutions
    (attn)          encoder.convs.2, .6                 encoder/norm0, norm1            layer norm
                    encoder.blocks.0.attention          encoder/block/attention(_norm)  multi-head attention
                    encoder.blocks.0.feed_forward       encoder/block/conv0, conv1      feed-forward part
    style_encoder   encoder.rnn_layer                   encoder/forward, backward       (not in the paper)
    (gru)           encoder.projection_layer            encoder/dense
    decoder         cell_state_encoder.layer0-2 decoder initialiser/dense0-2            Fig. 4, hidden state
                    recurrent_decoder.layer0            recurrent/dense_in              Fig. 4, linear + ELU
                    recurrent_decoder.layer1            recurrent/gru/layer0-           Fig. 4, GRU
                    recurrent_decoder.layer2            recurrent/dense_out             Fig. 4, linear
    (film)          gammas_, betas_predictor            recurrent/gamma, beta           (not in the paper)
                    layer2, layer3                      recurrent/dense_mid, dense_out

    release, in poses and statistics            ours                                    paper, Sec. 3.1
    ------------------------------------------  --------------------------------------  ----------------------
    root_pos, root_rot                          Root.pos, Root.rot                      root pose
    root_vel, root_vrt                          Pose.root_vel, root_ang                 root velocities
    lpos, ltxy                                  Pose.joint_pos, joint_axes              joint poses
    lvel, lvrt                                  Pose.joint_vel, joint_ang               joint velocities
    gaze_pos                                    Frame.target, the argument `gaze`       facing target
    audio_input_*                               Scales.speech
    anim_input_*, anim_output_*                 Scales.pose_in, Scales.pose_out
    dt, label_names                             ZeroEggsConfig.frame_time, labels
"""

from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np

from ..data.scale import Scale, Scales
from ..motion import pose
from ..motion.skeleton import Skeleton
from . import torch_pickle
from .config import ZeroEggsConfig
from .decoder import GAZE, DecoderConfig
from .model import Model, Params, check_params
from .speech_encoder import SpeechEncoderConfig
from .style_encoder import StyleEncoderConfig
from .torch_names import rename, torch_names

Arrays = Mapping[str, np.ndarray]  # "<network>/<state_dict name>", as in "decoder/recurrent_decoder.layer0.weight"

NETWORKS = ("speech_encoder", "style_encoder", "decoder")
AUDIO = {  # the settings that our speech features follow; other settings of the pipeline change nothing
    "pre_emphasis": False,
    "centered": True,
    "real_amplitude": True,
    "normalize_mel_bins": True,
    "normalize_range": True,
    "min_clipping": 1e-5,
    "sampling_rate": 16000,
    "mel_fmin": 20,
    "mel_fmax": 7600,
    "n_mel_channels": 80,
    "filter_length": 800,
    "hop_length": 200,
    "normalize_loudness": True,
}


def convert(
    networks: Mapping[str, bytes | BinaryIO],
    stats: Arrays,
    data_definition: Mapping[str, Any],
    pipeline_conf: Mapping[str, Any] | None = None,
) -> Model:
    """The release's files as a Model.

    Args:
        networks: contents of speech_encoder.pt, style_encoder.pt and decoder.pt, by their names without
            '.pt'; a model that is steered by labels has no style_encoder.
        stats: the arrays of stats.npz.
        data_definition: the content of data_definition.json.
        pipeline_conf: the content of data_pipeline_conf.json; checked, because our speech features are fixed.

    Raises:
        ValueError: with one sentence that names the file, network or array that does not fit.
    """
    _check_pipeline(pipeline_conf or {})
    for network in ("speech_encoder", "decoder"):
        if network not in networks:
            raise ValueError(f"'{network}.pt' is missing; the release keeps it beside the other networks.")
    arrays = {
        f"{network}/{name}": array
        for network, file in networks.items()
        for name, array in torch_pickle.read(file, f"{network}.pt").items()
    }
    frame_time, names, parents, labels = _definition(data_definition)
    config = infer_config(arrays, frame_time, () if "style_encoder" in networks else labels)
    if config.joints != len(names):
        raise ValueError(f"decoder.pt moves {config.joints} joints, data_definition.json names {len(names)}.")
    scales = read_scales(stats, config)
    offsets = np.asarray(scales.pose_out.mean)[6 : 6 + 3 * len(names)].reshape(-1, 3)  # the data's mean offsets
    return Model(config, from_torch(arrays, config), scales, Skeleton(names, parents, offsets))


def from_torch(arrays: Arrays, config: ZeroEggsConfig) -> Params:
    """Parameters from the release's arrays; a ValueError names the first that does not fit."""
    names = torch_names(config)
    for name in [*names.values(), *arrays]:
        if name not in arrays:
            raise ValueError(f"'{name}' is missing among the release's arrays.")
        if name not in names.values():
            raise ValueError(f"'{name}' does not belong to the network that the other arrays make up.")
    params = rename(arrays, names)
    check_params(params, config)
    return params


def to_torch(params: Params, config: ZeroEggsConfig) -> dict[str, np.ndarray]:
    """The inverse of `from_torch`: arrays under '<network>/<state_dict name>'.

    Raises:
        ValueError: parameters of another config; a look-ahead that the release's networks cannot have.
    """
    check_params(params, config)
    if config.speech.ahead != config.speech.behind:
        raise ValueError(
            f"the model looks {config.speech.ahead} frames ahead and {config.speech.behind} behind, the release's "
            "networks always as far ahead as behind; convert a model that has no look-ahead of its own."
        )
    arrays = {}
    for path, name in torch_names(config).items():
        leaf: Any = params
        for step in path.split("/"):
            leaf = leaf[step]
        arrays[name] = np.asarray(leaf)
    return arrays


def infer_config(arrays: Arrays, frame_time: float = 0.016667, labels: tuple[str, ...] = ()) -> ZeroEggsConfig:
    """The sizes that the shapes of the release's arrays tell; `labels` only without a style encoder."""

    def shape(name: str, axes: int) -> tuple[int, ...]:
        if name not in arrays:
            raise ValueError(f"'{name}' is missing among the release's arrays.")
        if arrays[name].ndim != axes:
            raise ValueError(f"'{name}' has shape {arrays[name].shape}; expected {axes} axes.")
        return arrays[name].shape

    film = "decoder/recurrent_decoder.gammas_predictor.linear_layer.weight" in arrays
    vector, _ = shape(f"decoder/recurrent_decoder.layer{3 if film else 2}.weight", 2)
    hidden, begin = shape("decoder/cell_state_encoder.layer0.weight", 2)
    state, _ = shape("decoder/cell_state_encoder.layer2.weight", 2)
    decoder = DecoderConfig(hidden, state // hidden, "film" if film else "normal")
    speech_hidden, features, _ = shape("speech_encoder/layer0.weight", 3)
    size, _, kernel = shape("speech_encoder/layer1.weight", 3)
    speech = SpeechEncoderConfig(features=features, hidden=speech_hidden, size=size, kernel=kernel)
    joints, rest = divmod(vector - pose.size(0), pose.size(1) - pose.size(0))
    if rest:
        raise ValueError(f"decoder.pt gives {vector} numbers a frame; 6 + 15 per joint were expected.")
    style_size = begin - vector - GAZE
    if not any(name.startswith("style_encoder/") for name in arrays):
        if style_size != len(labels):
            raise ValueError(
                f"decoder.pt takes styles of {style_size} numbers and there are {len(labels)} labels; "
                "is style_encoder.pt missing, or data_definition.json from another version?"
            )
        style = StyleEncoderConfig(kind="label")
        return ZeroEggsConfig(joints, frame_time, labels, speech=speech, style=style, decoder=decoder)
    attentive = "style_encoder/encoder.convs.4.conv.weight" in arrays
    style_hidden = shape("style_encoder/encoder.convs.0.conv.weight", 3)[0]
    last = "encoder.convs.4.conv.bias" if attentive else "encoder.projection_layer.linear_layer.bias"
    (outputs,) = shape(f"style_encoder/{last}", 1)
    if outputs not in (style_size, 2 * style_size):
        raise ValueError(f"style_encoder.pt gives {outputs} numbers, decoder.pt takes styles of {style_size}.")
    kind = "attn" if attentive else "gru"
    style = StyleEncoderConfig(kind, style_hidden, style_size, variational=outputs == 2 * style_size)
    return ZeroEggsConfig(joints, frame_time, speech=speech, style=style, decoder=decoder)


def read_scales(stats: Arrays, config: ZeroEggsConfig) -> Scales:
    """Scales from the arrays of the release's stats.npz, as float32."""

    def part(key: str, size: int) -> np.ndarray:
        if key not in stats:
            raise ValueError(f"stats.npz has no array '{key}'.")
        array = np.asarray(stats[key], np.float32)
        if array.shape not in ((size,), ()):
            raise ValueError(f"'{key}' in stats.npz has shape {array.shape}; the networks take {size} numbers.")
        return np.broadcast_to(array, (size,)).copy()

    sizes = {
        "audio_input": config.speech.features,
        "anim_input": config.vector_size + GAZE,
        "anim_output": config.vector_size,
    }
    return Scales(*(Scale(part(f"{key}_mean", n), part(f"{key}_std", n)) for key, n in sizes.items()))


def _definition(data: Mapping[str, Any]) -> tuple[float, tuple[str, ...], tuple[int, ...], tuple[str, ...]]:
    try:
        names, parents = tuple(map(str, data["bone_names"])), tuple(map(int, data["parents"]))
        return float(data["dt"]), names, parents, tuple(map(str, data["label_names"]))
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"data_definition.json lacks a valid dt, bone_names, parents or label_names ({error})."
        ) from error


def _check_pipeline(conf: Mapping[str, Any]) -> None:
    given = conf.get("audio_conf", {})
    for key, expected in AUDIO.items():
        if key in given and given[key] != expected:
            raise ValueError(f"data_pipeline_conf.json sets {key} to {given[key]!r}; our features follow {expected!r}.")
    if conf.get("audio_feature_type", ["mel_spec", "energy"]) != ["mel_spec", "energy"]:
        raise ValueError(
            f"data_pipeline_conf.json asks for the features {conf['audio_feature_type']!r}; "
            "our speech features are mel_spec and energy."
        )
