"""Words that matter: twelve meanings, the words that carry them, and neutral sentences in which they stand."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from zeggs_jax.synthetic.sentences import DEEDS, MANNERS, OPENERS, PEOPLE, PLACES, QUALITIES, THINGS
from zeggs_jax.synthetic.voice import Word

Kind = Literal["iconic", "deictic", "metaphoric", "emblem"]
Place = Literal["quality", "direction", "person", "amount", "call"]


class Meaning(NamedTuple):
    """What a gesture can say; `held_out` words are for tests only: no training sentence has them."""

    kind: Kind  # McNeill 1992
    place: Place  # where its words stand in a sentence
    words: tuple[str, ...]
    held_out: tuple[str, ...]


class Meant(NamedTuple):
    """A word of a speech that carries a meaning."""

    word: str
    meaning: str
    time: float  # s, the nucleus of the word
    end: float  # s, of the word
    synonym: bool  # a held-out word


def _meaning(kind: Kind, place: Place, words: str, held_out: str) -> Meaning:
    return Meaning(kind, place, tuple(words.split()), tuple(held_out.split()))


MEANINGS: Mapping[str, Meaning] = MappingProxyType(
    {
        "big": _meaning("iconic", "quality", "big huge enormous large giant", "massive gigantic"),
        "small": _meaning("iconic", "quality", "small tiny little", "miniature teeny"),
        "round": _meaning("iconic", "quality", "round circular spherical", "rounded globular"),
        "up": _meaning("iconic", "direction", "up upwards high above", "aloft skyward"),
        "down": _meaning("iconic", "direction", "down downwards below low", "beneath underneath"),
        "far": _meaning("deictic", "direction", "far away yonder", "afar beyond"),
        "you": _meaning("deictic", "person", "you yourself yours", "yourselves thou"),
        "me": _meaning("deictic", "person", "me myself mine", "self personally"),
        "many": _meaning("metaphoric", "amount", "many countless numerous", "abundant innumerable"),
        "no": _meaning("emblem", "call", "no never nope", "nah nay"),
        "yes": _meaning("emblem", "call", "yes yeah certainly", "yep absolutely"),
        "stop": _meaning("emblem", "call", "stop halt wait", "cease freeze"),
    }
)
_FOUND = {word: name for name, meaning in MEANINGS.items() for word in (*meaning.words, *meaning.held_out)}
_SYNONYMS = frozenset(word for meaning in MEANINGS.values() for word in meaning.held_out)

# The rest of a sentence says nothing of these meanings.
_PLAIN_QUALITIES = [word for word in QUALITIES if word not in {"little", "wide", "tall", "deep", "narrow"}]
_PLAIN_MANNERS = [word for word in MANNERS if word != "never"]
_PLAIN_OPENERS = [words for words in OPENERS if not {"you", "me"} & set(words.split())]
_PLAIN_PLACES = [word for word in PLACES if word not in {"under", "over"}]
_MOVES = ["looked", "pointed", "went", "travelled", "wandered", "turned", "moved", "leaned"]
_SAID = ["said", "shouted", "whispered", "answered", "repeated"]
_GIVEN = ["belongs", "came", "happened", "seemed", "mattered", "returned"]

_LOOSE = "there was were had seen stood really asked about from to for it and but so while because near"


def _thing(draw: np.random.Generator, nouns: list[str], quality: str = "") -> str:
    article = draw.choice(["the", "the", "a", "this", "our", "her"])
    if not quality and draw.random() < 0.4:
        quality = str(draw.choice(_PLAIN_QUALITIES))
    return " ".join(filter(None, (article, quality, draw.choice(nouns))))


def _where(draw: np.random.Generator, chance: float) -> str:
    return f" {draw.choice(_PLAIN_PLACES)} {_thing(draw, THINGS)}" if draw.random() < chance else ""


def _plain(draw: np.random.Generator) -> str:
    manner = f"{draw.choice(_PLAIN_MANNERS)} " if draw.random() < 0.3 else ""
    return f"{_thing(draw, PEOPLE)} {manner}{draw.choice(DEEDS)} {_thing(draw, THINGS)}{_where(draw, 0.5)}"


def _with_quality(draw: np.random.Generator, word: str) -> str:
    return [
        lambda: f"{_thing(draw, PEOPLE)} {draw.choice(DEEDS)} {_thing(draw, THINGS, word)}{_where(draw, 0.4)}",
        lambda: f"{_thing(draw, THINGS)}{_where(draw, 0.5)} was really {word}",
        lambda: f"there was {_thing(draw, THINGS, word)}{_where(draw, 0.7)}",
        lambda: f"{_thing(draw, THINGS, word)} stood near {_thing(draw, THINGS)}",
    ][int(draw.integers(4))]()


def _with_direction(draw: np.random.Generator, word: str) -> str:
    return [
        lambda: f"{_thing(draw, PEOPLE)} {draw.choice(_MOVES)} {word} from {_thing(draw, THINGS)}",
        lambda: f"{_thing(draw, PEOPLE)} {draw.choice(DEEDS)} {_thing(draw, THINGS)} {word}",
        lambda: f"{_thing(draw, THINGS)} {draw.choice(_MOVES)} {word}{_where(draw, 0.3)}",
        lambda: f"it was {word}{_where(draw, 1.0)}",
    ][int(draw.integers(4))]()


def _with_person(draw: np.random.Generator, word: str) -> str:
    return [
        lambda: f"{_thing(draw, THINGS)} {draw.choice(_GIVEN)} to {word}{_where(draw, 0.3)}",
        lambda: f"{_thing(draw, PEOPLE)} {draw.choice(DEEDS)} {_thing(draw, THINGS)} for {word}",
        lambda: f"{_thing(draw, PEOPLE)} asked {word} about {_thing(draw, THINGS)}",
        lambda: f"it was for {word}, and for {_thing(draw, PEOPLE)}",
    ][int(draw.integers(4))]()


def _with_amount(draw: np.random.Generator, word: str) -> str:
    things = f"{draw.choice(THINGS)}s"
    return [
        lambda: f"{_thing(draw, PEOPLE)} {draw.choice(DEEDS)} {word} {things}{_where(draw, 0.4)}",
        lambda: f"there were {word} {things}{_where(draw, 0.7)}",
        lambda: f"{_thing(draw, PEOPLE)} had seen {word} {draw.choice(PEOPLE)}s",
    ][int(draw.integers(3))]()


def _with_call(draw: np.random.Generator, word: str) -> str:
    return [
        lambda: f"{word}, {_plain(draw)}",
        lambda: f"{_thing(draw, PEOPLE)} {draw.choice(_SAID)} {word} to {_thing(draw, PEOPLE)}",
        lambda: f"{_thing(draw, PEOPLE)} {draw.choice(_SAID)}, {word}, {_plain(draw)}",
    ][int(draw.integers(3))]()


_CLAUSES = {
    "quality": _with_quality,
    "direction": _with_direction,
    "person": _with_person,
    "amount": _with_amount,
    "call": _with_call,
}


def _clause(draw: np.random.Generator, meaning: str | None, held_out: bool) -> str:
    if meaning is None:
        return _plain(draw)
    chosen = MEANINGS[meaning]
    return _CLAUSES[chosen.place](draw, str(draw.choice(chosen.held_out if held_out else chosen.words)))


def sentence(draw: np.random.Generator, held_out: bool = False) -> str:
    """One sentence of lower-case words: an eighth says nothing of the twelve meanings, nearly half says two."""
    count = int(draw.choice(3, p=[0.12, 0.43, 0.45]))
    meant: list[str | None] = [str(name) for name in draw.choice(list(MEANINGS), count, replace=False)]
    if (len(meant) < 2 and draw.random() < 0.35) or not meant:
        meant.insert(int(draw.integers(len(meant) + 1)), None)
    parts = [str(draw.choice(_PLAIN_OPENERS))] if draw.random() < 0.3 else []
    for number, name in enumerate(meant):
        link = f"{draw.choice(['and', 'but', 'so', 'while', 'because'])} " if number else ""
        parts.append(link + _clause(draw, name, held_out))
    return ", ".join(parts) + "."


def monologue(seed: int, words: int, held_out: bool = False) -> str:
    """Sentences until at least `words` words are said; with `held_out` every meaning by a word never trained on."""
    draw = np.random.default_rng([seed, 53])
    said: list[str] = []
    while sum(len(s.split()) for s in said) < words:
        said.append(sentence(draw, held_out))
    return " ".join(said)


def find(word: str) -> str | None:
    """The meaning that `word` carries, whatever its case and punctuation; None of a neutral word."""
    return _FOUND.get(word.strip(".,;:!?\"'").lower())


def meant(words: Sequence[Word]) -> list[Meant]:
    """The words of a speech that carry a meaning, in order."""
    found = []
    for word in words:
        text = word.text.strip(".,;:!?\"'").lower()
        if text in _FOUND:
            found.append(Meant(text, _FOUND[text], word.nucleus, word.end, text in _SYNONYMS))
    return found


def neutral_words() -> frozenset[str]:
    """Every word that a sentence may have beside those that carry a meaning."""
    lists = [_PLAIN_QUALITIES, _PLAIN_MANNERS, PEOPLE, THINGS, DEEDS, _PLAIN_PLACES, _MOVES, _SAID, _GIVEN]
    plurals = [f"{noun}s" for noun in (*PEOPLE, *THINGS)]
    loose = _LOOSE.split()
    articles = ["the", "a", "this", "our", "her"]
    opened = [word for words in _PLAIN_OPENERS for word in words.split()]
    return frozenset(word for words in (*lists, plurals, loose, articles, opened) for word in words)
