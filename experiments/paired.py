"""Speech with meaning, performed: FGD, SRGR, SC (Eq. 20) and whether the right gesture comes at its word."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

import ledger
import prompted
from prompted import Ask, Bench, Said
from zeggs_jax.data import scale
from zeggs_jax.diffuclip import vqvae
from zeggs_jax.diffuclip.model import Model, latents_of
from zeggs_jax.diffuclip.stages import joint
from zeggs_jax.diffuclip.stages.stage import Encoded, Material
from zeggs_jax.metrics import feature_net, frechet, meaning, movement, net_file, srgr
from zeggs_jax.metrics.feature_net import FeatureNet, FeatureNetConfig
from zeggs_jax.metrics.meaning import Detector
from zeggs_jax.metrics.movement import Movement
from zeggs_jax.speech import wav
from zeggs_jax.synthetic.styles import StyleFactors
from zeggs_jax.zeroeggs import generate as zeroeggs

TRUTH = "truth"
TEXT, MOTION = "ours, text prompt", "ours, motion prompt"
SILENT = "ours, text prompt, no transcript"
ZEROEGGS = "ZeroEGGS, motion prompt"
CONDITIONS = (TEXT, SILENT, MOTION, ZEROEGGS)
NET = FeatureNetConfig(steps=800)
NET_CLIPS, DETECTOR_CLIPS = 60, 120


class Instruments(NamedTuple):
    """What the performances are measured with, all made from clips of the split train."""

    net: FeatureNet
    detector: Detector
    own: meaning.Own  # of the detector
    weights: str  # the net's fingerprint: distances of other nets are not comparable


def instruments(bench: Bench) -> Instruments:
    """The feature net, which is kept, and the detector of meanings."""
    train = bench.of("train")
    moves = [prompted.movement(bench.model, said.take.motion) for said in train[:DETECTOR_CLIPS]]
    words = [said.meanings for said in train[:DETECTOR_CLIPS]]
    path = bench.out / "net.npz"
    if not path.exists():
        np.savez(path, **net_file.pack(feature_net.train(moves[:NET_CLIPS], NET)))  # pyright: ignore
    with np.load(path) as arrays:
        net = net_file.unpack(arrays)
    own = meaning.own_accuracy(moves, words, folds=min(5, len(moves)))
    return Instruments(net, meaning.fit(moves, words), own, net.fingerprint[:12])


def chosen(bench: Bench, clips: int) -> list[Said]:
    """Valid clips that say something, spread over the split."""
    able = [said for said in bench.of("valid") if said.meanings and said.take.words]
    if not able:
        raise ValueError(
            "no clip of the corpus has words with a gesture of their own; make it by 13_meaning_corpus.py."
        )
    return able[:: max(len(able) // clips, 1)][:clips]


def true(bench: Bench, at: Instruments, clips: Sequence[Said]) -> ledger.Row:
    """The truth itself, by the same measures."""
    moves = [prompted.movement(bench.model, said.take.motion) for said in clips]
    latents = [latents_of(bench.model, said.take.motion) for said in clips]
    found = measure(bench, at, clips, moves, latents)
    every = [prompted.movement(bench.model, said.take.motion) for said in chosen(bench, len(bench.said))]
    try:
        found["fgd"] = frechet.between_halves([frechet.moments(feature_net.embed(at.net, move)) for move in every], 0)
    except ValueError as error:
        print(f"the truth has no distance from itself: {error}")
        del found["fgd"]
    return {"kind": "paired", "condition": TRUTH, "sampling": 0, **found}


def made(bench: Bench, at: Instruments, clips: Sequence[Said], condition: str, sampling: int) -> ledger.Row:
    """One sampling of a condition: all clips' speech performed, and measured beside the truth."""
    if condition == ZEROEGGS:
        moves, latents = [by_zeroeggs(bench, said, k, sampling) for k, said in enumerate(clips)], []
    else:
        by_motion, asked = condition == MOTION, []
        for k, said in enumerate(clips):
            own = (
                prompted.of_motion(bench, shown(bench, said, sampling)) if by_motion else of_text(bench, said, sampling)
            )
            asked.append(Ask(said, prompted.wish(bench, own), 100 * sampling + k, spoken=condition != SILENT))
        found = prompted.perform(bench, asked)
        moves, latents = [one.movement for one in found], [one.latents for one in found]
    row = measure(bench, at, clips, moves, latents)
    return {"kind": "paired", "condition": condition, "sampling": sampling, **row}


