"""Named styles as points in a known factor space: the ground truth behind ZeroEGGS Sec. 5.2's style space."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np


class StyleFactors(NamedTuple):
    """How a body performs; every factor is a plain number, so that styles blend linearly."""

    lean: float = 0.03  # rad, trunk forward
    head_pitch: float = 0.02  # rad, chin below level, whatever the lean
    shoulders: float = 0.0  # cm, lifted (negative: drooping and rounded)
    crouch: float = 0.0  # cm, hips below their standing height
    hand_height: float = -25.0  # cm, centre of the gestures above the shoulders
    radius: float = 0.45  # 0 hands before the belly .. 1 arms wide and far
    amplitude: float = 13.0  # cm, path of a stroke on a syllable of strength 1
    tempo: float = 1.0  # relative speed of strokes; fast bodies also stroke more often
    sway: float = 1.2  # cm, lateral swing of the hips
    jerkiness: float = 0.2  # 0 soft .. 1 abrupt strokes that rebound
    asymmetry: float = 0.15  # 0 both hands .. 1 right hand only
    openness: float = 0.5  # 0 fists, palms down .. 1 fingers spread, palms up
    nodding: float = 0.06  # rad, dip of the head on a syllable of strength 1


STYLES: Mapping[str, StyleFactors] = MappingProxyType(
    {
        "neutral": StyleFactors(),
        "happy": StyleFactors(-0.05, -0.10, 1.0, 0.0, -14.0, 0.75, 19.0, 1.25, 3.2, 0.3, 0.0, 0.95, 0.12),
        "sad": StyleFactors(0.18, 0.40, -2.0, 1.0, -43.0, 0.0, 5.0, 0.7, 0.8, 0.0, 0.1, 0.25, 0.03),
        "angry": StyleFactors(0.20, 0.12, 2.0, 1.0, -19.0, 0.6, 24.0, 1.4, 0.8, 0.9, 0.1, 0.0, 0.14),
        "old": StyleFactors(0.42, 0.08, 1.0, 3.5, -33.0, 0.25, 9.0, 0.65, 1.4, 0.35, 0.7, 0.35, 0.05),
        "tired": StyleFactors(0.24, 0.24, -2.5, 2.5, -44.0, 0.7, 8.0, 0.6, 3.0, 0.0, 0.45, 0.45, 0.03),
        "relaxed": StyleFactors(-0.09, -0.04, -1.0, 0.5, -32.0, 0.6, 14.0, 0.75, 2.4, 0.0, 0.4, 0.7, 0.06),
        "still": StyleFactors(0.0, 0.0, 0.0, 0.0, -48.0, 0.35, 2.0, 0.8, 0.2, 0.0, 0.0, 0.4, 0.015),
        "scared": StyleFactors(-0.10, 0.12, 4.5, 4.0, -11.0, 0.05, 7.0, 1.5, 0.6, 0.8, 0.0, 0.2, 0.04),
        "sneaky": StyleFactors(0.36, -0.04, 3.0, 7.0, -22.0, 0.3, 9.0, 0.8, 3.0, 0.1, 0.5, 0.65, 0.05),
        "agreement": StyleFactors(0.08, 0.06, 0.0, 0.0, -38.0, 0.2, 6.0, 1.0, 1.0, 0.1, 0.0, 0.6, 0.38),
        "oration": StyleFactors(-0.04, -0.14, 1.5, 0.0, 15.0, 1.0, 18.0, 0.85, 2.0, 0.2, 0.0, 1.0, 0.08),
    }
)
HELD_OUT = ("oration",)
TRAINING = tuple(name for name in STYLES if name not in HELD_OUT)

LOWEST = StyleFactors(-0.15, -0.25, -3.0, 0.0, -48.0, 0.0, 2.0, 0.55, 0.0, 0.0, 0.0, 0.0, 0.0)
HIGHEST = StyleFactors(0.45, 0.42, 5.0, 10.0, 18.0, 1.0, 26.0, 1.5, 4.0, 1.0, 1.0, 1.0, 0.4)


def clamp(style: StyleFactors) -> StyleFactors:
    """`style` with every factor between LOWEST and HIGHEST, where bodies stay human."""
    return StyleFactors(*(float(v) for v in np.clip(style, LOWEST, HIGHEST)))


def blend(styles: Sequence[StyleFactors], weights: Sequence[float]) -> StyleFactors:
    """The weighted sum of styles (weights need not sum to 1), clamped.

    Raises ValueError when the two lists differ in length or are empty.
    """
    if not styles or len(styles) != len(weights):
        raise ValueError(f"got {len(styles)} styles and {len(weights)} weights; give one weight for each style.")
    return clamp(StyleFactors(*(np.asarray(weights, float) @ np.asarray(styles, float))))


def find(name: str) -> StyleFactors:
    """The style called `name`; ValueError lists the known names."""
    if name not in STYLES:
        raise ValueError(f"unknown synthetic style {name!r}; choose one of {', '.join(STYLES)}.")
    return STYLES[name]


def random_style(seed: int) -> StyleFactors:
    """A point between two or three training styles, jittered by a tenth of each factor's span.

    Half of the points draw their hand height anew, up to the shoulders and above, so that a model sees the
    whole reach of the arms; no point is made from a held-out style.
    """
    draw = np.random.default_rng([seed, 17])
    chosen = draw.choice(len(TRAINING), size=int(draw.integers(2, 4)), replace=False)
    weights = draw.dirichlet(np.ones(len(chosen)))
    point = np.asarray(blend([STYLES[TRAINING[i]] for i in chosen], weights.tolist()))
    point += 0.1 * (np.asarray(HIGHEST) - np.asarray(LOWEST)) * draw.uniform(-1.0, 1.0, len(point))
    style = StyleFactors(*(float(v) for v in point))
    if draw.random() < 0.5:
        style = style._replace(hand_height=float(draw.uniform(-46.0, 14.0)))
    return clamp(style)
