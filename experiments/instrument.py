"""A model as an instrument: a library of styles and some speech; an embedding in, a moving body and its measures out.

What all figures of Sec. 5.2 share: which model, which library, the arguments that change them, rank correlations.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from scipy import stats
from tqdm import tqdm

import gauges
import ledger
import truth
from zeggs_jax.metrics import factors, kinematic
from zeggs_jax.metrics.factors import Ruler
from zeggs_jax.motion import features
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.features import Motion
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs import library as styles
from zeggs_jax.zeroeggs import style_clip, style_space
from zeggs_jax.zeroeggs.library import Entry, Library
from zeggs_jax.zeroeggs.model import Model

SETTLE = 1.5  # s, left out of every measure: until then the body comes from its first pose
SECONDS = 12.0  # of each speech


class Instrument(NamedTuple):
    """What is played: one model, the points of its style space, what it hears."""

    model: Model
    library: Library
    speeches: dict[str, np.ndarray]  # features [T, F] by name
    start: Motion  # the first pose of everything that is compared
    ruler: Ruler | None  # reads known factors; None where they are not known


def parser(text: str | None) -> argparse.ArgumentParser:
    """The arguments that all figures share."""
    found = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    found.add_argument("--checkpoint", type=Path, help="a run or converted checkpoint; the bundled model when left out")
    found.add_argument("--library", type=Path, help="its styles (zeggs embed); the bundled model has its own")
    found.add_argument("--speech", type=Path, nargs="+", default=[], help="recordings; the bundled ones when left out")
    found.add_argument("--factors", action="store_true", help="the checkpoint was trained on the synthetic corpus")
    found.add_argument("--ruler", type=Path, default=Path("runs/ruler"), help="where the ruler of factors is kept")
    ledger.add_docs(found)
    found.add_argument("-o", "--out", type=Path, required=True)
    return found


def tune(args: argparse.Namespace) -> Instrument:
    """The instrument that the arguments describe.

    Factors are read only where they are known: of the bundled model, or with --factors.
    """
    model = g.load_model(args.checkpoint) if args.checkpoint else g.bundled_model()
    library = styles.load(args.library, model) if args.library else styles.bundled(model)
    paths = args.speech or list(g.bundled_speech().values())
    rate_hz = round(1.0 / model.config.frame_time)
    speeches = {Path(path).stem: np.asarray(g.read_speech(path, model))[: round(SECONDS * rate_hz)] for path in paths}
    start = first_pose(library)
    known = args.factors or args.checkpoint is None
    args.out.mkdir(parents=True, exist_ok=True)
    return Instrument(model, library, speeches, start, truth.ruler(args.ruler) if known else None)


def first_pose(library: Library) -> Motion:
    """The pose that everything compared starts from: of the neutral style, else of the style nearest to the mean.

    A body keeps something of the pose it starts from for seconds, so the pose must not change with the style.
    """
    neutral = (e.start for e in library.entries if e.style.lower() == "neutral" and e.start is not None)
    start = next(neutral, None) or styles.start_near(library, np.asarray(styles.points(library)).mean(axis=0))
    if start is None:
        raise ValueError("no style of the library has a first pose; make the library with 'zeggs embed'.")
    return start


def play(instrument: Instrument, z: ArrayLike, speech: str | None = None, start: Motion | None = None) -> Clip:
    """The body that an embedding [Z], or one for each frame [T, Z], makes of a speech (the first one when left out)."""
    spectrum = jnp.asarray(instrument.speeches[speech or next(iter(instrument.speeches))])
    style = jnp.asarray(z)
    held = style_space.hold(style, len(spectrum)) if style.ndim == 1 else style
    poses = g.synthesize(instrument.model, spectrum, held, start or instrument.start)
    return features.decode(poses, instrument.model.skeleton, instrument.model.config.frame_time)


def measure(instrument: Instrument, clips: Sequence[Clip]) -> dict[str, float]:
    """Means over clips of every gauge and, where they are known, every factor."""
    found = [gauges.means(clip, SETTLE) for clip in clips]
    values = {name: float(np.mean([one[name] for one in found])) for name in found[0]}
    return values | (read_factors(instrument.ruler, clips) if instrument.ruler else {})


def read_factors(ruler: Ruler, clips: Sequence[Clip]) -> dict[str, float]:
    """Factors as the ruler reads them, named as "factor: lean", their mean over clips."""
    settled = []
    for clip in clips:
        skip = round(SETTLE / clip.frame_time)
        settled.append(clip._replace(euler=clip.euler[skip:], positions=clip.positions[skip:]))
    read = np.mean([factors.recover(ruler, factors.measures(clip)) for clip in settled], axis=0)
    return {f"factor: {name}": float(value) for name, value in zip(ruler.names, read, strict=True)}


def sweep(
    instrument: Instrument, embeddings: Sequence[ArrayLike], what: str = "steps"
) -> tuple[list[dict[str, float]], list[list[Clip]]]:
    """Measures of each embedding over all speeches, and its clips, one for each speech."""
    rows, clips = [], []
    for z in tqdm(embeddings, desc=what, unit="step"):
        clips.append([play(instrument, z, speech) for speech in instrument.speeches])
        rows.append(measure(instrument, clips[-1]))
    return rows, clips


def rank_correlations(steps: Sequence[float], rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Spearman's rank correlation of every measure with the steps; 0 for a measure that does not change."""
    found = {}
    for name in rows[0]:
        values = [row[name] for row in rows]
        found[name] = float(np.asarray(stats.spearmanr(steps, values))[0]) if np.ptp(values) > 0.0 else 0.0
    return found


def typical(clip: Clip) -> float:
    """The time in seconds of the frame, after settling, that is nearest to the clip's mean pose in its heading."""
    body = kinematic.in_heading(clip)
    skip = min(round(SETTLE / clip.frame_time), len(body) - 1)
    apart = np.square(body[skip:] - body[skip:].mean(axis=0)).sum(axis=(1, 2))
    return (skip + int(apart.argmin())) * clip.frame_time


def style(instrument: Instrument, name: str) -> Entry:
    """A style by its name in the library, or of a clip."""
    path = Path(name)
    if path.suffix.lower() == ".bvh":
        return style_clip.read_clip(path, instrument.model)
    return styles.find(instrument.library, name)


def example(name: str) -> Path | None:
    """The clip behind a style's name, where there is one at hand."""
    path = style_clip.bundled_clips().get(name, Path(name))
    return path if path.is_file() else None
