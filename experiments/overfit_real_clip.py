"""The paper-size model overfitted on a few seconds of one real ZEGGS clip (ZeroEGGS Sec. 3): can it hold real motion?

    python experiments/overfit_real_clip.py --bvh CLIP.bvh --wav CLIP.wav -o runs/overfit

The BVH is the 30 fps form of take 067 whose arms rest in a T-pose; it is turned back into the release's joint frames
and brought to 60 fps. Trains closed loop on windows of the excerpt until the rollout over all of it stays below 2 cm
of mean joint error, then writes truth.bvh, model.bvh and a page with both. Run it again to go on where it stopped.
The output is made from CC BY-NC-ND material: keep it to yourself.
"""

import argparse
import json
import time
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float
from tqdm import tqdm

from zeggs_jax.data import scale
from zeggs_jax.data.scale import Scales
from zeggs_jax.geometry import quaternion
from zeggs_jax.motion import bvh, edit, features, kinematics, pose
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.features import Motion
from zeggs_jax.motion.pose import Pose
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import wav
from zeggs_jax.stage import player
from zeggs_jax.training import checkpoint
from zeggs_jax.training.optimiser import radam
from zeggs_jax.zeroeggs import losses
from zeggs_jax.zeroeggs.model import ZeroEggsConfig, decode, encode_speech, encode_style, init

GOAL = 2.0  # cm, mean over joints and frames


class Stage(NamedTuple):
    """A part of the training: windows grow from stage to stage, the frames of a step stay about the same."""

    window: int  # frames
    batch: int
    steps: int


STAGES = (Stage(8, 60, 300), Stage(20, 24, 150), Stage(60, 8, 150), Stage(120, 4, 150))


class Excerpt(NamedTuple):
    """The seconds to learn."""

    motion: Motion
    speech: Float[Array, "T F"]
    vectors: Float[Array, "T P"]
    scales: Scales
    clip: Clip


def release_frames(clip: Clip) -> Clip:
    """Joint frames of the release from the T-pose form: R = C[parent] R_file C[joint]^-1, o = C[parent] o_file.

    C turns by -90 degrees about z from RightShoulder down, by +90 from LeftShoulder down.
    """
    half = np.sqrt(0.5)
    turns = {"RightShoulder": (half, 0.0, 0.0, -half), "LeftShoulder": (half, 0.0, 0.0, half)}
    own, above = np.tile([1.0, 0.0, 0.0, 0.0], (2, len(clip.skeleton), 1))
    for joint, (name, parent) in enumerate(zip(clip.skeleton.names, clip.skeleton.parents, strict=True)):
        if parent >= 0:
            above[joint] = own[parent]
        own[joint] = turns.get(name, above[joint])
    with jax.enable_x64(True):
        local = features.local_quaternions(clip)
        inner = np.asarray(quaternion.inverse(own))
        local = quaternion.multiply(quaternion.multiply(above[None], local), inner[None])
        offsets = np.asarray(quaternion.rotate(above, clip.skeleton.offsets))
    positions = np.tile(offsets[None], (len(clip.euler), 1, 1))
    positions[:, 0] = clip.positions[:, 0]
    body = Skeleton(clip.skeleton.names, clip.skeleton.parents, offsets, clip.skeleton.roles)
    clip = clip._replace(skeleton=body, orders=("zyx",) * len(body))
    return features.with_quaternions(clip, np.asarray(local), positions)


def read_excerpt(bvh_path: Path, wav_path: Path, start: float, seconds: float, rate: float) -> Excerpt:
    """`seconds` of the take from `start` on, at `rate` frames per second, with statistics of its own."""
    clip = edit.resample(release_frames(bvh.read(bvh_path)), rate)
    clip = edit.trim(clip, round(rate * start), round(rate * (start + seconds)))
    wave = wav.read(wav_path)[round(16000 * start) : round(16000 * (start + seconds))]
    motion = features.encode(clip)
    speech = speech_features.extract(wave, len(clip.euler), rate)
    vectors = jax.vmap(pose.to_vector)(motion.pose)
    gaze = jax.vmap(pose.gaze_direction, (0, None))(motion.pose.root, motion.gaze)
    scales = scale.fit([speech], [np.asarray(vectors)], [np.asarray(gaze)], len(clip.skeleton))
    return Excerpt(motion, jnp.asarray(speech), vectors, jax.tree.map(jnp.asarray, scales), clip)


def mean_joint_error(predicted: Pose, target: Pose, parents: tuple[int, ...]) -> Array:
    """Mean distance of all joints in world over all frames, cm."""
    world = jax.vmap(lambda p: kinematics.forward(p, parents).pos)
    return jnp.linalg.norm(world(predicted) - world(target), axis=-1).mean()


