"""The paper's sizes (Ao et al. 2023) on ZEGGS or BEAT: parameters, work, memory and disk beforehand; then the training.

    python experiments/19_paper_diffuclip.py                                             # only the estimates
    python experiments/19_paper_diffuclip.py CORPUS -o runs/paper --t5 T5 --clip CLIP    # ... and all stages
    zeggs diffuclip generate speech.wav --transcript words.TextGrid --prompt old --checkpoint runs/paper -o a.bvh

CORPUS is a folder of name.bvh + name.wav + a transcript with word times (name.TextGrid, .json, .srt), as ZEGGS or BEAT
unpack. T5 and CLIP are local folders as Hugging Face lays them out: T5-base, and a CLIP whose vectors have 768 numbers
(ViT-L/14), each with model.safetensors and tokenizer.json (pip install 'zeggs-jax[prompts]'). --parts gives the upper
and the lower body codes of their own (Sec. 6.3). Ctrl-C saves, the same command goes on.

The estimates are counted, not measured: multiplications and additions of the networks' own programs (XLA's count of one
clip's forward pass), three forward passes for an update, the short denoising of the perceptual losses with its
recomputation. What a device sustains is for you to fill in; activations and the input are not in the memory.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from zeggs_jax.diffuclip import denoiser, joint_embedding, model, prompts, train, video_encoder, vqvae, weights
from zeggs_jax.diffuclip.config import DiffuclipConfig, StageConfig
from zeggs_jax.diffuclip.tokens import Tokens
from zeggs_jax.motion import bvh
from zeggs_jax.zeroeggs import examples

HOURS = 35.0  # of ZEGGS and BEAT's English part, as the paper
SUSTAINED = (10.0, 50.0, 150.0)  # TFLOP/s
CLIP_VECTOR = 768  # of ViT-L/14
CLIP_PICTURE = 257 * 2 * 304e6  # FLOPs of its image tower: tokens of a picture, twice its parameters
COPIES = {"trained": 4, "frozen": 1}  # parameters, Adam's two moments, their average


class Row(NamedTuple):
    """What one stage trains, and how much work that is."""

    stage: str
    parameters: float
    settings: StageConfig
    forward: float  # FLOPs of one clip


def paper(t5: str = "", clip: str = "", parts: bool = False) -> DiffuclipConfig:
    """The paper's settings, with the folders of the published weights."""
    config = DiffuclipConfig(parts=("upper", "lower") if parts else ())
    return replace(config, joint=replace(config.joint, folder=t5), prompts=replace(config.prompts, clip=clip))


def count(params: Any) -> float:
    return float(sum(np.prod(leaf.shape) for leaf in jax.tree.leaves(params)))


def flops(function: Callable, *arguments: Any) -> float:
    """Of one call, as XLA counts them before it optimises; nothing is computed."""
    found = jax.jit(function).lower(*arguments).cost_analysis()
    assert found is not None, "this backend counts no FLOPs"
    return float(found["flops"])


def rows(config: DiffuclipConfig) -> Iterator[Row]:
    """Every stage of the training, in order."""
    skeleton = bvh.read(next(iter(examples.bundled().values()))).skeleton
    config = replace(config, joints=len(skeleton))
    like = jax.eval_shape(partial(model.init, config=config, skeleton=skeleton), jax.random.key(0))
    video = jax.eval_shape(partial(video_encoder.init, config=config, vector=CLIP_VECTOR), jax.random.key(0))
    hz, joint, size = config.latents_hz, config.joint, config.latent_size

    def latents(seconds: float, channels: int = size) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct((round(seconds * hz), channels), jnp.float32)

    def motion(frames: float) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct((round(frames), config.motion_size), jnp.float32)

    def whole(rows: int) -> np.ndarray:
        return np.ones(rows, bool)

    codes = config.learn_codes
    yield Row(
        "codes", count(like["codes"]), codes,
        flops(lambda p, m: vqvae.reconstruct(p, config, m), like["codes"], motion(codes.seconds / config.frame_time)),
    )  # fmt: skip
    z = latents(config.learn_joint.seconds)
    gesture = flops(lambda p, z: joint_embedding.encode_gesture(p, config, z, whole(len(z))).pooled, like["joint"], z)
    yield Row("gestures", count(like["joint"]["gesture"]), config.learn_gestures, gesture)
    spoken = Tokens(np.zeros(joint.words, np.int32), whole(joint.words), np.zeros(joint.words, np.float32))
    text = flops(lambda p: joint_embedding.encode_text(p, config, spoken).pooled, like["joint"])
    yield Row("joint", count(like["joint"]), config.learn_joint, text + gesture)
    seen = motion(config.prompts.frames)
    moved = flops(lambda p, m: prompts.encode_motion(p, config, m, whole(len(m))), like["prompts"], seen)
    yield Row("prompts", count(like["prompts"]), config.learn_prompts, moved)
    pictures = jax.ShapeDtypeStruct((config.prompts.video_frames, CLIP_VECTOR), jnp.float32)
    watched = flops(lambda p, v: video_encoder.encode(p, config, v), video, pictures)
    frozen = config.prompts.video_frames * CLIP_PICTURE / 3.0  # its tower is not trained: a forward pass is all
    yield Row("video", count(video), config.learn_video, watched + frozen)
    yield Row(
        "denoiser", count(like["denoiser"]), config.learn_denoiser,
        _denoiser(config, like, latents(config.learn_denoiser.seconds), text, gesture, moved),
    )  # fmt: skip


