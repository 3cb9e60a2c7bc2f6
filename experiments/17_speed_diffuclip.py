"""Seconds that a second of motion takes, against the solver's steps, and parameters of every part (Sec. 7's 1.5 s).

    python experiments/17_speed_diffuclip.py -o runs/speed [--sizes small paper] [--steps 5 10 20 50]

Random weights: only sizes count. A chunk of latents is denoised behind a full context with guidance (two evaluations a
step) and decoded, again and again; what is told is the median over --repeats. Text encoders are left out: they read a
window's words once a chunk. The paper: 1.5 s for 1 s of motion on one V100, 1000 steps. Parameters: counted from
shapes, nothing that large is made for them.
"""

import argparse
import os
import statistics
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

import ledger
from zeggs_jax.data.scale import Scale
from zeggs_jax.diffuclip import denoiser, guidance, model, vqvae
from zeggs_jax.diffuclip.config import SMALL, DiffuclipConfig
from zeggs_jax.diffuclip.denoiser import Conditions
from zeggs_jax.diffuclip.sampling import Settings
from zeggs_jax.synthetic import body

NAME = "17_speed_diffuclip"
SIZES = {"small": SMALL, "paper": DiffuclipConfig()}
SOLVER = "dpm"


def parameters(config: DiffuclipConfig) -> dict[str, int]:
    """How many numbers each component has; CLIP's towers, which are read from a folder, are not among them."""
    shapes = jax.eval_shape(lambda key: model.init(key, config, body.rest_skeleton()), jax.random.key(0))
    return {name: sum(int(np.prod(leaf.shape)) for leaf in jax.tree.leaves(part)) for name, part in shapes.items()}


def conditions(config: DiffuclipConfig, latents: int) -> Conditions:
    """A window with half of its words there."""
    words, rng = config.joint.words, np.random.default_rng(0)
    heard = rng.random((latents + config.denoiser.ahead, 2), np.float32)
    mask = np.arange(words) < words // 2
    return Conditions(
        jnp.asarray(heard), jnp.asarray(rng.normal(size=(words, config.joint.width)), jnp.float32),
        jnp.asarray(mask, jnp.float32), jnp.linspace(0.0, latents, words), jnp.asarray(mask),
        jnp.zeros(config.prompts.size), jnp.asarray(True),
    )  # fmt: skip


def chunk_times(config: DiffuclipConfig, steps: int, repeats: int) -> list[float]:
    """Seconds of each repeat, for a chunk."""
    keys = jax.random.split(jax.random.key(0), 4)
    skeleton = body.rest_skeleton()
    params, coder = denoiser.init(keys[0], config), vqvae.init(keys[1], config, skeleton)
    settings = Settings(SOLVER, steps, chunk=config.diffusion.chunk, context=config.diffusion.context)
    told = conditions(config, settings.context + settings.chunk)
    wish = guidance.whole(np.ones(config.prompts.size, np.float32) / config.prompts.size**0.5, 2.0, config)
    context = jax.random.normal(keys[2], (settings.context, config.latent_size))
    noise = jax.random.normal(keys[3], (settings.chunk, config.latent_size))
    z_scale, motion_scale = (Scale(np.zeros(n, np.float32), np.ones(n, np.float32)) for n in sizes(config))
    extend = partial(guidance.extend, params, config, settings, 0.0)
    decode = jax.jit(model.decode, static_argnums=1)

    def run() -> Any:
        z = extend(context, settings.context, noise, (told, wish), keys[2])
        return jax.block_until_ready((z, decode(coder, config, z_scale, z), motion_scale.mean))

    run()
    taken = []
    for _ in tqdm(range(repeats), desc=f"{steps} steps", leave=False):
        start = time.perf_counter()
        run()
        taken.append(time.perf_counter() - start)
    return taken


def sizes(config: DiffuclipConfig) -> tuple[int, int]:
    """Numbers of a latent and of a motion frame."""
    return config.latent_size, config.motion_size


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", nargs="+", default=list(SIZES), choices=tuple(SIZES))
    parser.add_argument("--steps", type=int, nargs="+", default=[5, 10, 20, 50])
    parser.add_argument("--repeats", type=int, default=5)
    ledger.add_docs(parser)
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    rows, counts = [], {}
    for size in args.sizes:
        config = replace(SIZES[size], joints=len(body.rest_skeleton()))
        counts[size] = parameters(config)
        seconds = config.diffusion.chunk / config.latents_hz
        for steps in args.steps:
            taken = chunk_times(config, steps, args.repeats)
            middle = statistics.median(taken)
            rows.append({"size": size, "steps": steps, "per second": middle / seconds, "ms": 1e3 * middle / steps / 2})
    device = jax.devices()[0].device_kind
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    names = list(counts[args.sizes[0]])
    head = ["size", "steps", "s per s of motion", "ms per network evaluation"]
    body_ = [[r["size"], str(r["steps"]), f"{r['per second']:.3g}", f"{r['ms']:.3g}"] for r in rows]
    sized = [[size, *(f"{of[n]:,}" for n in names), f"{sum(of.values()):,}"] for size, of in counts.items()]
    text = (
        f"Device: {device} ({os.cpu_count()} cores{load}), float32, solver {SOLVER}, jax {jax.__version__}:\n\n"
        f"{ledger.table(head, body_)}\n\n{ledger.table(['parameters', *names, 'all'], sized)}"
    )
    ledger.tell(text, NAME, args.docs)
    ledger.save(args.out / "speed.json", {"device": device, "rows": rows, "parameters": counts})


if __name__ == "__main__":
    main()
