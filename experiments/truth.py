"""Synthetic truth of seeds that no training corpus has: clips of known factors, and the ruler fitted on them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from zeggs_jax.metrics import factors
from zeggs_jax.metrics.factors import Ruler
from zeggs_jax.motion import bvh
from zeggs_jax.synthetic import corpus, gestures, prosody, styles
from zeggs_jax.synthetic.styles import StyleFactors

NAMES = StyleFactors._fields
SPAN = np.array(styles.HIGHEST) - np.array(styles.LOWEST)
RULER_SEED, EXAMPLE_SEED, POINT_SEED = 810_000, 950_000, 960_000  # training corpora use seeds far below
RULER_CLIPS, RULER_SECONDS = 360, 12.0
RATE_HZ = 30


def anywhere(draw: np.random.Generator) -> StyleFactors:
    """A point of the whole box of factors, as far from the named styles as it may be."""
    return StyleFactors(*draw.uniform(styles.LOWEST, styles.HIGHEST).tolist())


def ruler_point(k: int, draw: np.random.Generator) -> StyleFactors:
    """The k-th style to fit the ruler on: anywhere, between training styles, or near a named one, in turn."""
    if k % 3 == 0:
        return anywhere(draw)
    if k % 3 == 1:
        return styles.random_style(RULER_SEED + k)
    named = np.asarray(list(styles.STYLES.values())[k // 3 % len(styles.STYLES)])
    return styles.clamp(StyleFactors(*(named + 0.08 * SPAN * draw.uniform(-1.0, 1.0, len(SPAN))).tolist()))


def ruler(folder: Path, clips: int = RULER_CLIPS, seconds: float = RULER_SECONDS) -> Ruler:
    """The ruler of factors, fitted on synthetic truth; its measures are kept in `folder`."""
    path = folder / f"ruler_{clips}_{seconds:g}.npz"
    if not path.exists():
        draw = np.random.default_rng(5)
        points = [ruler_point(k, draw) for k in range(clips)]
        measured = [
            factors.measures(corpus.style_clip(point, seconds, RATE_HZ, RULER_SEED + k))
            for k, point in enumerate(tqdm(points, desc="truth for the ruler", unit="clip"))
        ]
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(path, measured=np.stack(measured), factors=np.array(points))
    with np.load(path) as kept:
        return factors.fit(kept["measured"], kept["factors"], NAMES)


def recovered(ruler: Ruler, clip: bvh.Clip) -> StyleFactors:
    """The factors that the ruler reads off a clip."""
    return StyleFactors(*factors.recover(ruler, factors.measures(clip)).tolist())


def errors(found: StyleFactors, true: StyleFactors) -> dict[str, float]:
    """Distance of every factor in its own unit, and `share`: their mean as shares of the factors' spans."""
    apart = np.abs(np.array(found) - np.array(true))
    return {**dict(zip(NAMES, apart.tolist(), strict=True)), "share": float((apart / SPAN).mean())}


def example(folder: Path, name: str, factors: StyleFactors, seconds: float, seed: int) -> Path:
    """A style clip of known factors on disk."""
    path = folder / f"{name}_{seed}_{seconds:g}s.bvh"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        bvh.write(path, corpus.style_clip(factors, seconds, RATE_HZ, seed))
    return path


def performed(wave: np.ndarray, factors: StyleFactors, frames: int, seed: int = 0) -> bvh.Clip:
    """What the synthetic body does to a speech [n] at 16 kHz: the truth beside a generated clip."""
    return gestures.perform(prosody.measure(wave), factors, frames, RATE_HZ, seed)


def clips(names: Sequence[str], seeds: Sequence[int], seconds: float) -> dict[str, list[bvh.Clip]]:
    """Clips of named styles, performed to synthetic speech."""
    jobs = [(name, seed) for name in names for seed in seeds]
    made: dict[str, list[bvh.Clip]] = {name: [] for name in names}
    for name, seed in tqdm(jobs, desc="truth", unit="clip"):
        made[name].append(corpus.style_clip(name, seconds, RATE_HZ, seed))
    return made
