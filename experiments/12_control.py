"""Is the style space an instrument? Walks, components, samples and timelines, measured (ZeroEGGS Sec. 5.2).

    python experiments/12_control.py -o runs/control [--checkpoint RUN --library LIBRARY.npz] [--speech VOICE.wav ...]

Interpolation of every pair of styles and intensity 0 to 2 of every style, in 9 steps: rank correlation of the steps
with the known factors (read off by the ruler of metrics/factors.py) and with direct measures (gauges.py). The first
components of the library, from -2 to 2 standard deviations: the same. One speech in all styles: recognised by nearest
centroids of synthetic truth. 20 samples of a style at several temperatures: how much they differ. A minute of speech
in five styles: peak joint acceleration at the transitions against the truth's. Where the factors are not known (a model
of other styles than the synthetic corpus'), what needs the truth is left out. Prints tables, writes OUT/control.json; a
stopped run goes on where it was.
"""

import argparse
from collections.abc import Callable
from functools import partial
from itertools import combinations
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import control
import instrument
import ledger
import promises
import sweeps
import transitions
import truth
from instrument import Instrument
from zeggs_jax.metrics import diversity, kinematic
from zeggs_jax.motion import bvh
from zeggs_jax.speech import wav
from zeggs_jax.synthetic import recording, styles
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs import library, style_space, timeline
from zeggs_jax.zeroeggs.library import Entry
from zeggs_jax.zeroeggs.model import Model
from zeggs_jax.zeroeggs.principal import Principal

STEPS = 9
COMPONENTS = 4
TEMPERATURES, SAMPLES, SAMPLED = (0.0, 0.5, 1.0, 2.0), 20, 4  # SAMPLED styles are sampled
SPOKEN_S, SPOKEN_SEED = 12.0, 900_500  # synthetic speeches for recognition; training corpora use seeds far below
TRUTH_SEEDS = range(900_000, 900_004)

Jobs = dict[str, Callable[[], ledger.Row]]


class Setting(NamedTuple):
    """What is asked: the styles of a library, performed by its model."""

    walks: Instrument  # hears one speech
    speeches: dict[str, np.ndarray]  # features, for recognition
    minute: np.ndarray  # features of 60 s of speech
    wave: np.ndarray  # the same at 16 kHz
    styles: dict[str, Entry]

    @property
    def model(self) -> Model:
        """The model."""
        return self.walks.model


def interpolation(at: Setting, a: str, b: str) -> ledger.Row:
    """From one style to another in 9 steps, from the first pose of the first."""
    points = style_space.line(at.styles[a].distribution.mean, at.styles[b].distribution.mean, STEPS)
    shown = sweeps.walk(at.walks, points, at.styles[a].start)
    return {"kind": "interpolation", "a": a, "b": b, "shown": shown}


def intensity(at: Setting, name: str) -> ledger.Row:
    """From the library's mean (0) through the style (1) to twice as far (2)."""
    style, centre = at.styles[name].distribution.mean, library.points(at.walks.library).mean(0)
    amounts = np.linspace(0.0, 2.0, STEPS, dtype=np.float32)
    points = jax.vmap(lambda amount: style_space.intensify(style, centre, amount))(amounts)
    shown = sweeps.walk(at.walks, points, at.styles[name].start)
    return {"kind": "intensity", "style": name, "amounts": amounts.tolist(), "shown": shown}


def component(at: Setting, components: Principal, number: int) -> ledger.Row:
    """From -2 to 2 standard deviations along a principal component, from the library's mean."""
    amounts = np.linspace(-2.0, 2.0, STEPS, dtype=np.float32)
    points = jnp.stack([style_space.move(components, components.mean, {number: float(x)}) for x in amounts])
    shown = sweeps.walk(at.walks, points, at.walks.start)
    return {"kind": "component", "number": number, "share": float(components.share[number - 1]), "shown": shown}


def performances(at: Setting, speech: str) -> ledger.Row:
    """The statistics that recognition reads, of one speech in every style."""
    points = jnp.stack([entry.distribution.mean for entry in at.styles.values()])
    clips = sweeps.perform(at.model, at.speeches[speech], points, [entry.start for entry in at.styles.values()])
    rows = {name: kinematic.style_statistics(clip).tolist() for name, clip in zip(at.styles, clips, strict=True)}
    return {"kind": "performance", "speech": speech, "rows": rows}


def real(seed: int, name: str) -> ledger.Row:
    """The same of a clip of synthetic truth."""
    (clip,) = truth.clips([name], [seed], SPOKEN_S)[name]
    return {"kind": "real", "style": name, "row": kinematic.style_statistics(clip).tolist()}


