"""Is the style space an instrument? Walks, components, samples and timelines, measured (ZeroEGGS Sec. 5.2).

    python experiments/12_control.py -o runs/control [--checkpoint RUN --library LIBRARY.npz] [--speech VOICE.wav ...]

Interpolation of every pair of styles and intensity 0 to 2 of every style, in 9 steps: rank correlation of the steps
with the known factors (read off by the ruler of metrics/factors.py) and with what is measured directly (posture.py).
The first components of the library, from -2 to 2 standard deviations: the same. One speech in all styles: recognised by
nearest centroids of synthetic truth. 20 samples of a style at several temperatures: how much they differ. A minute of
speech in five styles: peak joint acceleration of the transitions against the truth's. Without known factors (a model of
other styles than the synthetic corpus') what needs the truth is left out. Prints tables, writes OUT/control.json; a
stopped run goes on where it was. Without --checkpoint: the bundled model.
"""

import argparse
from collections.abc import Callable
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import control
import ledger
import promises
import sweeps
import transitions
import truth
from sweeps import Stage
from zeggs_jax.metrics import diversity, kinematic
from zeggs_jax.motion import bvh
from zeggs_jax.speech import wav
from zeggs_jax.synthetic import recording, styles
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs import library, style_space, timeline
from zeggs_jax.zeroeggs.checkpoints import load_model
from zeggs_jax.zeroeggs.library import Entry, Library
from zeggs_jax.zeroeggs.principal import Principal

STEPS = 9
COMPONENTS = 4
TEMPERATURES, SAMPLES, SAMPLED = (0.0, 0.5, 1.0, 2.0), 20, 4  # SAMPLED styles are sampled
SPOKEN_S, SPOKEN_SEED = 12.0, 900_500  # synthetic speeches for recognition; training corpora use seeds far below
TRUTH_SEEDS = range(900_000, 900_004)

Jobs = dict[str, Callable[[], ledger.Row]]


class Setting(NamedTuple):
    """What is asked: the styles of a library, performed by its model."""

    stage: Stage  # the speech of the walks
    others: Stage  # speeches for recognition
    minute: Stage  # one speech of 60 s
    wave: np.ndarray  # of the minute, at 16 kHz
    styles: dict[str, Entry]
    library: Library


def interpolation(at: Setting, a: str, b: str) -> ledger.Row:
    """From one style to another in 9 steps, from the first pose of the first."""
    points = style_space.line(at.styles[a].distribution.mean, at.styles[b].distribution.mean, STEPS)
    shown = sweeps.walk(at.stage, points, at.styles[a].start)
    return {"kind": "interpolation", "a": a, "b": b, "shown": shown}


def intensity(at: Setting, name: str) -> ledger.Row:
    """From the library's mean (0) through the style (1) to twice as far (2)."""
    style, centre = at.styles[name].distribution.mean, library.points(at.library).mean(0)
    amounts = np.linspace(0.0, 2.0, STEPS, dtype=np.float32)
    points = jax.vmap(lambda amount: style_space.intensify(style, centre, amount))(amounts)
    shown = sweeps.walk(at.stage, points, at.styles[name].start)
    return {"kind": "intensity", "style": name, "amounts": amounts.tolist(), "shown": shown}


def component(at: Setting, components: Principal, number: int) -> ledger.Row:
    """From -2 to 2 standard deviations along a principal component, from the library's mean."""
    amounts = np.linspace(-2.0, 2.0, STEPS, dtype=np.float32)
    points = jnp.stack([style_space.move(components, components.mean, {number: float(x)}) for x in amounts])
    shown = sweeps.walk(at.stage, points, library.start_near(at.library, components.mean))
    return {"kind": "component", "number": number, "share": float(components.share[number - 1]), "shown": shown}


def performances(at: Setting, speech: str) -> ledger.Row:
    """The statistics that recognition reads, of one speech in every style."""
    points = jnp.stack([entry.distribution.mean for entry in at.styles.values()])
    clips = sweeps.perform(at.others, speech, points, [entry.start for entry in at.styles.values()])
    rows = {name: kinematic.style_statistics(clip).tolist() for name, clip in zip(at.styles, clips, strict=True)}
    return {"kind": "performance", "speech": speech, "rows": rows}


def real(seed: int, name: str) -> ledger.Row:
    """The same of a clip of synthetic truth."""
    (clip,) = truth.clips([name], [seed], SPOKEN_S)[name]
    return {"kind": "real", "style": name, "row": kinematic.style_statistics(clip).tolist()}


def samples(at: Setting, name: str, temperature: float) -> ledger.Row:
    """How much 20 samples of a style differ: in their statistics, and where their hands are."""
    entry, (speech,) = at.styles[name], at.stage.spectra
    points = style_space.vary(jax.random.key(0), entry.distribution, SAMPLES, temperature)
    clips = sweeps.perform(at.stage, speech, points, [entry.start] * SAMPLES)
    joints = [clips[0].skeleton.role(hand) for hand in ("left_hand", "right_hand")]
    hands = np.stack([kinematic.world_positions(clip)[:, joints] for clip in clips])
    return {
        "kind": "samples", "style": name, "temperature": temperature,
        "diversity": diversity.diversity(np.stack([kinematic.style_statistics(clip) for clip in clips])),
        "hands_cm": float(np.linalg.norm(hands - hands[:1], axis=-1).mean() * SAMPLES / (SAMPLES - 1)),
    }  # fmt: skip


