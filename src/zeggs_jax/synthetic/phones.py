"""Letters to sounds: a rough table, enough for speech-like audio, and the syllables that words fall into."""

import re
from typing import NamedTuple

from zeggs_jax.synthetic.sentences import WEAK


class Phone(NamedTuple):
    """Targets of one sound; formants in Hz, levels relative to a full vowel."""

    seconds: float
    f1: float
    f2: float
    f3: float
    voice: float  # level of the harmonic source
    noise: float  # level of the noise source
    centre: float  # Hz, middle of the noise band
    vowel: bool = False


class Syllable(NamedTuple):
    """Phones of one syllable and whether its word carries stress on it."""

    phones: tuple[Phone, ...]
    stressed: bool


def _vowel(f1: int, f2: int, f3: int, seconds: float = 0.11) -> Phone:
    return Phone(seconds, f1, f2, f3, 1.0, 0.0, 3000.0, True)


VOWELS = {
    "ee": _vowel(290, 2250, 2950, 0.13),
    "ea": _vowel(300, 2200, 2900, 0.13),
    "oo": _vowel(320, 950, 2300, 0.13),
    "ou": _vowel(600, 1000, 2450, 0.14),
    "ow": _vowel(580, 980, 2450, 0.14),
    "ai": _vowel(480, 1950, 2600, 0.14),
    "ay": _vowel(470, 2000, 2600, 0.14),
    "oa": _vowel(480, 900, 2400, 0.14),
    "au": _vowel(620, 980, 2500, 0.14),
    "a": _vowel(720, 1350, 2500, 0.13),
    "e": _vowel(520, 1800, 2550),
    "i": _vowel(380, 2050, 2700, 0.10),
    "o": _vowel(570, 950, 2450, 0.12),
    "u": _vowel(600, 1200, 2450),
    "y": _vowel(320, 2150, 2800, 0.10),
}
CLOSED = Phone(0.05, 300, 1500, 2500, 0.03, 0.0, 3000.0)
CONSONANTS: dict[str, tuple[Phone, ...]] = {
    "sh": (Phone(0.10, 350, 1800, 2600, 0.0, 0.5, 3200.0),),
    "ch": (CLOSED, Phone(0.07, 350, 1800, 2600, 0.0, 0.5, 3200.0)),
    "th": (Phone(0.07, 350, 1400, 2600, 0.25, 0.12, 6000.0),),
    "ng": (Phone(0.07, 280, 1300, 2300, 0.4, 0.0, 3000.0),),
    "s": (Phone(0.09, 350, 1700, 2600, 0.0, 0.5, 5600.0),),
    "z": (Phone(0.07, 320, 1700, 2600, 0.25, 0.3, 5600.0),),
    "f": (Phone(0.08, 350, 1200, 2400, 0.0, 0.18, 5000.0),),
    "v": (Phone(0.06, 320, 1200, 2400, 0.3, 0.08, 5000.0),),
    "h": (Phone(0.06, 500, 1500, 2500, 0.05, 0.2, 1800.0),),
    "m": (Phone(0.07, 270, 1000, 2200, 0.45, 0.0, 3000.0),),
    "n": (Phone(0.06, 280, 1500, 2500, 0.45, 0.0, 3000.0),),
    "l": (Phone(0.06, 360, 1100, 2700, 0.55, 0.0, 3000.0),),
    "r": (Phone(0.06, 380, 1200, 1650, 0.55, 0.0, 3000.0),),
    "w": (Phone(0.06, 310, 720, 2300, 0.5, 0.0, 3000.0),),
    "p": (CLOSED, Phone(0.025, 350, 900, 2300, 0.0, 0.3, 1200.0)),
    "b": (CLOSED, Phone(0.015, 300, 900, 2300, 0.3, 0.1, 1000.0)),
    "t": (CLOSED, Phone(0.03, 350, 1700, 2600, 0.0, 0.45, 4500.0)),
    "d": (CLOSED, Phone(0.015, 300, 1700, 2600, 0.3, 0.15, 4000.0)),
    "k": (CLOSED, Phone(0.03, 350, 1800, 2400, 0.0, 0.4, 2200.0)),
    "g": (CLOSED, Phone(0.015, 300, 1800, 2400, 0.3, 0.15, 2200.0)),
}
SPELLING = {"ck": "k", "ph": "f", "wh": "w", "qu": "kw", "c": "k", "x": "ks", "j": "ch", "q": "k", "gh": "g"}
_PIECES = re.compile("|".join(sorted([*VOWELS, *CONSONANTS], key=len, reverse=True)))


def _pieces(word: str) -> list[str]:
    letters = re.sub(r"[^a-z]", "", word.lower())
    if len(letters) > 3 and letters.endswith("e") and letters[-2] not in "aeiou":
        letters = letters[:-1]  # a silent e
    for written, heard in SPELLING.items():
        letters = letters.replace(written, heard)
    letters = re.sub(r"([b-df-hj-np-tv-z])\1", r"\1", letters)
    letters = re.sub(r"^y(?=[aeiou])", "i", letters)
    pieces = _PIECES.findall(letters)
    return pieces if any(p in VOWELS for p in pieces) else [*pieces, "e"]


def syllables(word: str) -> list[Syllable]:
    """The syllables of `word`: one for each vowel, stress on the first unless the word is a function word."""
    pieces = _pieces(word)
    groups: list[list[Phone]] = [[]]
    seen = False
    for k, piece in enumerate(pieces):
        if piece in VOWELS:
            if seen:
                groups.append([])
            groups[-1].append(VOWELS[piece])
            seen = True
            continue
        vowel_follows = k + 1 < len(pieces) and pieces[k + 1] in VOWELS
        if seen and vowel_follows:
            groups.append([])
            seen = False
        groups[-1].extend(CONSONANTS[piece])
    if len(groups) > 1 and not any(p.vowel for p in groups[-1]):
        tail = groups.pop()
        groups[-1].extend(tail)
    weak = word.lower().strip(".,;:!?") in WEAK
    return [Syllable(tuple(group), stressed=(i == 0 and not weak)) for i, group in enumerate(groups)]
