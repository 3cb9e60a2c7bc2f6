"""Captions: what somebody would write under a clip of a style, in varied words, some of them held out for tests."""

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from zeggs_jax.synthetic import styles
from zeggs_jax.synthetic.styles import StyleFactors

SLIGHT = 0.5  # a style this much nearer than the second nearest is named alone


class Wording(NamedTuple):
    """How one style is called: adjectives (`held_out` ones are for tests only) and what the body looks like."""

    words: tuple[str, ...]
    held_out: tuple[str, ...]
    looks: tuple[str, ...]


def _wording(words: str, held_out: str, *looks: str) -> Wording:
    return Wording(tuple(words.split(", ")), tuple(held_out.split(", ")), looks)


WORDINGS: Mapping[str, Wording] = MappingProxyType(
    {
        "neutral": _wording(
            "neutral, ordinary, calm, normal", "everyday, unremarkable",
            "standing at ease, hands at the waist",
        ),
        "happy": _wording(
            "happy, joyful, cheerful, glad", "delighted, merry",
            "light and lively, hands open", "swaying gladly, palms up",
        ),
        "sad": _wording(
            "sad, unhappy, sorrowful, gloomy", "depressed, miserable",
            "the head hangs, hands down", "chin down, barely moving",
        ),
        "angry": _wording(
            "angry, furious, mad, aggressive", "enraged, irate",
            "hard strokes with clenched fists", "leaning in and hitting the air",
        ),
        "old": _wording(
            "old, elderly, aged, frail", "ancient, senile",
            "bent far forward, slow and stiff", "a stooped back, one hand at work",
        ),
        "tired": _wording(
            "tired, exhausted, sleepy, weary", "fatigued, drowsy",
            "drooping shoulders, heavy arms", "sagging and slow, low hands",
        ),
        "relaxed": _wording(
            "relaxed, casual, easygoing, laid-back", "leisurely, carefree",
            "leaning back, soft slow hands", "loose and unhurried",
        ),
        "still": _wording(
            "still, motionless, quiet, rigid", "immobile, frozen",
            "hardly moving at all", "arms hanging, no gestures",
        ),
        "scared": _wording(
            "scared, afraid, frightened, fearful", "terrified, anxious",
            "shoulders up, hands held before the chest", "shrinking back with quick small moves",
        ),
        "sneaky": _wording(
            "sneaky, sly, cunning, secretive", "stealthy, shifty",
            "crouched low and leaning forward", "knees bent, creeping",
        ),
        "agreement": _wording(
            "agreeing, approving, nodding, consenting", "affirming, assenting",
            "nodding again and again", "the head bobs with every word",
        ),
        "oration": _wording(
            "oratorical, solemn, grand, preaching", "rhetorical, stately",
            "arms raised wide above the shoulders", "hands high, palms up, like a speech to a crowd",
        ),
    }
)  # fmt: skip

TEMPLATES = (
    "the person is {}", "a {} person", "{} person speaking", "someone who is {}", "the speaker looks {}", "{}",
    "a {} man talks", "a {} woman talks", "the body language is {}", "someone speaks like a {} person",
    "gestures of a {} speaker", "a person moves in a {} way",
)  # fmt: skip
HELD_OUT_TEMPLATES = (
    "somebody seems very {}", "imagine a {} guy telling a story", "the performer acts {}", "this one feels {} today",
    "a talk given by a {} human", "play it {}",
)  # fmt: skip
HALVES = ("upper", "lower")
_HALF_TEMPLATES = {
    "upper": ("the upper body is {}", "{} arms and head", "from the waist up a {} person", "the hands look {}"),
    "lower": ("the lower body is {}", "{} legs and hips", "from the waist down a {} person", "the legs look {}"),
}
_HELD_OUT_HALVES = {"upper": ("everything above the belt acts {}",), "lower": ("everything below the belt acts {}",)}
MIXED = (
    "{} above the waist, {} below", "the upper body is {} and the legs are {}", "{} hands on {} legs",
    "arms of a {} person, legs of a {} one",
)  # fmt: skip
HELD_OUT_MIXED = ("the top half feels {}, the bottom half {}",)
_SPAN = np.asarray(styles.HIGHEST) - np.asarray(styles.LOWEST)


def captions(style: str | StyleFactors, seed: int, held_out: bool = False, synonym: bool = False) -> str:
    """A caption of a style, by name or anywhere in the space of factors; the same seed gives the same words.

    `held_out` takes a template that no training caption has, `synonym` an adjective that none has.
    """
    draw = np.random.default_rng([seed, 61])
    words, looks = _words(style, draw, synonym), _looks(style, draw)
    if held_out:
        return _fill(HELD_OUT_TEMPLATES, words, draw)
    if synonym or draw.random() < 0.65:
        text = _fill(TEMPLATES, words, draw)
        return f"{text}, {looks}" if not synonym and draw.random() < 0.25 else text
    return looks


