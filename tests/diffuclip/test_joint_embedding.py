"""The joint space: padding changes nothing, Eq. 4-7 to the letter, the teacher is not trained."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import joint_embedding as je
from zeggs_jax.diffuclip import minilm, tokens
from zeggs_jax.diffuclip.config import CodesConfig, DiffuclipConfig, JointConfig
from zeggs_jax.diffuclip.tokens import Tokens
from zeggs_jax.speech.transcript import Word

JOINT = JointConfig("words", 16, 2, 2, text_layers=2, words=6, latents=8)
CONFIG = DiffuclipConfig(codes=CodesConfig(latent=5), joint=JOINT)
WORDS = tuple(Word(text, k, k + 0.5) for k, text in enumerate(("a", "big", "fish")))


def of_kind(kind):
    return dataclasses.replace(CONFIG, joint=dataclasses.replace(JOINT, text=kind))


@pytest.fixture(scope="module")
def params():
    return je.init(jax.random.key(0), CONFIG)


def features(kind, length):
    if kind == "words":
        return tokens.tokenize(WORDS, dataclasses.replace(JOINT, words=length))
    shape = (3, minilm.WIDTH) if kind == "minilm" else (3,)
    made = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    made = made if kind == "minilm" else np.array([5, 6, 7], np.int32)
    return tokens.tokenize(WORDS, dataclasses.replace(JOINT, words=length), lambda _: (made, np.arange(3)))


@pytest.mark.parametrize("kind", ["words", "minilm", "t5"])
def test_padding_of_a_text_changes_nothing(kind):
    config = of_kind(kind)
    text = je.init(jax.random.key(0), config)
    short, long = (je.encode_text(text, config, features(kind, length)) for length in (3, 6))
    np.testing.assert_allclose(long.words[:3], short.words, atol=2e-5)
    np.testing.assert_allclose(long.pooled, short.pooled, atol=2e-5)
    assert not np.asarray(long.words[3:]).any()
    assert np.asarray(short.pooled).any()


def test_padding_of_a_gesture_changes_nothing_not_even_where_all_is_negative(params):
    latents = np.random.default_rng(1).normal(size=(5, 5)).astype(np.float32)
    short = je.encode_gesture(params, CONFIG, latents, np.ones(5, bool))
    padded = np.concatenate([latents, np.full((3, 5), 50.0, np.float32)])
    long = je.encode_gesture(params, CONFIG, padded, np.arange(8) < 5)
    np.testing.assert_allclose(long.latents[:5], short.latents, atol=2e-5)
    np.testing.assert_allclose(long.pooled, short.pooled, atol=2e-5)
    np.testing.assert_allclose(short.pooled, np.asarray(short.latents).max(0), atol=1e-6)
    assert (np.asarray(short.pooled) < 0).any()  # zeros of the padding would win here


def test_no_words_are_finite_with_finite_gradients(params):
    silent = tokens.tokenize((), JOINT)

    def loss(params):
        text = je.encode_text(params, CONFIG, silent)
        return je.unit(text.pooled).sum() + je.saliency(*text, silent.mask, "rescaled", 0.1).sum()

    value, grads = jax.value_and_grad(loss)(params)
    assert float(value) == 0.0
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(grads))


def test_covered_latents_are_not_seen(params):
    latents = np.random.default_rng(1).normal(size=(5, 5)).astype(np.float32)
    hidden = np.array([False, True, True, False, False])
    other = np.where(hidden[:, None], 9.0, latents).astype(np.float32)
    a, b = (je.encode_gesture(params, CONFIG, x, np.ones(5, bool), hidden).latents for x in (latents, other))
    np.testing.assert_array_equal(a, b)
    seen = je.encode_gesture(params, CONFIG, latents, np.ones(5, bool)).latents
    assert np.abs(a - seen).max() > 1e-3


def test_a_key_drops_and_none_does_not(params):
    spoken = features("words", 6)
    plain = je.encode_text(params, CONFIG, spoken).pooled
    np.testing.assert_array_equal(plain, je.encode_text(params, CONFIG, spoken).pooled)
    assert np.abs(plain - je.encode_text(params, CONFIG, spoken, jax.random.key(1)).pooled).max() > 1e-3


def test_a_t5_of_another_width_is_refused():
    small = je.init(jax.random.key(0), of_kind("t5"))["text"]
    other = dataclasses.replace(of_kind("t5"), joint=dataclasses.replace(JOINT, text="t5", width=32))
    with pytest.raises(ValueError, match=r"of 16 numbers, expected 32; set joint\.width"):
        je.init(jax.random.key(0), other, small)


def test_the_papers_sizes_are_t5_base():
    """E_T has T5-base's 110 million parameters, E_G twelve blocks of BERT-base's size."""
    shapes = jax.eval_shape(lambda: je.init(jax.random.key(0), DiffuclipConfig()))
    count = {name: sum(leaf.size for leaf in jax.tree.leaves(part)) for name, part in shapes.items()}
    assert 109e6 < count["text"] < 110e6
    assert 85e6 < count["gesture"] < 86e6


# Eq. 7


def drawn(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


@pytest.mark.parametrize("mode", ["paper", "rescaled"])
@pytest.mark.parametrize("count", [1, 2, 6])
@pytest.mark.parametrize("seed", [0, 1])
def test_saliency_sums_to_one_or_to_the_number_of_words(seed, count, mode):
    mask = np.arange(6) < count
    weights = je.saliency(drawn(seed, 6, 8), drawn(seed + 1, 8), mask, mode, 0.1)
    np.testing.assert_allclose(weights.sum(), 1.0 if mode == "paper" else count, rtol=1e-5)
    assert not np.asarray(weights)[count:].any()
    assert (np.asarray(weights) >= 0).all()


def test_saliency_of_the_paper_is_the_softmax_of_dot_products():
    words, pooled = drawn(0, 4, 8), drawn(1, 8)
    scores = np.exp(words @ pooled)
    np.testing.assert_allclose(
        je.saliency(words, pooled, np.ones(4, bool), "paper", 0.1), scores / scores.sum(), rtol=1e-5
    )


def test_rescaled_saliency_of_alike_words_is_one_and_ignores_lengths():
    mask = np.arange(6) < 4
    alike = np.tile(drawn(0, 8), (6, 1))
    np.testing.assert_allclose(je.saliency(alike, drawn(1, 8), mask, "rescaled", 0.1), mask.astype(float), rtol=1e-5)
    words, pooled = drawn(2, 6, 8), drawn(3, 8)
    a, b = (je.saliency(jnp.asarray(x), pooled, mask, "rescaled", 0.1) for x in (words, 100 * words))
    np.testing.assert_allclose(a, b, rtol=1e-4)


# Eq. 4-6


def literal(z_t, z_g, temperature):
    """Eq. 4-5, term by term."""
    total = 0.0
    for i in range(len(z_t)):
        for queries, keys in ((z_g, z_t), (z_t, z_g)):
            scores = [np.exp(queries[i] @ key / temperature) for key in keys]
            total -= np.log(scores[i] / sum(scores)) / len(z_t)
    return total


def pair(seed, size=4, width=6):
    return tuple(np.asarray(je.unit(jnp.asarray(drawn(seed + k, size, width)))) for k in range(2))


def test_contrastive_is_the_papers_sum():
    z_t, z_g = pair(0)
    np.testing.assert_allclose(je.contrastive(z_t, z_g, 0.3), literal(z_t, z_g, 0.3), rtol=1e-5)


def test_perfect_pairs_cost_nothing():
    eye = np.eye(4, dtype=np.float32)
    assert float(je.contrastive(eye, eye, 0.02)) < 1e-6
    assert float(je.contrastive(eye, eye[::-1].copy(), 0.02)) > 10.0


def test_distillation_is_the_papers_mixture():
    student, teacher = pair(0), pair(7)
    found = je.distilled(student, teacher, 0.3, 0.4)
    apart = 0.0
    for a, b in ((1, 0), (0, 1)):
        aim, made = (jax.nn.softmax(pairs[a] @ pairs[b].T / 0.3, -1) for pairs in (teacher, student))
        apart += float((aim * jnp.log(aim / made)).sum(-1).mean())
    np.testing.assert_allclose(found, 0.6 * literal(*student, 0.3) + 0.4 * apart, rtol=1e-5)


def test_distillation_is_soft_cross_entropy_up_to_the_teachers_entropy():
    """ALBEF's form: the same gradient (gap 3)."""
    teacher = pair(7)

    def soft(student):
        total = 0.6 * je.contrastive(*student, 0.3)
        for a, b in ((1, 0), (0, 1)):
            aim = jax.nn.softmax(teacher[a] @ teacher[b].T / 0.3, -1)
            made = jax.nn.log_softmax(student[a] @ student[b].T / 0.3, -1)
            total -= 0.4 * (aim * made).sum(-1).mean()
        return total

    a, b = (jax.grad(f)(pair(0)) for f in (lambda s: je.distilled(s, teacher, 0.3, 0.4), soft))
    for x, y in zip(a, b, strict=True):
        np.testing.assert_allclose(x, y, atol=1e-6)


