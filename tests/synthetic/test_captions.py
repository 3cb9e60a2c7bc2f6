"""Captions: varied, of the right style, and what is held out stays held out."""

import itertools
import re

import pytest

from zeggs_jax.synthetic import captions, styles

SEEDS = range(200)


def templates_of(texts: set[str], templates: tuple[str, ...]) -> set[str]:
    """Those of the templates of which some text is made, whatever stands in the gap."""
    patterns = {one: one.replace("a {}", "an? {}").replace("{}", ".+") for one in templates if one != "{}"}
    return {one for one, pattern in patterns.items() if any(re.fullmatch(pattern, text) for text in texts)}


@pytest.mark.parametrize("style", styles.STYLES)
def test_captions_are_varied_and_name_only_their_style(style):
    texts = {captions.captions(style, seed) for seed in SEEDS}
    assert len(texts) > 60
    words = captions.WORDINGS[style].words
    assert all(any(re.search(rf"\b{word}\b", text) for text in texts) for word in words)
    others = {w for name, wording in captions.WORDINGS.items() if name != style for w in wording.words} - set(words)
    told = {text for text in texts if templates_of({text}, captions.TEMPLATES)}
    seen = {phrase for text in told for phrase in (text.split(", ")[0],)}
    assert not [(t, w) for t, w in itertools.product(seen, others) if re.search(rf"\b{w}\b", t)]


def test_held_out_templates_and_synonyms_never_meet_training():
    points = [*styles.STYLES, *map(styles.random_style, range(12))]
    training = {captions.captions(point, seed) for point in points for seed in range(80)}
    held_out = {captions.captions(point, seed, held_out=True) for point in points for seed in range(80)}
    assert not training & held_out
    assert not templates_of(training, captions.HELD_OUT_TEMPLATES)
    assert templates_of(held_out, captions.HELD_OUT_TEMPLATES) == set(captions.HELD_OUT_TEMPLATES)
    unseen = {word for wording in captions.WORDINGS.values() for word in wording.held_out}
    assert not [(t, w) for t, w in itertools.product(training, unseen) if re.search(rf"\b{w}\b", t)]
    synonyms = {captions.captions(name, seed, synonym=True) for name in styles.STYLES for seed in range(40)}
    assert all(any(re.search(rf"\b{word}\b", text) for word in unseen) for text in synonyms)


def test_words_of_two_styles_are_disjoint():
    words = [word for wording in captions.WORDINGS.values() for word in (*wording.words, *wording.held_out)]
    assert len(words) == len(set(words))
    assert set(captions.WORDINGS) == set(styles.STYLES)


def test_points_between_styles_are_told_by_their_neighbours():
    assert captions.nearest(styles.find("sad"))[0] == ("sad", 0.0)
    assert [way for _, way in captions.nearest(styles.find("sad"))] == sorted(
        way for _, way in captions.nearest(styles.find("sad"))
    )
    near = styles.blend([styles.find("angry"), styles.find("old")], [0.9, 0.1])
    named = [text for seed in SEEDS if "slightly" in (text := captions.captions(near, seed))]
    assert named
    assert all(any(w in text for w in captions.WORDINGS["angry"].words) for text in named)


def test_posture_is_seen_in_the_factors():
    assert "leaning forward" in captions.posture(styles.find("old"))
    assert "knees bent" in captions.posture(styles.find("sneaky"))
    assert "nodding" in captions.posture(styles.find("agreement"))
    assert "hands high" in captions.posture(styles.find("oration"))
    assert not captions.posture(styles.find("neutral"))


def test_grammar_of_articles():
    texts = {captions.captions(name, seed) for name in ("old", "angry", "happy") for seed in SEEDS}
    assert not [text for text in texts if re.search(r"\ba [aeio]", text) or re.search(r"\ban [^aeio]", text)]
    texts = {captions.mixed("old", "angry", seed) for seed in SEEDS}
    assert not [text for text in texts if re.search(r"\ba [aeio]", text)]
    points = [captions.captions(styles.random_style(k), k, held_out=held) for k in SEEDS for held in (True, False)]
    assert not [text for text in points if re.search(r"\ban? (between|half)", text)]


def test_halves_name_their_side_and_both_styles():
    assert captions.half("old", "lower", 3) != captions.half("old", "upper", 3)
    both = captions.mixed("happy", "old", 1)
    assert any(w in both for w in captions.WORDINGS["happy"].words)
    assert any(w in both for w in captions.WORDINGS["old"].words)
    with pytest.raises(ValueError, match="middle"):
        captions.half("old", "middle", 0)
    with pytest.raises(ValueError, match="jolly"):
        captions.captions("jolly", 0)
