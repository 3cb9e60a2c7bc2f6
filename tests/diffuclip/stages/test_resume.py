"""Every stage, under small and under the paper's kinds of settings: it learns, and goes on bit-exactly after a stop."""

import json
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import clip as towers
from zeggs_jax.diffuclip import representation, t5, weights, wording
from zeggs_jax.diffuclip.config import DenoiserConfig, DiffuclipConfig, JointConfig, PromptsConfig, StageConfig
from zeggs_jax.diffuclip.model import encode_takes
from zeggs_jax.diffuclip.stages.stage import Material, Take
from zeggs_jax.diffuclip.train import STAGES
from zeggs_jax.speech.transcript import Word
from zeggs_jax.training import checkpoint
from zeggs_jax.training.step import TrainState

pytestmark = pytest.mark.slow  # two dozen updates to compile

TOWER = {"hidden_size": 8, "intermediate_size": 8, "num_hidden_layers": 1, "num_attention_heads": 2}
CLIP = {
    "model_type": "clip", "projection_dim": 6,
    "text_config": TOWER | {"vocab_size": 20, "max_position_embeddings": 8, "eos_token_id": 19},
    "vision_config": TOWER | {"image_size": 8, "patch_size": 4},
}  # fmt: skip
T5 = {"model_type": "t5", "vocab_size": 20, "d_model": 8, "d_kv": 4, "d_ff": 8, "num_layers": 1, "num_heads": 2}
SHORT = StageConfig(4, 2, 1e-3, 1, seconds=2.2)
LEARN = {f"learn_{name}": SHORT for name in STAGES} | {"learn_codes": replace(SHORT, ema=0.99)}


def write(folder, told, trees):
    """A folder as Hugging Face lays it out, of (parameters, the names of their leaves), words w0 to w19."""
    tokenizers = pytest.importorskip("tokenizers")
    folder.mkdir()
    (folder / "config.json").write_text(json.dumps(told))
    header, raw = {}, b""
    for params, name_of in trees:
        for path, leaf in jax.tree_util.tree_leaves_with_path(params):
            array = np.asarray(leaf, np.float32)
            place = [len(raw), len(raw) + array.nbytes]
            name = name_of(tuple(part.key for part in path))
            header[name] = {"dtype": "F32", "shape": list(array.shape), "data_offsets": place}
            raw += array.tobytes()
    text = json.dumps(header).encode()
    (folder / "model.safetensors").write_bytes(len(text).to_bytes(8, "little") + text + raw)
    vocabulary = {f"w{k}": k for k in range(20)}
    tokenizer = tokenizers.Tokenizer(tokenizers.models.WordLevel(vocabulary, unk_token="w2"))
    tokenizer.pre_tokenizer = tokenizers.pre_tokenizers.Whitespace()
    if "vision_config" in told:
        ends = tokenizers.processors.TemplateProcessing(single="w18 $A w19", special_tokens=[("w18", 18), ("w19", 19)])
        tokenizer.post_processor = ends
    tokenizer.save(str(folder / "tokenizer.json"))


def published(folder, draw, body):
    """Folders with a T5 and a CLIP of random weights."""
    write(
        folder / "t5", T5,
        [(draw(lambda key: t5.init(key, t5.T5Config(20, 8, 1, 2, 4, 8))), partial(t5._name, "shared.weight"))],
    )  # fmt: skip
    sizes = towers.Sizes(8, 8, 1, 2, "quick_gelu", 1e-5, 6, 20, 8, 19, 8, 4)
    given = {"text": jnp.zeros(1, jnp.int32), "image": jnp.zeros((8, 8, 3))}
    made = {kind: towers._network(kind, sizes).init for kind in given}
    drawn = {kind: draw(lambda key, k=kind: made[k](key, given[k])["params"]) for kind in given}
    write(folder / "clip", CLIP, [(params, partial(towers._name, kind)) for kind, params in drawn.items()])


def paper(folder):
    """What the paper's settings are of: one part, one codebook, T5, CLIP, one level for all, short denoising."""
    whole = DiffuclipConfig()
    return replace(
        whole,
        codes=replace(whole.codes, latent=4, codes=6, width=4, depth=1),
        joint=replace(whole.joint, width=8, layers=1, heads=2, text_layers=1, words=6, latents=16,
                      folder=str(folder / "t5")),
        prompts=replace(whole.prompts, size=6, width=8, layers=1, heads=2, frames=60, clip=str(folder / "clip"),
                        pixels=8, video_frames=2, video_width=8, video_layers=1, video_heads=2),
        denoiser=replace(whole.denoiser, width=8, layers=1, heads=2, ahead=2),
        diffusion=replace(whole.diffusion, per_token=False, short_steps=2, context=4),
    )  # fmt: skip