def test_a_teacher_that_is_the_student_adds_nothing():
    student = pair(0)
    np.testing.assert_allclose(je.distilled(student, student, 0.3, 0.4), 0.6 * je.contrastive(*student, 0.3), rtol=1e-5)


def test_no_gradient_reaches_the_teacher():
    grads = jax.grad(lambda teacher: je.distilled(pair(0), teacher, 0.3, 1.0))(pair(7))
    assert all(not np.asarray(grad).any() for grad in grads)


@pytest.mark.slow
def test_a_batch_is_a_vmap(params):
    spoken = tokens.stack([features("words", 6), tokens.tokenize(WORDS[1:], JOINT)])
    assert isinstance(spoken, Tokens)
    both = jax.vmap(lambda one: je.encode_text(params, CONFIG, one).pooled)(spoken)
    for k in range(2):
        one = je.encode_text(params, CONFIG, jax.tree.map(lambda leaf, k=k: leaf[k], spoken))
        np.testing.assert_allclose(both[k], one.pooled, atol=1e-5)


def test_parameters_from_disk_are_traced(params):
    """Checkpoints give numpy arrays; hashed words index one of them."""
    read = jax.tree.map(np.asarray, params)
    found = jax.jit(lambda one: je.encode_text(read, CONFIG, one).pooled)(features("words", 6))
    np.testing.assert_allclose(found, je.encode_text(params, CONFIG, features("words", 6)).pooled, atol=1e-5)
