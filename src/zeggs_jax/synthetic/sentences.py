"""Sentences without a source: a small grammar over our own word lists, with commas and stops to pause at."""

import numpy as np


def _words(text: str) -> list[str]:
    return text.split()


WEAK = frozenset(
    _words(
        "a an the of to in on at by for with and or but as is was are were be it he she we they you i his "
        "her our their this that my your from so if than then not have had will would can could into some all"
    )
)
PEOPLE = _words(
    "baker farmer doctor sailor teacher painter neighbour captain sister brother gardener singer driver "
    "builder student stranger lawyer hunter shepherd writer"
)
THINGS = _words(
    "garden river window kettle letter mountain market engine bottle carpet ladder village paper basket "
    "number candle hammer bridge station feather blanket island harbour piano butter coat summer winter "
    "road boat lamp clock stone door tree house field cloud train bread storm light table"
)
QUALITIES = _words(
    "little heavy golden quiet narrow clever silver broken simple gentle bitter modern famous hollow lucky "
    "wooden bright cold deep strange warm sharp wide old young green slow tall"
)
DEEDS = _words(
    "carried followed painted opened borrowed covered answered gathered lifted remembered measured promised "
    "found kept sold moved built watched held dropped cleaned turned"
)
MANNERS = _words("slowly quickly never always really quietly often again together nearly gladly early")
PLACES = ("in", "on", "near", "behind", "under", "beside", "across", "over")
OPENERS = (
    "well", "now look", "listen", "of course", "you know", "and then", "in the morning", "years ago",
    "believe me", "to be honest", "at first", "later on",
)  # fmt: skip


def _noun_phrase(draw: np.random.Generator, nouns: list[str]) -> str:
    article = draw.choice(["the", "a", "my", "her", "this", "our"])
    quality = f"{draw.choice(QUALITIES)} " if draw.random() < 0.5 else ""
    return f"{article} {quality}{draw.choice(nouns)}"


def _clause(draw: np.random.Generator) -> str:
    manner = f"{draw.choice(MANNERS)} " if draw.random() < 0.3 else ""
    place = f" {draw.choice(PLACES)} {_noun_phrase(draw, THINGS)}" if draw.random() < 0.55 else ""
    return f"{_noun_phrase(draw, PEOPLE)} {manner}{draw.choice(DEEDS)} {_noun_phrase(draw, THINGS)}{place}"


def sentence(draw: np.random.Generator) -> str:
    """One sentence of 5 to 25 lower-case words with commas and a final stop."""
    parts = [str(draw.choice(OPENERS))] if draw.random() < 0.35 else []
    parts.append(_clause(draw))
    if draw.random() < 0.45:
        parts.append(f"{draw.choice(['and', 'but', 'so', 'while', 'because'])} {_clause(draw)}")
    return ", ".join(parts) + "."


def monologue(seed: int, words: int) -> str:
    """Sentences until at least `words` words are said."""
    draw = np.random.default_rng([seed, 29])
    said: list[str] = []
    while sum(len(s.split()) for s in said) < words:
        said.append(sentence(draw))
    return " ".join(said)
