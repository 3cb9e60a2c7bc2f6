"""Milliseconds per generated frame at the paper's size, beside a plain PyTorch eager loop of the same sizes.

    taskset -c 0 python experiments/bench_decoder.py [--frames 600] [--repeats 7]

Both sides run closed loop on one core with random weights, one clip, float32, and take turns within one process; the
figures are medians. PyTorch comes with the extra `reference`. The ratio is what counts: machines differ.
"""

import argparse
import os
import statistics
import time

import jax
import jax.numpy as jnp
import numpy as np
import torch

from zeggs_jax.data.scale import Scale, Scales
from zeggs_jax.motion.pose import Pose, Root
from zeggs_jax.zeroeggs.model import ZeroEggsConfig, decode, init

JOINTS, HIDDEN, SPEECH, STYLE, DT = 75, 1024, 64, 64, 0.016667
POSE = 6 + 15 * JOINTS


class TorchDecoder(torch.nn.Module):
    """The recurrent decoder of the specification, written plainly: one Python loop, one frame a turn."""

    def __init__(self) -> None:
        super().__init__()
        width = POSE + 3 + SPEECH + STYLE
        self.embed = torch.nn.Linear(width, HIDDEN)
        self.gru = torch.nn.GRU(HIDDEN + width, HIDDEN, num_layers=2, batch_first=True)
        self.out = torch.nn.Linear(HIDDEN, POSE)

    def forward(self, vector, pos, rot, hidden, speech, style, gaze):
        rows = []
        for t in range(1, speech.shape[0]):
            look = rotate(rot * torch.tensor([1.0, -1.0, -1.0, -1.0]), gaze - pos)
            x = torch.cat([vector, look, speech[t], style])[None]
            embedded = torch.nn.functional.elu(self.embed(x))
            output, hidden = self.gru(torch.cat([embedded, x], dim=-1)[None], hidden)
            vector = self.out(output[0, 0])
            pos, rot = integrate(pos, rot, vector[:3], vector[3:6])
            rows.append(torch.cat([pos, rot, vector]))
        return torch.stack(rows)


def rotate(q, v):
    t = 2.0 * torch.linalg.cross(q[1:], v)
    return v + q[0] * t + torch.linalg.cross(q[1:], t)


def integrate(pos, rot, velocity, turn):
    half = rotate(rot, turn * DT) / 2.0
    angle = torch.linalg.norm(half) + 1e-8
    step = torch.cat([torch.cos(angle)[None], half * torch.sin(angle) / angle])
    w, v = step[0], step[1:]
    turned = torch.cat([(w * rot[0] - v @ rot[1:])[None], w * rot[1:] + rot[0] * v + torch.linalg.cross(v, rot[1:])])
    return pos + rotate(rot, velocity * DT), turned


def ours(frames: int):
    """A compiled call of `decode` on random weights and inputs."""
    config = ZeroEggsConfig()
    params = init(jax.random.key(0), config)
    unit = Scales(
        Scale(jnp.zeros(81), jnp.ones(81)),
        Scale(jnp.zeros(POSE + 3), jnp.ones(POSE + 3)),
        Scale(jnp.zeros(POSE), jnp.ones(POSE)),
    )
    z = jnp.zeros
    first = Pose(
        Root(z(3), jnp.array([1.0, 0, 0, 0])),
        z(3),
        z(3),
        z((JOINTS, 3)),
        z((JOINTS, 2, 3)),
        z((JOINTS, 3)),
        z((JOINTS, 3)),
    )
    rng = np.random.default_rng(0)
    speech, style = jnp.asarray(rng.normal(size=(2, frames, 64)), jnp.float32)
    gaze = jnp.tile(jnp.array([[0.0, 0.0, 100.0]]), (frames, 1))
    call = jax.jit(lambda p, s, e, g: decode(p, config, unit, first, s, e, g))
    return lambda: jax.block_until_ready(call(params, speech, style, gaze))


def theirs(frames: int):
    """A call of the PyTorch loop on random weights and inputs."""
    torch.manual_seed(0)
    decoder = TorchDecoder().eval()
    speech = torch.randn(frames, SPEECH)
    state = (torch.zeros(POSE), torch.zeros(3), torch.tensor([1.0, 0, 0, 0]), torch.zeros(2, 1, HIDDEN))
    gaze, style = torch.tensor([0.0, 0.0, 100.0]), torch.randn(STYLE)

    def call():
        with torch.no_grad():
            return decoder(*state, speech, style, gaze)

    return call


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=600)
    parser.add_argument("--repeats", type=int, default=7)
    args = parser.parse_args()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    torch.set_num_threads(1)
    calls = {"PyTorch eager": theirs(args.frames), "zeggs-jax": ours(args.frames)}
    times: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(args.repeats):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            times[name].append(1e3 * (time.perf_counter() - start) / args.frames)
    print(f"paper size, batch 1, {args.frames} frames, {cores} core(s), {args.repeats} interleaved repeats")
    for name, values in times.items():
        print(f"{name:14s} {statistics.median(values):6.2f} ms/frame   (min {min(values):.2f}, max {max(values):.2f})")
    ratio = statistics.median(times["PyTorch eager"]) / statistics.median(times["zeggs-jax"])
    print(f"ratio of medians: {ratio:.2f}x")


if __name__ == "__main__":
    main()
