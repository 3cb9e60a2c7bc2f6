"""T5's encoder: the same vectors as the public implementation's, its buckets, its folder's errors."""

import json

import jax
import numpy as np
import pytest

from zeggs_jax.diffuclip import t5

CONFIG = t5.T5Config(vocabulary=30, width=16, layers=2, heads=2, head_width=4, inner=24)
IDS = np.array([3, 7, 7, 29, 1, 0, 0], np.int32)
MASK = np.arange(7) < 5


def saved(folder, gated):
    """A randomly initialised public T5 in a folder, and what it makes of IDS."""
    torch, transformers = pytest.importorskip("torch"), pytest.importorskip("transformers")
    torch.manual_seed(0)
    kind = transformers.T5Config(
        vocab_size=30, d_model=16, d_kv=4, d_ff=24, num_layers=2, num_heads=2, decoder_start_token_id=0,
        feed_forward_proj="gated-gelu" if gated else "relu",
    )  # fmt: skip
    model = transformers.T5EncoderModel(kind).eval()
    with torch.no_grad():
        for weight in model.parameters():  # its own start is so large that all is decided by one key
            weight.normal_(0.0, 0.5)
        ids, mask = torch.tensor(IDS)[None].long(), torch.tensor(MASK)[None]
        made = model(ids, attention_mask=mask).last_hidden_state[0].numpy()
    model.save_pretrained(folder)
    return made


@pytest.mark.parametrize("gated", [False, True])
def test_vectors_are_the_public_implementations(tmp_path, gated):
    wanted = saved(tmp_path, gated)
    params = t5.load(tmp_path)
    np.testing.assert_allclose(np.asarray(t5.apply(params, IDS, MASK))[:5], wanted[:5], atol=1e-4)
    assert t5.config_of(params).gated == gated
    assert np.abs(wanted[:5] - wanted[:1]).max() > 0.1


def test_padding_changes_nothing_and_keys_drop():
    params = t5.init(jax.random.key(0), CONFIG)
    short, long = t5.apply(params, IDS[:5], MASK[:5]), t5.apply(params, IDS, MASK)
    np.testing.assert_allclose(long[:5], short, atol=1e-5)
    assert np.abs(t5.apply(params, IDS, MASK, jax.random.key(1)) - long).max() > 1e-3


def test_sizes_are_read_from_the_parameters():
    assert t5.config_of(t5.init(jax.random.key(0), CONFIG)) == CONFIG


def test_buckets_are_single_places_then_wider_ones():
    made = t5.buckets(200, 32)
    assert made[0, :9].tolist() == [0, 17, 18, 19, 20, 21, 22, 23, 24]
    assert made[8, :9].tolist() == [8, 7, 6, 5, 4, 3, 2, 1, 0]
    assert (np.diff(made[0, 1:]) >= 0).all()
    assert made[0, 128:].tolist() == [31] * 72
    assert made[199, 0] == 15


def test_buckets_are_the_public_implementations():
    torch, transformers = pytest.importorskip("torch"), pytest.importorskip("transformers")
    bucket = transformers.models.t5.modeling_t5.T5Attention._relative_position_bucket
    ahead = torch.arange(300)[None, :] - torch.arange(300)[:, None]
    np.testing.assert_array_equal(t5.buckets(300, 32), bucket(ahead, True, 32, 128).numpy())


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"model_type": "bert"}, "of type 'bert', expected 't5' or 'mt5'"),
        ({"feed_forward_proj": "gated-silu"}, "with 'gated-silu'"),
        ({"relative_attention_max_distance": 64}, "positions up to 64"),
        ({"d_kv": None}, "has no 'd_kv'"),
    ],
)
def test_other_architectures_are_refused(tmp_path, change, told):
    said = {"model_type": "t5", "vocab_size": 30, "d_model": 16, "d_kv": 4, "d_ff": 24, "num_layers": 2, "num_heads": 2}
    said = {name: value for name, value in (said | change).items() if value is not None}
    (tmp_path / "config.json").write_text(json.dumps(said))
    with pytest.raises(ValueError, match=told):
        t5.load(tmp_path)


def test_words_are_cut_by_the_folders_tokenizer(tmp_path):
    tokenizers = pytest.importorskip("tokenizers")
    from tokenizers.models import WordPiece
    from tokenizers.pre_tokenizers import Whitespace

    made = tokenizers.Tokenizer(WordPiece({"[UNK]": 0, "fish": 1, "##er": 2, "big": 3}, unk_token="[UNK]"))
    made.pre_tokenizer = Whitespace()
    made.save(str(tmp_path / "tokenizer.json"))
    ids, owners = t5.reader(tmp_path)(["big", "fisher", "?"])
    assert (ids.tolist(), owners.tolist()) == ([3, 1, 2, 0], [0, 1, 1, 2])
    assert t5.reader(tmp_path)([])[0].shape == (0,)


def test_no_tokenizer_is_told(tmp_path):
    pytest.importorskip("tokenizers")
    with pytest.raises(ValueError, match=r"tokenizer\.json' is missing or no tokenizer"):
        t5.reader(tmp_path)