def played(at: Setting, order: list[str]) -> ledger.Row:
    """A minute in five styles, by kind of transition: peak accelerations there, and 6 s later, where all is steady."""
    (speech,) = at.minute.spectra
    points = {name: at.styles[name].distribution.mean for name in order}
    frames, rate_hz = len(at.minute.spectra[speech]), bvh.rate_hz(at.stage.model.config.frame_time)
    timelines = [transitions.of_styles(order, kind) for kind in transitions.KINDS]
    sequences = jnp.stack([timeline.sequence(one, points, None, frames, rate_hz) for one in timelines])
    clips = sweeps.perform(at.minute, speech, sequences, [at.styles[order[0]].start] * len(sequences))
    made, times = dict(zip(transitions.KINDS, clips, strict=True)), transitions.begins(len(order))
    return {
        "kind": "timeline", "order": order,
        "peaks": {kind: transitions.peaks(clip, times[1:]) for kind, clip in made.items()},
        "steady": {kind: transitions.peaks(clip, [t + 6.0 for t in times]) for kind, clip in made.items()},
    }  # fmt: skip


def real_peaks(at: Setting, name: str) -> ledger.Row:
    """Peak accelerations of the truth of a style, performed to the same minute of speech, in windows of 2 s."""
    (spectrum,) = at.minute.spectra.values()
    clip = truth.performed(at.wave, styles.STYLES[name], len(spectrum), SPOKEN_SEED)
    return {"kind": "real peaks", "style": name, "peaks": transitions.all_peaks(clip)}


def jobs(at: Setting, timelines: int, known: bool) -> Jobs:
    """Everything that is asked, by name."""
    names, listed = list(at.styles), {}
    for a, b in combinations(names, 2):
        listed[f"{a} to {b}"] = partial(interpolation, at, a, b)
    listed |= {f"intensity of {name}": partial(intensity, at, name) for name in names}
    components = style_space.principal(library.points(at.library))
    for number in range(1, min(COMPONENTS, len(components.std)) + 1):
        listed[f"component {number}"] = partial(component, at, components, number)
    for name in names[:SAMPLED]:
        listed |= {f"{name} at {t:g}": partial(samples, at, name, t) for t in TEMPERATURES}
    for k, order in enumerate(transitions.orders(names, timelines)):
        listed[f"timeline {k}"] = partial(played, at, order)
    if known:
        listed |= {f"all speak {speech}": partial(performances, at, speech) for speech in at.others.spectra}
        listed |= {f"real {name} {seed}": partial(real, seed, name) for name in names for seed in TRUTH_SEEDS}
        listed |= {f"real peaks of {name}": partial(real_peaks, at, name) for name in names}
    return listed


def setting(args: argparse.Namespace) -> tuple[Setting, bool]:
    """Model, library, speeches and, where the styles are those of the synthetic corpus, the ruler."""
    model = g.bundled_model() if args.checkpoint is None else load_model(args.checkpoint)
    kept = library.bundled(model) if args.library is None else library.load(args.library, model)
    started = dict.fromkeys(entry.style for entry in kept.entries if entry.start is not None)
    found = {name: library.find(kept, name) for name in started}
    known = set(found) <= set(styles.STYLES)
    said = {path.stem: wav.read(path) for path in args.speech} or {"spoken": wav.read(g.bundled_speech()["spoken"])}
    first = dict([next(iter(said.items()))])
    spoken = {f"seed {k}": recording.speak(SPOKEN_S, SPOKEN_SEED + k).wave for k in range(3)}
    minute = recording.speak(transitions.SECONDS, SPOKEN_SEED + 9).wave
    minute = np.resize(minute, round(transitions.SECONDS * wav.RATE_HZ))

    def heard(waves: dict[str, np.ndarray]) -> Stage:
        spectra = {name: g.read_speech(wave, model) for name, wave in waves.items()}
        return Stage(model, spectra, truth.ruler(args.out) if known else None)

    stages = heard(first), heard({**said, **spoken}), heard({"minute": minute})
    return Setting(*stages, minute, found, kept), known


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path("runs/control"), help="where results are kept")
    parser.add_argument("--checkpoint", type=Path, help="a training run or converted release (default: bundled)")
    parser.add_argument("--library", type=Path, help="a library of its styles, by 'zeggs embed' (default: bundled)")
    parser.add_argument("--speech", type=Path, nargs="*", default=[], help="recordings; the first is that of the walks")
    parser.add_argument("--timelines", type=int, default=10, help="minutes in five styles")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    at, known = setting(args)
    rows = ledger.fill(args.out / f"{at.library.model[:12]}.jsonl", jobs(at, args.timelines, known), "control")
    found = control.summary(rows)
    print(promises.tables(found))
    ledger.save(args.out / "control.json", {"promises": promises.promises(found), **found})


if __name__ == "__main__":
    main()
