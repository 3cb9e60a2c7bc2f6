"""Stage 3, the joint space (Sec. 5): sentences and their gestures agree (Eq. 4-6), taught by momentum copies."""

from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Bool, Float
from numpy import ndarray

from ...speech import transcript
from ...speech.transcript import Word
from ...training import ranks
from ...training.step import Metrics, Step, TrainState, begin
from .. import joint_embedding, t5, tokens
from ..config import DiffuclipConfig
from ..tokens import Tokens
from .stage import Encoded, Material, Params, Stage, Take, optimiser, window

SHORTEST_S, LONGEST_S = 1.0, 15.0  # of a sentence (Sec. 5)
AROUND_S = 0.5  # a gesture may begin so long before its sentence and end so long after it
NEIGHBOURS = 4  # a batch is drawn from so many batches' worth of sentences of similar length
LEFT_OUT = 0.15  # share of words and latents that the contrast does not see, or it learns sentences by heart
WHOLE = 0.25  # share of the batches that are drawn from all sentences instead


class Spoken(NamedTuple):
    """A sentence of a take and its words."""

    take: int
    words: tuple[Word, ...]

    @property
    def seconds(self) -> float:
        """From the first word's beginning to the last one's end."""
        return self.words[-1].end - self.words[0].start


class Pair(NamedTuple):
    """A sentence and the latents spoken with it."""

    spoken: Tokens
    quantised: Float[Array | ndarray, "L C"]
    mask: Bool[Array | ndarray, " L"]


def stage(config: DiffuclipConfig, material: Material, params: dict[str, Params]) -> Stage:
    """The stage; the gesture encoder begins as pretrained in `params`, the text encoder anew or from T5's folder.

    Raises:
        ValueError: fewer than two sentences of 1 to 15 s in the split 'train'; a T5 without a folder.
    """
    said = {split: sentences(config, material, split) for split in ("train", "valid")}
    if len(said["train"]) < 2:
        raise ValueError(
            f"the corpus has {len(said['train'])} spoken sentences of {SHORTEST_S:g} s or longer to train on; give "
            "transcripts with timed words."
        )
    steps = optimiser(config.learn_joint)
    epoch = max(len(said["train"]) // config.learn_joint.batch, 1)
    held = [pair(config, material, one, None) for one in said["valid"]]
    return Stage(
        begin=lambda key: begin(_start(key, config, params.get("joint", {})), steps, averaged=True),
        step=make_step(config, steps, epoch),
        batch=lambda k: batch(config, material, said["train"], k),
        finish=lambda state: state.params,
        validate=partial(validate, config, held) if len(held) > 1 else None,
    )


def _start(key: Array, config: DiffuclipConfig, learnt: Params) -> Params:
    """Drawn parameters but for what is learnt; a T5 comes from its folder."""
    joint = config.joint
    if joint.text == "t5" and "text" not in learnt and not joint.folder:
        raise ValueError("joint.text is 't5', which begins from published weights; set joint.folder to T5's folder.")
    t5_params = t5.load(joint.folder) if joint.text == "t5" and "text" not in learnt else None
    return joint_embedding.init(key, config, t5_params) | learnt


def sentences(config: DiffuclipConfig, material: Material, split: str) -> list[Spoken]:
    """All sentences of a split, by length; those that are too long for the encoders are cut into pieces at words."""
    longest = min(LONGEST_S, config.learn_joint.seconds, config.joint.latents / config.latents_hz) - 2 * AROUND_S
    found = []
    for i, take in enumerate(material.takes):
        if take.split == split and take.words:
            pieces = [cut for one in transcript.sentences(take.words) for cut in _cut(one.words, longest, config)]
            found += [Spoken(i, words) for words in pieces]
    return sorted((one for one in found if one.seconds >= SHORTEST_S), key=lambda one: one.seconds)


def _cut(words: tuple[Word, ...], longest: float, config: DiffuclipConfig) -> list[tuple[Word, ...]]:
    """The words in pieces, as few as possible and about equally many words each, of at most `longest` s."""
    for pieces in range(1, len(words) + 1):
        edges = np.linspace(0, len(words), pieces + 1).round().astype(int)
        cuts = [words[a:b] for a, b in pairwise(edges)]
        if all(cut[-1].end - cut[0].start <= longest and len(cut) <= config.joint.words for cut in cuts):
            return cuts
    return [(word,) for word in words]


def batch(config: DiffuclipConfig, material: Material, said: list[Spoken], k: int) -> Pair:
    """Batch k: sentences of similar length, so that their meaning and not their length tells them apart."""
    settings, draw = config.learn_joint, np.random.default_rng([config.seed, 3, k])
    near = min(NEIGHBOURS * settings.batch, len(said))
    first = int(draw.integers(0, len(said) - near + 1))
    pool = np.arange(len(said)) if draw.random() < WHOLE else np.arange(first, first + near)
    picked = draw.choice(pool, settings.batch, replace=len(pool) < settings.batch)
    rows = [pair(config, material, said[i], draw) for i in picked]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *rows)


