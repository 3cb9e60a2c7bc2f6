"""CLIP's towers against a public implementation with drawn weights, and folders that are not CLIP's."""

import json
import warnings

import jax
import numpy as np
import pytest

from zeggs_jax.diffuclip import clip, prompts
from zeggs_jax.diffuclip.config import SMALL, PromptsConfig

TEXT = {
    "hidden_size": 16, "intermediate_size": 24, "num_hidden_layers": 2, "num_attention_heads": 2, "vocab_size": 60,
    "max_position_embeddings": 12, "eos_token_id": 59, "bos_token_id": 58, "pad_token_id": 59,
}  # fmt: skip
IMAGE = {
    "hidden_size": 24, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 3, "image_size": 16,
    "patch_size": 8,
}  # fmt: skip


@pytest.fixture(scope="module")
def public(tmp_path_factory):
    """(a public CLIP with drawn weights, the folder that it was saved to, with a tokenizer of single words)."""
    torch = pytest.importorskip("torch")
    pytest.importorskip("tokenizers")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        transformers = pytest.importorskip("transformers")
        torch.manual_seed(0)
        config = transformers.CLIPConfig(text_config=TEXT, vision_config=IMAGE, projection_dim=10)
        model = transformers.CLIPModel(config).eval()
        folder = tmp_path_factory.mktemp("clip")
        with torch.no_grad():
            for leaf in model.parameters():
                leaf.normal_(0.0, 0.3)
        model.save_pretrained(folder)
    write_tokenizer(folder)
    return model, folder


def write_tokenizer(folder):
    from tokenizers import Tokenizer, models, pre_tokenizers, processors

    words = {f"w{k}": k for k in range(58)} | {"<start>": 58, "<end>": 59}
    tokenizer = Tokenizer(models.WordLevel(words, unk_token="w0"))
    tokenizer.pre_tokenizer = pre_tokenizers.Whitespace()
    tokenizer.post_processor = processors.TemplateProcessing(
        single="<start> $A <end>", special_tokens=[("<start>", 58), ("<end>", 59)]
    )
    tokenizer.save(str(folder / "tokenizer.json"))


def vector(found):
    """A tower's vectors, however this version hands them on."""
    return (found if hasattr(found, "detach") else found.pooler_output).detach().numpy()


def test_texts_have_the_public_vectors(public):
    import torch

    model, folder = public
    texts = ["w3 w7 w1", "w5", "w9 w8 w7 w6 w5 w4 w3 w2 w1 w10"]
    ids = [[58, *(int(word[1:]) for word in text.split()), 59] for text in texts]
    ids = torch.tensor([row + [59] * (12 - len(row)) for row in ids])
    with torch.no_grad():
        expected = vector(model.get_text_features(input_ids=ids, attention_mask=torch.ones_like(ids)))
    np.testing.assert_allclose(clip.embed_texts(folder, texts), expected, atol=1e-4)


def test_pictures_have_the_public_vectors(public):
    import torch

    model, folder = public
    images = np.random.default_rng(0).random((2, 16, 16, 3), np.float32)
    tower = clip.load(folder, "image")
    found = jax.vmap(lambda image: clip.encode_image(tower.params, tower.sizes, image))(images)
    normal = (images - np.array(clip.MEAN)) / np.array(clip.STD)
    with torch.no_grad():
        expected = vector(model.get_image_features(torch.tensor(normal, dtype=torch.float32).permute(0, 3, 1, 2)))
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_text_over_the_limit_is_cut_with_a_warning(public):
    _, folder = public
    long = " ".join(f"w{k}" for k in range(1, 15))
    with pytest.warns(UserWarning, match="has 14 tokens; CLIP reads the first 10"):
        cut = clip.embed_texts(folder, [long])
    np.testing.assert_allclose(cut, clip.embed_texts(folder, [" ".join(long.split()[:10])]), atol=1e-6)


def test_prompts_of_clip_are_its_unit_vectors(public):
    _, folder = public
    config = PromptsConfig("clip", size=10, clip=str(folder))
    settings = SMALL.__class__(prompts=config, joints=3)
    found = prompts.embed_texts({}, settings, ["w1 w2"])
    expected = clip.embed_texts(folder, ["w1 w2"])
    np.testing.assert_allclose(found, expected / np.linalg.norm(expected), atol=1e-6)
    wrong = SMALL.__class__(prompts=PromptsConfig("clip", size=12, heads=4, clip=str(folder)), joints=3)
    with pytest.raises(ValueError, match="have 10 numbers, the prompt space 12"):
        prompts.embed_texts({}, wrong, ["w1"])


def test_folders_that_do_not_fit_are_told_in_one_sentence(public, tmp_path):
    _, folder = public
    with pytest.raises(ValueError, match=r"set prompts\.clip to a local folder"):
        clip.folder_of(PromptsConfig())
    with pytest.raises(FileNotFoundError, match="give a model folder"):
        clip.load(tmp_path, "text")
    told = json.loads((folder / "config.json").read_text())
    (tmp_path / "model.safetensors").write_bytes((folder / "model.safetensors").read_bytes())
    (tmp_path / "config.json").write_text(json.dumps(told | {"model_type": "bert"}))
    with pytest.raises(ValueError, match="'bert', expected 'clip'"):
        clip.load(tmp_path, "text")
    told["text_config"] |= {"hidden_size": 18}
    (tmp_path / "config.json").write_text(json.dumps(told))
    with pytest.raises(ValueError, match="expected"):
        clip.load(tmp_path, "text")
    told["vision_config"] |= {"hidden_act": "swish"}
    (tmp_path / "config.json").write_text(json.dumps(told))
    with pytest.raises(ValueError, match="activation 'swish'"):
        clip.load(tmp_path, "image")
    tower = clip.load(folder, "image")
    with pytest.raises(ValueError, match="reads pictures of 16 pixels, these have 8"):
        clip.encode_image(tower.params, tower.sizes, np.zeros((8, 8, 3), np.float32))
