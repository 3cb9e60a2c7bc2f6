"""Looking at a model while it trains: closed-loop rollouts of clips that it is not trained on, measured and shown.

Nothing here changes the training: the state is read, batches and keys of the training are not touched.
"""

import dataclasses
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..data import rows, windows
from ..data.prepared import Prepared
from ..data.windows import Batch
from ..motion import bvh, features
from ..motion.bvh import Clip
from ..motion.features import Motion
from ..motion.pose import Pose
from ..training.step import Metrics, TrainState, trained
from . import style_space
from .generate import synthesize
from .losses import kl
from .model import Model, Params, StyleDistribution, encode_style
from .objective import Setting, compare, no_draws, unroll, weigh

SPLIT = "valid"
SAMPLE_CLIPS, SAMPLE_SECONDS = 3, 10.0


class Observers(NamedTuple):
    """What measures and shows rollouts; the caller's, because this room knows no measures and draws no pages."""

    judge: Callable[[Clip, Clip, np.ndarray], Mapping[str, float]] | None = None  # made, recorded, energy [T]
    show: Callable[[Path, Sequence[tuple[str, Clip]], str], Any] | None = None  # page, (label, clip), title


NOBODY = Observers()


def can_validate(corpus: Prepared, config: windows.WindowConfig) -> bool:
    """Whether some clip of the split 'valid' holds a window."""
    ranges = corpus.ranges[corpus.clips(SPLIT)].reshape(-1, 2)
    return bool(rows.window_count(ranges, config.window, config.as_released).any())


class Validation:
    """The loss of the same windows of the split 'valid', rolled out with the mean style, and a judge's measures.

    The divergence has its full weight `kl_limit`, so that losses of different updates compare.
    """

    def __init__(self, corpus: Prepared, setting: Setting, judge: Callable[..., Mapping[str, float]] | None) -> None:
        config = setting.config
        sizes = dataclasses.replace(config.windows, batch=config.validate_clips)
        batch = windows.batch(corpus, config.seed, 0, sizes, SPLIT)
        assert isinstance(batch, Batch)  # only windows of the training are augmented
        self.batch = batch
        self.corpus, self.judge = corpus, judge
        self._look = jax.jit(partial(_look, setting=setting))

    def __call__(self, state: TrainState) -> dict[str, float]:
        """ "loss", its terms, the judge's measures (means over the windows), "clips"."""
        loss, terms, made = jax.device_get(self._look(jax.device_get(trained(state)), self.batch))
        values = {"loss": float(loss), **{name: float(value) for name, value in terms.items()}}
        if self.judge is not None:
            values |= self._measures(made)
        return values | {"clips": len(self.batch.label)}

    def _measures(self, made: Pose) -> dict[str, float]:
        measured: dict[str, list[float]] = {}
        for b, speech in enumerate(self.batch.speech):
            ours, theirs = (_to_clip(poses, b, self.corpus) for poses in (made, self.batch.poses))
            if self.judge is not None and _is_finite(ours):
                for name, value in self.judge(ours, theirs, speech[:, -1]).items():
                    measured.setdefault(name, []).append(value)
        return {name: float(np.mean(found)) for name, found in measured.items()}


def _look(params: Params, batch: Batch, setting: Setting) -> tuple[Array, Metrics, Pose]:
    clips = len(batch.label)
    none = jax.tree.map(lambda a: jnp.broadcast_to(a, (clips, *a.shape)), no_draws(setting.config.model))
    made, style = unroll(params, batch, none, setting)
    terms = jax.vmap(partial(compare, setting=setting))(made, batch.poses, batch.gaze)
    return *weigh(terms, jax.vmap(kl)(style), setting.config.kl_limit), made


class Sampler:
    """Writes what the model makes of the starts of a few clips: a BVH file for each, a page with the recorded beside.

    Clips of the split 'valid', of the training where there is none. Bodies that are not finite are left out.
    """

    def __init__(self, corpus: Prepared, setting: Setting, show: Callable[..., Any] | None) -> None:
        self.corpus, self.setting, self.show = corpus, setting, show
        clips = corpus.clips(SPLIT) if len(corpus.clips(SPLIT)) else corpus.clips("train")
        self.clips = clips[np.unique(np.linspace(0, len(clips) - 1, SAMPLE_CLIPS).round().astype(int))]

    def __call__(self, folder: Path, state: TrainState) -> None:
        """Writes the folder whole or not at all."""
        config = self.setting.config.model
        model = Model(config, jax.device_get(trained(state)), self.corpus.scales, self.corpus.skeleton)
        partial_folder = folder.with_name(f".{folder.name}.partial")
        shutil.rmtree(partial_folder, ignore_errors=True)
        partial_folder.mkdir(parents=True)
        figures = []
        for number in self.clips:
            made, recorded = self._roll_out(model, int(number))
            if _is_finite(made):
                name = self.corpus.names[number].replace("/", "_")
                bvh.write(partial_folder / f"{name}.bvh", made)
                figures += [(f"{name}, made", made), (f"{name}, recorded", recorded)]
        if self.show is not None and figures:
            self.show(partial_folder / "index.html", figures, f"After {int(state.step)} updates")
        os.replace(partial_folder, folder)

    def _roll_out(self, model: Model, number: int) -> tuple[Clip, Clip]:
        start, stop = (int(row) for row in self.corpus.ranges[number])
        rows = slice(start, min(stop, start + round(SAMPLE_SECONDS / self.corpus.frame_time)))
        recorded = self.corpus.poses(rows)
        style = self._style(model, number, slice(start, min(stop, start + self.setting.config.windows.example[1])))
        held = style_space.hold(style.mean, rows.stop - rows.start)
        first = Motion(jax.tree.map(lambda a: a[:1], recorded), jnp.asarray(self.corpus.gaze[number]))
        made = synthesize(model, jnp.asarray(self.corpus.speech[rows]), held, first)
        return _to_clip(made, ..., self.corpus), _to_clip(recorded, ..., self.corpus)

    def _style(self, model: Model, number: int, rows: slice) -> StyleDistribution:
        if labels := model.config.labels:
            return StyleDistribution(jax.nn.one_hot(self.corpus.labels[number], len(labels)), None)
        return encode_style(model.params, model.config, model.scales, jnp.asarray(self.corpus.pose[rows]))


def _to_clip(poses: Pose, which: Any, corpus: Prepared) -> Clip:
    """One clip (`which` of a leading axis, or ...) as joints and angles."""
    return features.decode(jax.tree.map(lambda a: jnp.asarray(a[which]), poses), corpus.skeleton, corpus.frame_time)


def _is_finite(clip: Clip) -> bool:
    return bool(np.isfinite(clip.euler).all() and np.isfinite(clip.positions).all())
