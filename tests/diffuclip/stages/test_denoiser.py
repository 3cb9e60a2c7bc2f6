"""The denoiser's stage: windows by their number, prompts of a take, what is lost and learnt, what stays frozen."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data.scale import Scale
from zeggs_jax.diffuclip import model, wording
from zeggs_jax.diffuclip.config import DenoiserConfig, DiffusionConfig, JointConfig, PromptsConfig, StageConfig
from zeggs_jax.diffuclip.stages import denoiser as stages
from zeggs_jax.diffuclip.stages.stage import Encoded, Material, Take
from zeggs_jax.speech.transcript import Word

LATENTS = 12  # of a window: 1.6 s
CAPTIONS = {"old": ("an old person", "bent and slow"), "happy": ("the person is happy", "lively")}


@pytest.fixture(scope="module")
def config(tiny):
    return replace(
        tiny,
        codes=replace(tiny.codes, width=8, depth=1),
        joint=JointConfig("words", 8, 1, 2, text_layers=1, words=4, latents=LATENTS, dropout=0.0),
        prompts=PromptsConfig("words", 8, 8, 1, 2, frames=48, patch=12, dropout=0.0),
        denoiser=DenoiserConfig(8, 1, 2, ahead=2, output="velocity", dropout=0.0),
        diffusion=DiffusionConfig(steps=40, context=6, short_steps=0, captioned=0.5, perceptual=0.5),
        learn_denoiser=StageConfig(60, 4, 1e-2, 2, seconds=1.6),
    )


@pytest.fixture(scope="module")
def material(config, body):
    """Takes whose first numbers tell where they are: a hundredth of latent l, frame t."""
    takes, encoded, draw = [], [], np.random.default_rng(0)
    for k in range(4):
        latents = 0.2 * draw.normal(size=(30, config.latent_size)).astype(np.float32)
        motion = draw.normal(size=(120, config.motion_size)).astype(np.float32)
        heard = draw.random((30, 2)).astype(np.float32)
        for rows in (latents, motion, heard):
            rows[:, 0] = np.arange(len(rows)) * (1.0 if rows is motion else 0.01)
        words = tuple(Word(f"w{i}", 0.5 * i, 0.5 * i + 0.3) for i in range(7))
        style = ("old", "happy")[k % 2]
        takes.append(Take(str(k), style, "valid" if k == 3 else "train", motion, heard, words, CAPTIONS[style]))
        encoded.append(Encoded(latents, latents, np.zeros((30, 4), np.int32)))
    one = Scale(np.zeros(config.motion_size, np.float32), np.ones(config.motion_size, np.float32))
    z_scale = Scale(np.zeros(config.latent_size, np.float32), np.ones(config.latent_size, np.float32))
    return Material(takes, one, body, encoded, z_scale)


@pytest.fixture(scope="module")
def params(config, body, draw):
    """What the stages before have learnt."""
    made = draw(lambda key: model.init(key, config, body), body, config.parts)
    made["prompts"]["known"] = wording.known([text for texts in CAPTIONS.values() for text in texts])
    return made


@pytest.fixture(scope="module")
def stage(config, material, params):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wording, "installed", lambda: False)
        return stages.stage(config, material, params)


@pytest.fixture(scope="module")
def table(config, material, params):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wording, "installed", lambda: False)
        return stages._prompts(config, material, params)


def test_a_batch_follows_from_its_number(stage):
    first, again, other = stage.batch(3), stage.batch(3), stage.batch(4)
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert np.any(first.latents != other.latents)


def test_all_of_a_window_begins_at_one_time(config, stage, material):
    """Latents, audio, words and motion; the audio goes on for `ahead` latents."""
    for k in range(3):
        rows = stage.batch(k)
        assert rows.latents.shape == (4, LATENTS, config.latent_size)
        for i, start in enumerate((100.0 * rows.latents[:, 0, 0]).round().astype(int)):
            whole = [np.flatnonzero((one.latents[start] == rows.latents[i, 0]).all()) for one in material.encoded]
            take = next(n for n, found in enumerate(whole) if len(found))
            assert material.takes[take].split == "train"
            heard = material.takes[take].rhythm[start : start + LATENTS + 2]
            np.testing.assert_array_equal(rows.rhythm[i, : len(heard)], heard)
            assert not rows.rhythm[i, len(heard) :].any()
            np.testing.assert_array_equal(rows.motion[i, :, 0], np.arange(4 * start, 4 * start + 48))
            middles = np.array([0.5 * n + 0.15 for n in range(7)]) - start / 7.5
            near = rows.spoken.times[i][rows.spoken.mask[i]]
            assert all(np.abs(middles - time).min() < 1e-4 for time in near)
            assert len(near)


def test_a_window_longer_than_its_take_counts_only_what_is_there(config, material, table):
    longer = replace(config, learn_denoiser=replace(config.learn_denoiser, seconds=6.0))
    rows = stages._batch(longer, material, table, 0, "train")
    assert (rows.mask.sum(axis=1) == 30).all()
    assert not rows.latents[:, 30:].any()


def test_prompts_are_of_unit_length_and_each_take_has_its_own(table, material):
    assert len(table.motions) == len(table.captions) == len(material.takes)
    for motions, captions in zip(table.motions, table.captions, strict=True):
        assert motions.shape == (stages.STRETCHES, 8)
        assert len(captions) == 2
        np.testing.assert_allclose(np.linalg.norm(np.concatenate([motions, captions]), axis=1), 1.0, atol=1e-5)
    np.testing.assert_array_equal(table.captions[0], table.captions[2])  # one style
    assert np.abs(table.captions[0] - table.captions[1]).max() > 1e-3
    assert np.abs(table.motions[0] - table.motions[2]).max() > 1e-4


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_prompt_is_a_caption_or_a_motion_as_often_as_is_set(config, material, table, share):
    often = replace(config, diffusion=replace(config.diffusion, captioned=share))
    rows = stages._batch(often, material, table, 0, "train")
    kinds = [np.concatenate([group[i] for i in range(3)]) for group in (table.motions, table.captions)]
    told = [[np.abs(kind - style).max(axis=1).min() < 1e-6 for kind in kinds] for style in rows.style]
    assert told == [[share == 0.0, share == 1.0]] * 4


def test_so_many_prompts_are_dropped_as_is_set(config, stage, material, params):
    """A clip whose loss its prompt does not change had none."""
    some = replace(config, diffusion=replace(config.diffusion, dropped=0.3))
    frozen = stages.Frozen(params, material.latent_scale)
    clip = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), stage.batch(0))

    keys = jax.random.split(jax.random.key(0), 400)

    @jax.jit
    def lost(style, frozen):
        asked = clip._replace(style=style)
        return jax.vmap(lambda key: stages._noise_loss(some, frozen.params["denoiser"], frozen, asked, key)[0])(keys)

    same = np.asarray(lost(clip.style, frozen) == lost(-clip.style, frozen))
    assert abs(same.mean() - 0.3) < 0.08


@pytest.mark.slow
def test_the_perceptual_losses_pull_at_every_latent_that_is_there(config, stage, material, params):
    frozen = stages.Frozen(params, material.latent_scale)
    clip = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), stage.batch(1))
    clip = clip._replace(mask=jnp.arange(LATENTS) < 9, motion_mask=jnp.arange(48) < 36)
    made = jnp.asarray(np.random.default_rng(1).normal(size=clip.latents.shape), jnp.float32)

    def lost(made, frozen, name):
        return stages._perceptual(config, frozen, clip, made, jnp.float32(0.5))[name]

    for name in ("meaning", "style"):
        far, slope = jax.jit(jax.value_and_grad(partial(lost, name=name)))(made, frozen)
        assert 0.0 < far <= 1.0  # half of 1 - cosine
        assert np.isfinite(slope).all()
        assert (np.abs(np.asarray(slope[:9])).max(axis=1) > 0).all()
        assert name == "style" or not np.asarray(slope[9:]).any()


def test_a_loss_without_weight_is_not_computed(config, stage, material, params):
    frozen, rows = stages.Frozen(params, material.latent_scale), stage.batch(0)
    keys = jax.random.split(jax.random.key(0), 4)
    for semantic, style, names in ((0.1, 0.0, {"noise", "meaning"}), (0.0, 0.0, {"noise"})):
        changed = replace(config, diffusion=replace(config.diffusion, semantic=semantic, style=style))
        loss = partial(stages.loss_fn, changed, params["denoiser"], rows, keys, jnp.zeros((), jnp.int32))
        assert set(jax.eval_shape(loss, frozen)[1]) == names


@pytest.fixture(scope="module")
def learnt(stage):
    """(first state's parameters, last state, what was told, judged before and after) of 60 updates."""
    state, told = stage.begin(jax.random.key(0)), []
    first, before = jax.tree.map(np.array, state.params), stage.validate(state)["loss"]
    for k in range(60):
        state, metrics = stage.step(state, stage.batch(k))
        told.append({name: float(value) for name, value in metrics.items()})
    return first, state, told, (before, stage.validate(state)["loss"])


@pytest.mark.slow
def test_the_loss_is_its_terms_and_falls(config, learnt):
    told, weights = learnt[2], config.diffusion
    for one in told[:1] + told[-1:]:
        total = one["noise"] + weights.semantic * one["meaning"] + weights.style * one["style"]
        np.testing.assert_allclose(one["loss"], total, rtol=1e-5)
    before, after = learnt[3]
    assert after < 0.95 * before


@pytest.mark.slow
def test_only_the_denoiser_is_learnt(stage, learnt, params, body, draw, config):
    first, state, *_ = learnt
    before = draw(lambda key: model.init(key, config, body), body, config.parts)
    for name in ("codes", "joint"):
        jax.tree.map(np.testing.assert_array_equal, params[name], before[name])
    made = stage.finish(state)
    assert jax.tree.structure(made) == jax.tree.structure(first)
    moved = [np.any(a != np.asarray(b)) for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(made), strict=True)]
    assert np.mean(moved) > 0.9


@pytest.mark.slow
def test_validation_is_the_same_twice_and_of_the_split_valid(config, stage, learnt, material, params):
    told = stage.validate(learnt[1])
    assert told == stage.validate(learnt[1])
    assert np.isfinite(told["loss"])
    alone = material._replace(takes=[take._replace(split="train") for take in material.takes])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wording, "installed", lambda: False)
        assert stages.stage(config, alone, params).validate is None