def pair(config: DiffuclipConfig, material: Material, one: Spoken, draw: np.random.Generator | None) -> Pair:
    """A sentence and its gesture, with a random margin before and after it; without `draw`, half the most."""
    take: Take = material.takes[one.take]
    encoded: Encoded = material.encoded[one.take]
    hz, length = config.latents_hz, config.joint.latents
    before, after = (0.5, 0.5) if draw is None else draw.random(2)
    start = max(int((one.words[0].start - AROUND_S * before) * hz), 0)
    stop = min(int(np.ceil((one.words[-1].end + AROUND_S * after) * hz)), len(encoded.quantised), start + length)
    quantised, mask = window(encoded.quantised[:stop], start, length)
    read = joint_embedding.reader(config.joint)
    assert take.words
    return Pair(tokens.tokenize(one.words, config.joint, read, start / hz), quantised, mask)


def embed(params: Params, config: DiffuclipConfig, pairs: Pair, keys: Any = None) -> tuple[Array, Array]:
    """(z^t [B, D], z^g [B, D]) of a batch, of length 1 where cosines are compared.

    With keys [B, 2] as in training: dropout, and a share `LEFT_OUT` of the words and latents is not seen.
    """

    def each(one: Pair, key: Any) -> tuple[Array, Array]:
        spoken, hidden, first, second = one.spoken, None, None, None
        if key is not None:
            first, second = key[0], key[1]
            seen = spoken.mask & ~_left_out(first, len(spoken.mask))
            spoken = spoken._replace(mask=jnp.where(seen.any(), seen, spoken.mask))
            hidden = _left_out(second, len(one.mask))
        text = joint_embedding.encode_text(params, config, spoken, first).pooled
        gesture = joint_embedding.encode_gesture(params, config, one.quantised, one.mask, hidden, second).pooled
        return text, gesture

    z_t, z_g = jax.vmap(each, in_axes=(0, None if keys is None else 0))(pairs, keys)
    return (joint_embedding.unit(z_t), joint_embedding.unit(z_g)) if config.joint.normalise else (z_t, z_g)


def _left_out(key: Array, length: int) -> Bool[Array, " T"]:
    return jax.random.bernoulli(jax.random.fold_in(key, 1), LEFT_OUT, (length,))


def make_step(config: DiffuclipConfig, steps: optax.GradientTransformation, epoch: int) -> Step:
    """One update of Eq. 6, jitted; the teachers are `state.average`. Their weight rises over the first `epoch`."""
    joint = config.joint

    def loss_fn(params: Params, teacher: Params, pairs: Pair, keys: Array, weight: Array) -> tuple[Array, Array]:
        student, told = embed(params, config, pairs, keys), embed(teacher, config, pairs)
        plain = joint_embedding.contrastive(*student, joint.temperature)
        return joint_embedding.distilled(student, told, joint.temperature, weight), plain

    def step(state: TrainState, pairs: Pair) -> tuple[TrainState, Metrics]:
        keys = jax.random.split(jax.random.fold_in(jax.random.key(config.seed), state.step), (len(pairs.mask), 2))
        weight = joint.distilled * jnp.minimum(1.0, state.step / epoch)
        gradient = jax.value_and_grad(loss_fn, has_aux=True)
        (loss, plain), grads = gradient(state.params, state.average, pairs, keys, weight)
        updates, opt_state = steps.update(grads, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        teacher = jax.tree.map(lambda a, p: a + (1.0 - joint.momentum) * (p - a), state.average, params)
        metrics = {"loss": loss, "contrast": plain, "gradient": optax.tree.norm(grads)}
        return TrainState(state.step + 1, params, opt_state, teacher), metrics

    return jax.jit(step, donate_argnums=0)


_embed = jax.jit(embed, static_argnames="config")


def embedded(params: Params, config: DiffuclipConfig, pairs: list[Pair]) -> tuple[np.ndarray, np.ndarray]:
    """(z^t [N, D], z^g [N, D]) of many pairs, by a batch at a time."""
    size, rows = config.learn_joint.batch, []
    for k in range(0, len(pairs), size):
        some = pairs[k : k + size]
        filled = jax.tree.map(lambda *leaves: np.stack(leaves), *some, *[some[0]] * (size - len(some)))
        rows.append([np.asarray(z)[: len(some)] for z in _embed(params, config, filled)])
    z_t, z_g = (np.concatenate(column) for column in zip(*rows, strict=True))
    return z_t, z_g


def validate(config: DiffuclipConfig, held: list[Pair], state: TrainState) -> dict[str, float]:
    """Eq. 4-5 on the first held-out sentences of a batch; among all of them, R@k both ways and chance."""
    z_t, z_g = embedded(state.params, config, held)
    some = np.random.default_rng(0).permutation(len(held))[: config.learn_joint.batch]
    found = {"loss": float(joint_embedding.contrastive(z_t[some], z_g[some], config.joint.temperature))}
    for way, similarity in {"words_to_gesture": z_t @ z_g.T, "gesture_to_words": z_g @ z_t.T}.items():
        places = ranks.ranks(similarity)
        found |= {f"{way}_r{k}": ranks.recall(places, k) for k in (1, 5, 10)}
    return found | {"chance_r10": min(10 / len(held), 1.0)}