def _denoiser(config: DiffuclipConfig, like: Any, z: Any, text: float, gesture: float, moved: float) -> float:
    """A third of an update's work: the network, what it is told, and the perceptual losses behind a short denoising."""
    told = denoiser.nothing(config, z.shape[0])
    once = flops(lambda p, z: denoiser.apply(p, config, z, jnp.float32(500.0), told), like["denoiser"], z)
    decoded = flops(lambda p, z: vqvae.decode(p, config, z), like["codes"], z)
    short = config.diffusion.short_steps * 4.0 / 3.0 * once  # forward, again for the gradient, and the gradient
    return once + text / 3.0 + config.diffusion.perceptual * (short + decoded + gesture + moved)


def told(config: DiffuclipConfig, hours: float) -> str:
    """The estimates as a table."""
    found = list(rows(config))
    lines = [
        "| stage | parameters | updates x batch | EFLOPs | days at " + ", ".join(map(_short, SUSTAINED)) + " TFLOP/s |"
    ]
    lines += ["| --- | --- | --- | --- | --- |"]
    work = {row.stage: 3.0 * row.forward * row.settings.steps * row.settings.batch for row in found}
    for row in found:
        seen = f"{row.settings.steps:,} x {row.settings.batch}"
        lines.append(_line(row.stage, f"{row.parameters / 1e6:.1f} M", seen, work[row.stage]))
    network = found[-1].parameters + found[2].parameters + found[0].parameters + found[3].parameters
    lines.append(_line("all", f"{network / 1e6:.1f} M", "", sum(work.values())))
    largest = max(row.parameters for row in found)
    held = 4e-9 * (COPIES["trained"] * largest + COPIES["frozen"] * (network - largest))
    takes = 4e-9 * hours * 3600.0 * (config.motion_size / config.frame_time + 2 * config.latents_hz)
    kept = 4e-9 * (COPIES["trained"] * sum(row.parameters for row in found) + network)
    lines += [
        "",
        f"Memory for parameters, moments, averages: {held:.1f} GB; activations come on top and grow with the batch.",
        f"Disk: {takes:.0f} GB for {hours:g} h of motion at {1 / config.frame_time:g} frames/s, "
        f"{kept:.1f} GB of checkpoints.",
        "Main memory: the motion is held whole while training, as much as on disk.",
    ]
    return "\n".join(lines)


def _line(stage: str, parameters: str, seen: str, work: float) -> str:
    days = ", ".join(_short(work / (rate * 1e12) / 86400.0) for rate in SUSTAINED)
    return f"| {stage} | {parameters} | {seen} | {work / 1e18:.2f} | {days} |"


def _short(value: float) -> str:
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("corpus", type=Path, nargs="?", help="without: only the estimates")
    parser.add_argument("-o", "--out", type=Path, help="the folder of the run")
    parser.add_argument("--t5", default="", help="folder with T5-base")
    parser.add_argument("--clip", default="", help="folder with CLIP ViT-L/14")
    parser.add_argument("--parts", action="store_true", help="codes of their own for the upper and the lower body")
    parser.add_argument("--hours", type=float, default=HOURS, help="of motion, for the estimate of the disk")
    args = parser.parse_args()
    config = paper(args.t5, args.clip, args.parts)
    print(told(config, args.hours))
    if args.corpus is not None:
        if args.out is None:
            parser.error("give the run's folder with -o")
        weights.check(config)
        train.train(args.corpus, args.out, config)


if __name__ == "__main__":
    main()