def small(tiny):
    """What the bundled model's settings are of: two parts, residual codebooks, words that are learnt."""
    return replace(
        tiny,
        frame_time=1 / 60,
        codes=replace(tiny.codes, latent=4, codes=6, width=4, depth=1, halvings=3),
        joint=JointConfig("words", 8, 1, 2, text_layers=1, words=6, latents=16, saliency="rescaled"),
        prompts=PromptsConfig("words", 6, 8, 1, 2, frames=60, patch=6, image="small", pixels=8, video_frames=2,
                              video_width=8, video_layers=1, video_heads=2),
        denoiser=DenoiserConfig(8, 1, 2, ahead=2, output="velocity"),
        diffusion=replace(tiny.diffusion, short_steps=0, captioned=0.4, context=4),
    )  # fmt: skip


@pytest.fixture(scope="module", params=["small", "paper"])
def config(request, tmp_path_factory, tiny, body, draw):
    if request.param == "small":
        return replace(small(tiny), learn_denoiser=replace(SHORT, ema=0.999), **without_denoiser())
    folder = tmp_path_factory.mktemp("published")
    published(folder, draw, body)
    config = replace(
        paper(folder), joints=len(body), learn_denoiser=replace(SHORT, ema=0.999), **without_denoiser()
    )  # fmt: skip
    weights.check(config)
    return config


def without_denoiser():
    return {name: value for name, value in LEARN.items() if name != "learn_denoiser"}


@pytest.fixture(scope="module")
def material(config, clip, body):
    """Takes of 3 s, all of the split train."""
    words = tuple(Word(f"w{3 + k}" + "." * (k % 4 == 3), 0.3 * k, 0.3 * k + 0.2) for k in range(8))
    takes = []
    for k in range(3):
        motion = np.repeat(representation.encode(clip), 2, axis=0)[:176] * np.float32(1.0 + 0.1 * k)
        heard = np.random.default_rng(k).random((22, 2)).astype(np.float32)
        takes.append(Take(str(k), "old", "train", motion, heard, words, ("w4 w5",)))
    return Material(takes, representation.scale([take.motion for take in takes], body), body)


@pytest.fixture(scope="module")
def learnt(config):
    """The components so far, and the takes in latents once the codes are there."""
    return {"params": {}, "encoded": None}


def updates(stage, state, numbers):
    for k in numbers:
        state, told = stage.step(state, stage.batch(k))
        assert all(np.isfinite(value) for value in told.values()), told
    return state


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_learns_and_goes_on_bit_exactly(name, config, material, learnt, tmp_path, monkeypatch):
    monkeypatch.setattr(wording, "installed", lambda: False)
    component, make = STAGES[name]
    if learnt["encoded"] is not None:
        z_scale, encoded = learnt["encoded"]
        material = material._replace(encoded=encoded, latent_scale=z_scale)
    stage, key = make(config, material, jax.tree.map(np.asarray, learnt["params"])), jax.random.key(7)
    whole = updates(stage, stage.begin(key), range(4))
    half = updates(stage, stage.begin(key), range(2))
    checkpoint.save(tmp_path / "kept", half._asdict(), {})
    tree, _ = checkpoint.load(tmp_path / "kept", jax.eval_shape(stage.begin, key)._asdict())
    again = make(config, material, jax.tree.map(np.asarray, learnt["params"]))
    resumed = updates(again, TrainState(**tree), range(2, 4))
    jax.tree.map(np.testing.assert_array_equal, resumed, whole)
    first = jax.tree.leaves(stage.begin(key).params)
    pairs = zip(first, jax.tree.leaves(whole.params), strict=True)
    assert np.mean([bool(np.any(np.asarray(a) != np.asarray(b))) for a, b in pairs]) > 0.5
    learnt["params"][component] = jax.tree.map(np.asarray, stage.finish(whole))
    if name == "codes":
        learnt["encoded"] = encode_takes(learnt["params"]["codes"], config, material.motion_scale, material.takes)
