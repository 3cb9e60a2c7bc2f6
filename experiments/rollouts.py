"""What a trained model does closed loop: error on unseen clips, factors it shows, rhythm, variety, where it turns."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import ledger
import truth
from zeggs_jax.data import windows
from zeggs_jax.data.prepared import Prepared
from zeggs_jax.data.windows import WindowConfig
from zeggs_jax.metrics import kinematic, rhythm
from zeggs_jax.metrics.factors import Ruler
from zeggs_jax.motion import bvh, kinematics
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import wav
from zeggs_jax.synthetic.styles import StyleFactors
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs import losses
from zeggs_jax.zeroeggs.model import Model, decode, encode_speech, encode_style

WINDOW_SECONDS, BATCHES, BATCH, SEED = 8.0, 3, 16, 77


def reconstruction(model: Model, arrays: Prepared) -> ledger.Row:
    """Closed loop over windows of the split 'valid', each steered by the example around it; style at its mean.

    `loss`: ZeroEGGS Eq. 2 without the divergence; `joint_cm`: mean distance of all joints, in world; `first_cm`: the
    same over the first second after the given pose; `hands_cm`: both hands.
    """
    rate_hz = bvh.rate_hz(arrays.frame_time)
    frames = round(WINDOW_SECONDS * rate_hz) // 2 * 2
    shape = WindowConfig(BATCH, frames, (frames, frames))
    one = jax.jit(jax.vmap(partial(_compare, config=model.config, parents=arrays.skeleton.parents), (None, None, 0)))
    terms, apart = [], []
    for k in range(BATCHES):
        batch = windows.batch(arrays, SEED, k, shape, split="valid")
        loss, distance = one(model.params, model.scales, batch)
        terms.append(np.asarray(loss).mean())
        apart.append(np.asarray(distance))
    error = np.concatenate(apart)  # [windows, T, J]
    hands = [arrays.skeleton.role("left_hand"), arrays.skeleton.role("right_hand")]
    return {
        "loss": float(np.mean(terms)),
        "joint_cm": float(error.mean()),
        "first_cm": float(error[:, 1 : 1 + round(rate_hz)].mean()),
        "hands_cm": float(error[:, :, hands].mean()),
    }


def _compare(params, scales, clip, config, parents):
    """(loss without divergence, distance of every joint [T, J] in cm) of one window of a batch."""
    speech = encode_speech(params, config, scales, jnp.asarray(clip.speech))
    style = encode_style(params, config, scales, jnp.asarray(clip.example), clip.example_length).mean
    frames = speech.shape[0]
    hold = lambda x: jnp.broadcast_to(x, (frames, *x.shape))  # noqa: E731
    first = jax.tree.map(lambda x: x[0], clip.poses)
    made = decode(params, config, scales, first, speech, hold(style), hold(clip.gaze))
    terms = losses.reconstruction(made, clip.poses, hold(clip.gaze), parents, config.frame_time)
    world = jax.vmap(lambda pose: kinematics.forward(pose, parents).pos)
    distance = jnp.linalg.norm(world(made) - world(clip.poses), axis=-1)
    return losses.total(terms, 0.0), distance


def shown(
    model: Model, ruler: Ruler, factors: StyleFactors, clip: Path, wave: np.ndarray, frames: tuple[int, int]
) -> ledger.Row:
    """One speech in the style of one clip: `share`, the mean error of its factors over their spans, and the rhythm."""
    made = g.generate(wave, g.Request(styles=(str(clip),), frames=(frames,)), model=model).clip
    return {**truth.errors(truth.recovered(ruler, made), factors), **beat(made, wave)}


def beat(clip: bvh.Clip, wave: np.ndarray) -> ledger.Row:
    """Correlation of hand speed with speech energy: `matched`, and `shifted` with the same speech moved in time."""
    rate_hz = bvh.rate_hz(clip.frame_time)
    energy = np.asarray(speech_features.frame_energy(wave, len(clip.euler), rate_hz), np.float64)
    found = rhythm.agreement(kinematic.hand_speed(clip), energy, rate_hz)
    return {"matched": found.matched, "shifted": found.shifted}


def variety(model: Model, clip: Path, wave: np.ndarray, seeds: Sequence[int] = (1, 2, 3)) -> float:
    """How far the hands of samples of one style are from their mean, cm."""
    hands = []
    for seed in seeds:
        made = g.generate(wave, g.Request(styles=(str(clip),), seed=seed), model=model).clip
        joints = [made.skeleton.role("left_hand"), made.skeleton.role("right_hand")]
        hands.append(kinematic.world_positions(made)[:, joints])
    apart = np.stack(hands) - np.mean(hands, axis=0)
    return float(np.linalg.norm(apart, axis=-1).mean())


def minute(model: Model, clip: Path, waves: Sequence[np.ndarray]) -> ledger.Row:
    """A minute of speech: `drift_cm`, how far the hips go; `turned_deg`, how far it looks away in the last 10 s."""
    wave = np.resize(np.concatenate(waves), 60 * wav.RATE_HZ)
    made = g.generate(wave, g.Request(styles=(str(clip),)), model=model).clip
    yaw = heading(made)
    last = round(10.0 * bvh.rate_hz(made.frame_time))
    return {
        "drift_cm": kinematic.root_drift(made),
        "turned_deg": float(np.degrees(np.abs(yaw[-last:] - yaw[0]).mean())),
    }


def heading(clip: bvh.Clip) -> np.ndarray:
    """Turn of the shoulders' line about y, rad [T], continuous."""
    skeleton, positions = clip.skeleton, kinematic.world_positions(clip)
    arms = [skeleton.parents[skeleton.parents[skeleton.role(hand)]] for hand in ("left_hand", "right_hand")]
    across = positions[:, arms[0]] - positions[:, arms[1]]
    return np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))