def of_text(bench: Bench, said: Said, sampling: int) -> np.ndarray:
    """The prompt of a caption of the clip that no training has seen."""
    texts = said.notes.get("held_out_captions") or said.take.captions
    return prompted.of_text(bench, texts[sampling % len(texts)])


def shown(bench: Bench, said: Said, sampling: int):
    """Another clip of the same style."""
    factors = StyleFactors(**said.notes["factors"])
    return prompted.example(bench, said.take.name, factors, sampling % 2)


def by_zeroeggs(bench: Bench, said: Said, number: int, sampling: int) -> Movement:
    """The bundled ZeroEGGS to the same speech, in the style of the clip that the motion prompt is."""
    wave = wav.read(said.wav)
    example = str(shown(bench, said, sampling))
    asked = zeroeggs.Request(styles=(example,), seed=100 * sampling + number)
    move = movement.of(zeroeggs.generate(wave, asked).clip)
    return prompted.cut(move, 0.0, len(said.take.motion) * bench.model.config.frame_time)


def measure(
    bench: Bench, at: Instruments, clips: Sequence[Said], moves: Sequence[Movement], latents: Sequence[np.ndarray]
) -> ledger.Row:
    """FGD, SRGR, share of words with their gesture (also of trained words and of held-out synonyms), SC."""
    truth = [prompted.movement(bench.model, said.take.motion) for said in clips]
    words = [said.meanings for said in clips]
    found = meaning.presence(at.detector, moves, words)
    rows: ledger.Row = {
        "right": found.share,
        "chance": found.chance,
        "meanings": found.of_meaning,
        "words": found.words,
    }
    for name, unseen in (("right, trained words", False), ("right, synonyms", True)):
        own = [k for k, said in enumerate(clips) if said.notes["meanings"][0]["synonym"] == unseen]
        if own:
            rows[name] = meaning.presence(at.detector, [moves[k] for k in own], [words[k] for k in own]).share
    rows["srgr"] = float(np.mean([_srgr(*each) for each in zip(moves, truth, words, strict=True)]))
    rows["fgd"] = frechet.gesture_distance(at.net, moves, truth)
    return rows | ({"sc": similarity(bench.model, clips, latents)} if latents else {})


def _srgr(made: Movement, truth: Movement, words: Sequence[meaning.Said]) -> float:
    """Of elbows and hands, from the hips: standing still has all the rest within 10 cm."""
    frames, skeleton = min(len(made.positions), len(truth.positions)), truth.skeleton
    hands = [skeleton.role("left_hand"), skeleton.role("right_hand")]
    joints = [skeleton.role("hips"), *hands, *(skeleton.parents[hand] for hand in hands)]
    weights = srgr.semantic_weights(words, frames, truth.rate_hz)
    found = srgr.srgr(made.positions[:frames, joints], truth.positions[:frames, joints], weights)
    return (len(joints) * found - 1.0) / (len(joints) - 1.0)  # the hips themselves are always right


def similarity(model: Model, clips: Sequence[Said], latents: Sequence[np.ndarray]) -> float:
    """SC (Eq. 20): mean cosine of sentences and the gestures made to them, in the model's own joint space."""
    takes = [said.take._replace(split="valid") for said in clips]
    encoded = [Encoded(z, np.asarray(_quantised(model, z)), np.zeros((len(z), 1), np.int32)) for z in latents]
    material = Material(takes, model.motion_scale, model.skeleton, encoded, model.latent_scale)
    pairs = [joint.pair(model.config, material, one, None) for one in joint.sentences(model.config, material, "valid")]
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *pairs)
    texts, gestures = _embed(model.params["joint"], model.config, stacked)
    unit = [x / np.linalg.norm(x, axis=-1, keepdims=True) for x in (np.asarray(texts), np.asarray(gestures))]
    return float((unit[0] * unit[1]).sum(-1).mean())


def _quantised(model: Model, latents: np.ndarray) -> jax.Array:
    found, _ = vqvae.quantise(model.params["codes"], model.config, scale.invert(model.latent_scale, latents))
    return scale.apply(model.latent_scale, found)


_embed = jax.jit(joint.embed, static_argnames="config")
