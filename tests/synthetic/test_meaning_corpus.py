"""A corpus where meaning is known: what its JSON tells is what is said and done."""

import json

import numpy as np
import pytest

from zeggs_jax.motion import bvh, features
from zeggs_jax.synthetic import captions, corpus, lexicon
from zeggs_jax.synthetic.styles import StyleFactors

CONFIG = corpus.CorpusConfig(clips=2, seconds=(6.0, 7.0), seed=5, styles=("happy", "old"), random_share=0.0,
                             valid_share=0.5, held_out=(), meaning=True, mixed_share=1.0)  # fmt: skip
WHOLE = corpus.CorpusConfig(clips=120, random_share=0.4, valid_share=0.12, meaning=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("meaning")
    corpus.write(path, CONFIG)
    return path


def notes(folder, take: corpus.Take) -> dict:
    return json.loads((folder / f"{take.name}.json").read_text())


def test_meanings_are_told_with_their_times(folder):
    for take in corpus.plan(CONFIG):
        told = notes(folder, take)
        words = {word["nucleus"]: word["text"] for word in told["words"]}
        assert told["meanings"]
        for one in told["meanings"]:
            assert lexicon.find(words[one["time"]]) == one["meaning"]
            assert one["synonym"] == (one["word"] in lexicon.MEANINGS[one["meaning"]].held_out) == take.synonyms


def test_captions_are_told_and_held_out_ones_are_others(folder):
    for take in corpus.plan(CONFIG):
        told = notes(folder, take)
        assert len(set(told["captions"])) == 8
        assert len(set(told["held_out_captions"])) == 4
        assert not set(told["captions"]) & set(told["held_out_captions"])
        assert len(told["upper_captions"]) == len(told["lower_captions"]) == 3


def test_lower_halves_are_told_and_performed(folder):
    for take in corpus.plan(CONFIG):
        assert take.lower is not None
        assert take.name.startswith(take.style)
        told = notes(folder, take)
        assert told["lower"] == {"style": take.lower.style, "factors": take.lower.factors._asdict()}
        hips = bvh.read(folder / f"{take.name}.bvh").positions[:, 0, 1]
        whole = corpus.perform(take._replace(lower=None), corpus.speak(take))[2].positions[:, 0, 1]
        lower = take.factors.crouch - take.lower.factors.crouch
        assert np.mean(hips - whole) == pytest.approx(lower, abs=1.5)


def test_the_plan_keeps_synonyms_to_the_valid_clips():
    takes = corpus.plan(WHOLE)
    assert len({take.name for take in takes}) == len(takes)
    assert len({take.seed for take in takes}) == len(takes)
    assert all(take.meaning for take in takes)
    assert not any(take.synonyms for take in takes if take.split == "train")
    valid = [take for take in takes if take.split == "valid"]
    assert 0.1 < np.mean([take.synonyms for take in valid]) < 0.6
    assert 0.1 < np.mean([take.lower is not None for take in takes]) < 0.3
    assert all(take.lower.style in captions.WORDINGS for take in takes if take.lower)


def test_without_meaning_the_plan_is_the_old_one():
    plain = corpus.plan(corpus.CorpusConfig(clips=120, random_share=0.4, valid_share=0.12))
    for old, new in zip(plain, corpus.plan(WHOLE), strict=True):
        assert (old.factors, old.split, old.seconds, old.seed) == (new.factors, new.split, new.seconds, new.seed)
        assert not old.meaning
        assert old.lower is None
        assert isinstance(old.factors, StyleFactors)


def test_hands_do_something_else_at_the_words_that_matter(folder):
    take = corpus.plan(CONFIG)[0]
    told = notes(folder, take)
    speech = corpus.speak(take)
    done, mute = (corpus.perform(one, speech)[2] for one in (take, take._replace(meaning=False)))
    hand = done.skeleton.index("RightHand")
    way = np.asarray(features.world_positions(done))[:, hand] - np.asarray(features.world_positions(mute))[:, hand]
    far = np.linalg.norm(way, axis=1)
    at = [round(30 * one["time"]) + 6 for one in told["meanings"]]
    assert all(far[k] > 5.0 for k in at if k < len(far))
    assert far[: max(min(at) - 45, 1)].max() < 1e-3
