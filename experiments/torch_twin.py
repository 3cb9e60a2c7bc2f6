"""ZeroEGGS in plain PyTorch eager, for the benches: the same networks and losses, a Python loop over frames.

Written from the paper and the specification, not from the release. Parameters carry our names
('decoder/recurrent/dense_in/weight') in a flat dict; layouts are the same. Arrays are batched: [B, T, ...].
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from zeggs_jax.nn.attention import positions
from zeggs_jax.zeroeggs.losses import WEIGHTS
from zeggs_jax.zeroeggs.model import ZeroEggsConfig

Params = dict[str, Tensor]


class Body(NamedTuple):
    """Predicted or true motion: the root in world and the pose vector, unscaled."""

    pos: Tensor  # [B, T, 3]
    rot: Tensor  # [B, T, 4]
    vector: Tensor  # [B, T, P]


class Twin(NamedTuple):
    """Parameters and what is fixed in a run."""

    params: Params
    config: ZeroEggsConfig
    scales: dict[str, tuple[Tensor, Tensor]]  # speech, pose_in, pose_out: mean and std
    parents: tuple[int, ...]


def dense(p: Params, name: str, x: Tensor) -> Tensor:
    return F.linear(x, p[f"{name}/weight"], p[f"{name}/bias"])


def conv(p: Params, name: str, x: Tensor, edge: bool = False) -> Tensor:
    """Convolution over the frames of [B, T, C]."""
    weight, half = p[f"{name}/weight"], p[f"{name}/weight"].shape[-1] // 2
    padded = F.pad(x.transpose(1, 2), (half, half), mode="replicate" if edge and half else "constant")
    return F.conv1d(padded, weight, p[f"{name}/bias"]).transpose(1, 2)


def norm(p: Params, name: str, x: Tensor) -> Tensor:
    return F.layer_norm(x, x.shape[-1:], p[f"{name}/weight"], p[f"{name}/bias"])


def encode_speech(twin: Twin, features: Tensor, train: bool) -> Tensor:
    p, rate = twin.params, twin.config.speech.dropout
    mean, std = twin.scales["speech"]
    x = F.dropout(F.elu(conv(p, "speech/conv0", (features - mean) / std)), rate, train)
    x = F.dropout(F.elu(conv(p, "speech/conv1", x, edge=True)), rate, train)
    return F.elu(dense(p, "speech/dense", x))


def encode_style(twin: Twin, example: Tensor, train: bool) -> tuple[Tensor, Tensor]:
    """The attention encoder: mean and log variance."""
    p, config = twin.params, twin.config.style
    mean, std = twin.scales["pose_in"]
    x = (F.pad(example, (0, 3)) - mean) / std
    for i in range(2):
        x = norm(p, f"style/encoder/norm{i}", F.relu(conv(p, f"style/encoder/conv{i}", x)))
        x = F.dropout(x, config.dropout, train)
    x = x + torch.from_numpy(positions(*x.shape[1:]))
    x = attend(p, x, config.heads, config.block_dropout, train)
    inner = F.relu(conv(p, "style/encoder/block/conv0", x))
    inner = F.dropout(conv(p, "style/encoder/block/conv1", inner), config.block_dropout, train)
    mu, log_var = norm(p, "style/encoder/block/conv_norm", inner + x).mean(1).chunk(2, -1)
    return mu, log_var


def attend(p: Params, x: Tensor, heads: int, rate: float, train: bool) -> Tensor:
    at, width = "style/encoder/block/attention", x.shape[-1]
    frames = x.transpose(0, 1)
    out, _ = F.multi_head_attention_forward(
        frames, frames, frames, width, heads,
        p[f"{at}/project_in/weight"], p[f"{at}/project_in/bias"], None, None, False, rate,
        p[f"{at}/project_out/weight"], p[f"{at}/project_out/bias"], training=train, need_weights=False,
    )  # fmt: skip
    return norm(p, "style/encoder/block/attention_norm", F.dropout(out.transpose(0, 1), rate, train) + x)


def decode(twin: Twin, first: Body, speech: Tensor, style: Tensor, gaze: Tensor) -> Body:
    """Closed loop, one frame a turn; `first` has one frame, `gaze` is [B, 3]."""
    p, config = twin.params, twin.config.decoder
    (in_mean, in_std), (out_mean, out_std) = twin.scales["pose_in"], twin.scales["pose_out"]
    pos, rot, vector = (a[:, 0] for a in first)

    def observe() -> Tensor:
        return (torch.cat([vector, rotate(conjugate(rot), gaze - pos)], -1) - in_mean) / in_std

    x = torch.cat([observe(), style], -1)
    for i in range(2):
        x = F.elu(dense(p, f"decoder/initialiser/dense{i}", x))
    hidden = list(dense(p, "decoder/initialiser/dense2", x).chunk(config.layers, -1))
    rows = [(pos, rot, vector)]
    for t in range(1, speech.shape[1]):
        inputs = torch.cat([observe(), speech[:, t], style], -1)
        x = torch.cat([F.elu(dense(p, "decoder/recurrent/dense_in", inputs)), inputs], -1)
        for i in range(config.layers):
            names = (f"decoder/recurrent/gru/layer{i}/{n}" for n in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"))
            x = hidden[i] = torch.gru_cell(x, hidden[i], *(p[name] for name in names))
        vector = dense(p, "decoder/recurrent/dense_out", x) * out_std + out_mean
        pos, rot = integrate(pos, rot, vector[:, :3], vector[:, 3:6], twin.config.frame_time)
        rows.append((pos, rot, vector))
    return Body(*(torch.stack(parts, 1) for parts in zip(*rows, strict=True)))


def conjugate(q: Tensor) -> Tensor:
    return torch.cat([q[..., :1], -q[..., 1:]], -1)


def rotate(q: Tensor, v: Tensor) -> Tensor:
    twice = 2.0 * torch.linalg.cross(q[..., 1:], v)
    return v + q[..., :1] * twice + torch.linalg.cross(q[..., 1:], twice)


def integrate(pos: Tensor, rot: Tensor, velocity: Tensor, turn: Tensor, dt: float) -> tuple[Tensor, Tensor]:
    half = rotate(rot, turn * dt) / 2.0
    angle = torch.linalg.norm(half, dim=-1, keepdim=True)
    safe = torch.where(angle < 1e-5, 1.0, angle)
    linear = torch.cat([torch.ones_like(angle), half], -1)
    linear = linear / (torch.linalg.norm(linear, dim=-1, keepdim=True) + 1e-5)
    step = torch.where(angle < 1e-5, linear, torch.cat([torch.cos(safe), half * torch.sin(safe) / safe], -1))
    w, v, a, b = step[..., :1], step[..., 1:], rot[..., :1], rot[..., 1:]
    turned = torch.cat([w * a - (v * b).sum(-1, keepdim=True), w * b + a * v + torch.linalg.cross(v, b)], -1)
    return pos + rotate(rot, velocity * dt), turned


def matrices(axes: Tensor) -> Tensor:
    """Rotations from the two predicted axes [..., 2, 3]."""
    x, toward_y = axes[..., 0, :], axes[..., 1, :]
    z = torch.linalg.cross(x, toward_y)
    columns = (x, torch.linalg.cross(z, x), z)
    return torch.stack([c / (torch.linalg.norm(c, dim=-1, keepdim=True) + 1e-10) for c in columns], -1)


def quaternion_matrix(q: Tensor) -> Tensor:
    basis = torch.eye(3).expand(*q.shape[:-1], 3, 3)
    return rotate(q[..., None, :].expand(*q.shape[:-1], 3, 4), basis).transpose(-1, -2)


def compared(body: Body, gaze: Tensor, parents: tuple[int, ...], dt: float) -> list[Tensor]:
    """What the 17 terms compare, in their order; joints one after the other, as a Python loop."""
    lead, joints = body.vector.shape[:2], len(parents)
    cuts = [3, 3, 3 * joints, 6 * joints, 3 * joints, 3 * joints]
    root_vel, root_ang, pos, axes, vel, ang = body.vector.split(cuts, -1)
    pos, vel, ang = (a.reshape(*lead, joints, 3) for a in (pos, vel, ang))
    axes = axes.reshape(*lead, joints, 2, 3)
    before = torch.cat([body.rot[:, :1], body.rot[:, :-1]], 1)
    root = (body.pos, quaternion_matrix(body.rot), rotate(before, root_vel), rotate(before, root_ang))
    mats, world = matrices(axes), []
    for j, parent in enumerate(parents):
        at, turn, speed, spin = world[parent] if parent >= 0 else root
        arm, own_vel, own_ang = ((turn @ a[:, :, j, :, None])[..., 0] for a in (pos, vel, ang))
        world.append((at + arm, turn @ mats[:, :, j], speed + own_vel + torch.linalg.cross(spin, arm), spin + own_ang))
    w_pos, w_rot, w_vel, w_ang = (torch.stack(parts, 2) for parts in zip(*world, strict=True))
    pairs = ((w_pos, pos), (w_vel, vel), (w_ang, ang))
    l_pos, l_vel, l_ang = (torch.cat([world[:, :, :1], own[:, :, 1:]], 2) for world, own in pairs)
    arm = gaze[:, None] - body.pos
    facing = rotate(conjugate(body.rot), arm / (torch.linalg.norm(arm, dim=-1, keepdim=True) + 1e-8))
    steps = [(a[:, 1:] - a[:, :-1]) / dt for a in (l_pos, axes, w_pos, w_rot)]
    return [*root, l_pos, axes, l_vel, l_ang, w_pos, w_rot, w_vel, w_ang, *steps, facing]


def loss(twin: Twin, batch: dict[str, Tensor], truth: Body, noise: Tensor, kl_weight: float, train: bool) -> Tensor:
    """ZeroEGGS Eq. 2 over a batch; without `train` no dropout."""
    mu, log_var = encode_style(twin, batch["example"], train)
    style = mu + torch.exp(0.5 * log_var) * noise
    speech = encode_speech(twin, batch["speech"], train)
    body = decode(twin, Body(*(a[:, :1] for a in truth)), speech, style, batch["gaze"])
    dt = twin.config.frame_time
    ours, theirs = (compared(b, batch["gaze"], twin.parents, dt) for b in (body, truth))
    weights = np.array(WEIGHTS).tolist()
    terms = [w * (a - b).abs().mean() for w, a, b in zip(weights, ours, theirs, strict=True)]
    kl = -0.5 * (1.0 + log_var - mu**2 - log_var.exp()).mean()
    return (sum(terms) + kl_weight * kl) / 18


def flat(tree: dict, at: str = "") -> Params:
    """A nested dict of arrays as a flat dict of trainable tensors."""
    found: Params = {}
    for name, value in tree.items():
        if isinstance(value, dict):
            found |= flat(value, f"{at}{name}/")
        else:
            found[at + name] = torch.tensor(np.asarray(value)).requires_grad_()
    return found