def half(style: str | StyleFactors, side: str, seed: int, held_out: bool = False, synonym: bool = False) -> str:
    """A caption of the upper or the lower half of a body.

    Raises:
        ValueError: a side that is neither 'upper' nor 'lower'.
    """
    if side not in HALVES:
        raise ValueError(f"a body has no half called {side!r}; choose one of {', '.join(HALVES)}.")
    draw = np.random.default_rng([seed, 67])
    templates = (_HELD_OUT_HALVES if held_out else _HALF_TEMPLATES)[side]
    return _fill(templates, _words(style, draw, synonym), draw)


def mixed(
    upper: str | StyleFactors, lower: str | StyleFactors, seed: int, held_out: bool = False, synonym: bool = False
) -> str:
    """A caption of a body whose halves are of two styles."""
    draw = np.random.default_rng([seed, 71])
    template = str(draw.choice(HELD_OUT_MIXED if held_out else MIXED))
    return _articles(template.format(_words(upper, draw, synonym), _words(lower, draw, synonym)))


def nearest(style: StyleFactors) -> list[tuple[str, float]]:
    """All training styles with their distances in spans of the factors (root mean square), nearest first."""
    ways = {name: (np.asarray(style) - np.asarray(styles.STYLES[name])) / _SPAN for name in styles.TRAINING}
    return sorted(((name, float(np.sqrt(np.mean(way**2)))) for name, way in ways.items()), key=lambda one: one[1])


def posture(style: StyleFactors) -> Sequence[str]:
    """What can be seen of the factors, in words; the most striking first."""
    seen = (
        (style.lean / 0.3, "leaning forward"), (-style.lean / 0.12, "leaning back"),
        (style.head_pitch / 0.35, "the head hanging"), (-style.head_pitch / 0.2, "chin up"),
        (style.crouch / 5.0, "knees bent"), (style.shoulders / 4.0, "shoulders up"),
        (-style.shoulders / 2.5, "drooping shoulders"), ((style.hand_height + 20.0) / 20.0, "hands high"),
        ((-35.0 - style.hand_height) / 10.0, "hands low"), ((style.radius - 0.5) / 0.35, "arms spread"),
        ((0.3 - style.radius) / 0.25, "hands close to the body"), ((style.amplitude - 13.0) / 7.0, "large strokes"),
        ((8.0 - style.amplitude) / 5.0, "small movements"), ((style.tempo - 1.0) / 0.3, "fast"),
        ((0.85 - style.tempo) / 0.2, "slow"), ((style.sway - 2.0) / 1.5, "swaying"),
        ((style.jerkiness - 0.35) / 0.4, "abrupt"), ((style.asymmetry - 0.3) / 0.4, "mostly one hand"),
        ((style.openness - 0.6) / 0.3, "open palms"), ((0.25 - style.openness) / 0.2, "closed fists"),
        ((style.nodding - 0.12) / 0.15, "nodding"),
    )  # fmt: skip
    return [words for size, words in sorted(seen, key=lambda one: -one[0]) if size >= 0.8]


def _words(style: str | StyleFactors, draw: np.random.Generator, synonym: bool) -> str:
    """An adjective, or two for a point between styles."""
    name = _name(style)
    if name is not None:
        chosen = WORDINGS[name].held_out if synonym else WORDINGS[name].words
        if not synonym and draw.random() < 0.15:
            return " and ".join(str(w) for w in draw.choice(chosen, 2, replace=False))
        return str(draw.choice(chosen))
    (first, near), (second, further) = nearest(_factors(style))[:2]
    pick = {w: str(draw.choice(WORDINGS[w].held_out if synonym else WORDINGS[w].words)) for w in (first, second)}
    if near < SLIGHT * further:
        return f"slightly {pick[first]}"
    return str(draw.choice(("between {} and {}", "half {} and half {}", "{} and a bit {}"))).format(*pick.values())


def _looks(style: str | StyleFactors, draw: np.random.Generator) -> str:
    """The posture in words: written for the named styles, read off the factors of others (and at times of those)."""
    name = _name(style)
    if name is not None and draw.random() < 0.7:
        return str(draw.choice(WORDINGS[name].looks))
    seen = list(posture(_factors(style)))[:4] or ["an upright body"]
    count = min(len(seen), int(draw.integers(2, 4)))
    return ", ".join(seen[k] for k in sorted(draw.choice(len(seen), count, replace=False)))


def _factors(style: str | StyleFactors) -> StyleFactors:
    return styles.find(style) if isinstance(style, str) else style


def _name(style: str | StyleFactors) -> str | None:
    """The name of a named style; None of another point. ValueError for an unknown name."""
    if isinstance(style, str):
        styles.find(style)
        return style
    return next((name for name, factors in styles.STYLES.items() if factors == style), None)


def _fill(templates: Sequence[str], words: str, draw: np.random.Generator) -> str:
    """One of the templates with its words; 'between' and 'half' get no article."""
    bare = words.startswith(("between", "half"))
    template = str(draw.choice([one for one in templates if not (bare and re.search(r"(\ba |^)\{\}", one))]))
    return _articles(template.format(words))


def _articles(text: str) -> str:
    """'an' before vowels."""
    return re.sub(r"\ba (?=[aeiou])", "an ", text)