def samples(at: Setting, name: str, temperature: float) -> ledger.Row:
    """How much 20 samples of a style differ: in their statistics, and where their hands are."""
    entry, (heard,) = at.styles[name], at.walks.speeches.values()
    points = style_space.vary(jax.random.key(0), entry.distribution, SAMPLES, temperature)
    clips = sweeps.perform(at.model, heard, points, [entry.start] * SAMPLES)
    joints = [clips[0].skeleton.role(hand) for hand in ("left_hand", "right_hand")]
    hands = np.stack([kinematic.world_positions(clip)[:, joints] for clip in clips])
    return {
        "kind": "samples", "style": name, "temperature": temperature,
        "diversity": diversity.diversity(np.stack([kinematic.style_statistics(clip) for clip in clips])),
        "hands_cm": float(np.linalg.norm(hands - hands[:1], axis=-1).mean() * SAMPLES / (SAMPLES - 1)),
    }  # fmt: skip


def played(at: Setting, order: list[str]) -> ledger.Row:
    """A minute in five styles, by kind of transition: peak accelerations there, and 6 s later, where all is steady."""
    points = {name: at.styles[name].distribution.mean for name in order}
    frames, rate_hz = len(at.minute), bvh.rate_hz(at.model.config.frame_time)
    timelines = [transitions.of_styles(order, kind) for kind in transitions.KINDS]
    sequences = jnp.stack([timeline.sequence(one, points, None, frames, rate_hz) for one in timelines])
    clips = sweeps.perform(at.model, at.minute, sequences, [at.styles[order[0]].start] * len(sequences))
    made, times = dict(zip(transitions.KINDS, clips, strict=True)), transitions.begins(len(order))
    return {
        "kind": "timeline", "order": order,
        "peaks": {kind: transitions.peaks(clip, times[1:]) for kind, clip in made.items()},
        "steady": {kind: transitions.peaks(clip, [t + 6.0 for t in times]) for kind, clip in made.items()},
    }  # fmt: skip


def real_peaks(at: Setting, name: str) -> ledger.Row:
    """Peak accelerations of the truth of a style, performed to the same minute of speech, in windows of 2 s."""
    clip = truth.performed(at.wave, styles.STYLES[name], len(at.minute), SPOKEN_SEED)
    return {"kind": "real peaks", "style": name, "peaks": transitions.all_peaks(clip)}


def jobs(at: Setting, timelines: int, pairs: int | None) -> Jobs:
    """Everything that is asked, by name; of the pairs of styles, some that are spread over all of them."""
    names, listed = list(at.styles), {}
    if at.walks.ruler is not None:
        listed |= {f"all speak {speech}": partial(performances, at, speech) for speech in at.speeches}
        listed |= {f"real {name} {seed}": partial(real, seed, name) for name in names for seed in TRUTH_SEEDS}
        listed |= {f"real peaks of {name}": partial(real_peaks, at, name) for name in names}
    for k, order in enumerate(transitions.orders(names, timelines)):
        listed[f"timeline {k}"] = partial(played, at, order)
    components = style_space.principal(library.points(at.walks.library))
    for number in range(1, min(COMPONENTS, len(components.std)) + 1):
        listed[f"component {number}"] = partial(component, at, components, number)
    for name in names[:SAMPLED]:
        listed |= {f"{name} at {t:g}": partial(samples, at, name, t) for t in TEMPERATURES}
    listed |= {f"intensity of {name}": partial(intensity, at, name) for name in names}
    every = list(combinations(names, 2))
    for a, b in every[:: -(-len(every) // (pairs or len(every)))]:
        listed[f"{a} to {b}"] = partial(interpolation, at, a, b)
    return listed


def setting(args: argparse.Namespace) -> Setting:
    """Model, library and speeches; the styles are those of the library that have a clip to start from."""
    at = instrument.tune(args)
    started = dict.fromkeys(entry.style for entry in at.library.entries if entry.start is not None)
    if at.ruler is not None and (unknown := sorted(set(started) - set(styles.STYLES))):
        raise ValueError(f"the factors of style '{unknown[0]}' are not known; give a library of the named styles.")
    spoken = {f"seed {k}": recording.speak(SPOKEN_S, SPOKEN_SEED + k).wave for k in range(3)}
    heard = {name: np.asarray(g.read_speech(wave, at.model)) for name, wave in spoken.items()}
    wave = recording.speak(transitions.SECONDS, SPOKEN_SEED + 9).wave
    wave = np.resize(wave, round(transitions.SECONDS * wav.RATE_HZ))
    return Setting(
        walks=at._replace(speeches=dict([next(iter(at.speeches.items()))])),
        speeches={**at.speeches, **heard},
        minute=np.asarray(g.read_speech(wave, at.model)),
        wave=wave,
        styles={name: library.find(at.library, name) for name in started},
    )


def main() -> None:
    parser = instrument.parser(__doc__)
    parser.add_argument("--timelines", type=int, default=10, help="minutes in five styles")
    parser.add_argument("--pairs", type=int, help="interpolate so many pairs of styles at most (default: all)")
    args = parser.parse_args()
    at = setting(args)
    rows = ledger.fill(
        args.out / f"{at.walks.library.model[:12]}.jsonl", jobs(at, args.timelines, args.pairs), "control"
    )
    found = control.summary(rows)
    ledger.tell(promises.tables(found), "12_control", args.docs)
    ledger.save(args.out / "control.json", {"promises": promises.promises(found), **found})


if __name__ == "__main__":
    main()