def rollout(params: Any, excerpt: Excerpt, config: ZeroEggsConfig, start: Array, frames: int) -> tuple[Pose, Pose]:
    """(predicted, true) poses of `frames` frames from `start` on, closed loop; the style is the excerpt's mean."""
    cut = partial(jax.lax.dynamic_slice_in_dim, start_index=start, slice_size=frames)
    target = jax.tree.map(cut, excerpt.motion.pose)
    speech = encode_speech(params, config, excerpt.scales, excerpt.speech)
    style = encode_style(params, config, excerpt.scales, excerpt.vectors).mean
    first = jax.tree.map(lambda x: x[0], target)
    hold = lambda x: jnp.tile(x[None], (frames, 1))  # noqa: E731
    return decode(params, config, excerpt.scales, first, cut(speech), hold(style), hold(excerpt.motion.gaze)), target


def train(excerpt: Excerpt, out: Path, args: argparse.Namespace) -> tuple[Any, float, float]:
    """Trains until the whole rollout is below GOAL; returns parameters, error in cm, seconds of training."""
    parents, frames = excerpt.clip.skeleton.parents, len(excerpt.clip.euler)
    config = ZeroEggsConfig(frame_time=excerpt.clip.frame_time)
    params = init(jax.random.key(0), config)
    total = sum(stage.steps for stage in STAGES)
    rate = optax.cosine_decay_schedule(args.learning_rate, total, 0.02)
    optimiser = optax.chain(optax.clip_by_global_norm(1.0), radam(rate))
    state = (params, optimiser.init(params), jnp.zeros((), jnp.int32), jnp.zeros(()))
    if checkpoint.is_checkpoint(out / "state"):
        state, _ = checkpoint.load(out / "state", state)

    @partial(jax.jit, donate_argnums=(0, 1), static_argnames="stage")
    def step(params, opt_state, key, stage):
        starts = jax.random.randint(key, (stage.batch,), 0, frames - stage.window + 1).at[0].set(0)

        def loss(params):
            def one(start):
                predicted, target = rollout(params, excerpt, config, start, stage.window)
                terms = losses.reconstruction(predicted, target, excerpt.motion.gaze, parents, config.frame_time)
                return jnp.stack(jax.tree.leaves(terms)).sum() / 18.0

            return jnp.mean(jax.vmap(one)(starts))

        value, gradient = jax.value_and_grad(loss)(params)
        updates, opt_state = optimiser.update(gradient, opt_state, params)
        return optax.apply_updates(params, updates), opt_state, value

    error_of = jax.jit(lambda p: mean_joint_error(*rollout(p, excerpt, config, jnp.int32(0), frames), parents))
    params, opt_state, done, spent = state
    spent, error, begun = float(spent), float("inf"), time.monotonic()
    stages = [stage for stage in STAGES for _ in range(stage.steps)]
    bar = tqdm(range(int(done), total), initial=int(done), total=total, unit="step")
    for k in bar:
        key = jax.random.fold_in(jax.random.key(1), k)
        params, opt_state, value = step(params, opt_state, key, stages[k])
        if (k + 1) % args.every == 0 or k + 1 == total:
            error = float(error_of(params))
            bar.set_postfix(loss=f"{float(value):.4f}", error=f"{error:.2f} cm")
            elapsed = spent + time.monotonic() - begun
            checkpoint.save(out / "state", (params, opt_state, np.int32(k + 1), np.float32(elapsed)), {})
            if error < GOAL:
                break
    return params, error, spent + time.monotonic() - begun


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bvh", type=Path, required=True)
    parser.add_argument("--wav", type=Path, required=True)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--start", type=float, default=2.0, help="seconds into the take")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--rate", type=float, default=60.0, help="frames per second; the file has 30")
    parser.add_argument("--every", type=int, default=100, help="steps between checks of the whole rollout")
    parser.add_argument("--learning-rate", type=float, default=4e-4)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    excerpt = read_excerpt(args.bvh, args.wav, args.start, args.seconds, args.rate)
    params, error, seconds = train(excerpt, args.out, args)
    frames, config = len(excerpt.clip.euler), ZeroEggsConfig(frame_time=excerpt.clip.frame_time)
    predicted, _ = jax.jit(lambda p: rollout(p, excerpt, config, jnp.int32(0), frames))(params)
    made = features.decode(predicted, excerpt.clip.skeleton, config.frame_time)
    truth = features.decode(excerpt.motion.pose, excerpt.clip.skeleton, config.frame_time)
    wave = wav.read(args.wav)[round(16000 * args.start) : round(16000 * (args.start + args.seconds))]
    wav.write(args.out / "speech.wav", wave)
    for name, clip in (("truth", truth), ("model", made)):
        bvh.write(args.out / f"{name}.bvh", clip)
    player.write(
        args.out / "index.html",
        [player.Figure(name, clip, args.out / "speech.wav") for name, clip in (("truth", truth), ("model", made))],
        title="Overfitted on 8 s of take 067",
    )
    print(
        json.dumps(
            {
                "mean_joint_error_cm": round(error, 3),
                "frames": frames,
                "rate_hz": args.rate,
                "training_seconds": round(seconds),
            }
        )
    )


if __name__ == "__main__":
    main()
