"""What looking less far ahead costs: the bundled model, the same with its look-ahead cut, and trained on with less.

    python experiments/look_ahead.py runs/demo/prepared VOICE.wav ... -o OUT [--trained 4] [--cuts 8 4 2 0]

The arrays are those of the bundled model's training (02_synthetic.py leaves them there). A cut model takes the last
frame that it sees for all that follow, which is what `zeggs stream --lookahead` does. A trained one begins as that and
is trained on, closed loop, with `SpeechEncoderConfig.lookahead`, which keeps the whole kernel: it sees that much more
of the past. Rhythm over all bundled styles and voices as in measure_demo.py, also without any lag allowed; errors are
those of unseen clips (rollouts.reconstruction). Stop it and run it again to go on.
"""

import argparse
import importlib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import numpy as np

import ledger
import rollouts
from zeggs_jax.data import prepared
from zeggs_jax.data.prepared import Prepared
from zeggs_jax.metrics import kinematic, rhythm
from zeggs_jax.motion import bvh
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import live, wav
from zeggs_jax.zeroeggs import examples
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs.checkpoints import load_model
from zeggs_jax.zeroeggs.model import Model
from zeggs_jax.zeroeggs.train import train

COLUMNS = (
    ("waits_ms", "waits, ms", "{:.0f}"),
    ("matched", "r", "{:.3f}"),
    ("at_once", "r without lag", "{:.3f}"),
    ("shifted", "moved in time", "{:.3f}"),
    ("loss", "loss, unseen clips", "{:.4f}"),
    ("joint_cm", "joints, cm", "{:.2f}"),
    ("hands_cm", "hands, cm", "{:.2f}"),
)


def cut(model: Model, lookahead: int) -> Model:
    """The model as a stream with so short a look-ahead runs it: each frame's last row stands for those that follow.

    What its kernel had for the rows beyond is added to the last one's; for the rows that it now sees behind, it has 0.
    """
    sees = replace(model.config.speech, lookahead=lookahead)
    away = model.config.speech.ahead - lookahead
    weight = np.asarray(model.params["speech"]["conv1"]["weight"])  # (out, in, kernel), the past first
    kept, beyond = weight[..., : sees.kernel - away], weight[..., sees.kernel - away :]
    moved = np.concatenate([np.zeros_like(beyond), kept], axis=-1)
    moved[..., -1] += beyond.sum(-1)
    speech = model.params["speech"] | {"conv1": model.params["speech"]["conv1"] | {"weight": moved}}
    return model._replace(config=replace(model.config, speech=sees), params=model.params | {"speech": speech})


def trained(lookahead: int, data: Path, out: Path, steps: int) -> Model:
    """The bundled model cut and trained on, or gone on with, as its second training was."""
    begun, freed = cut(g.bundled_model(), lookahead), importlib.import_module("02_synthetic").FREED
    model = replace(freed.model, speech=replace(freed.model.speech, lookahead=lookahead))
    run = out / f"trained_{lookahead}"
    settings = replace(freed, model=model, steps=steps, ema=0.99, checkpoint_every=50, validate_every=0)
    train(data, run, settings, initial=begun)
    return load_model(run)


def measure(model: Model, name: str, lookahead: int, voices: Sequence[Path], arrays: Prepared) -> ledger.Row:
    """How long a frame waits at most, rhythm over all styles and voices, errors on unseen clips."""
    waits = lookahead * model.config.frame_time + live.delay_s(bvh.rate_hz(model.config.frame_time))[1]
    rows = [rhythm_of(model, voice, style) for voice in voices for style in examples.bundled()]
    means = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    errors = rollouts.reconstruction(model, arrays)
    return {"name": name, "lookahead": lookahead, "waits_ms": 1e3 * waits, **means, **errors}


def rhythm_of(model: Model, voice: Path, style: str) -> dict[str, float]:
    """How the hands' speed goes with the speech's energy, with and without a lag of up to 0.2 s."""
    clip, rate = g.generate(voice, style, model=model).clip, bvh.rate_hz(model.config.frame_time)
    energy = np.asarray(speech_features.frame_energy(wav.read(voice), len(clip.euler), rate), np.float64)
    speed = kinematic.hand_speed(clip)
    found = rhythm.agreement(speed, energy, rate)
    at_once = rhythm.correlation(rhythm.smooth(speed, rate), rhythm.smooth(energy, rate))
    return {"matched": found.matched, "shifted": found.shifted, "at_once": at_once}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="the prepared corpus of the bundled model")
    parser.add_argument("voices", type=Path, nargs="+", help="recordings that training never saw")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--cuts", type=int, nargs="*", default=(8, 4, 2, 0), help="look-aheads of cut models")
    parser.add_argument("--trained", type=int, nargs="*", default=(4,), help="look-aheads of models trained on")
    parser.add_argument("--steps", type=int, default=400, help="updates of each training")
    args = parser.parse_args()
    arrays, whole = prepared.load(args.data), g.bundled_model()
    full = whole.config.speech.ahead
    jobs = {"bundled": partial(measure, whole, "bundled", full, args.voices, arrays)}
    for ahead in args.cuts:
        jobs[f"cut {ahead}"] = partial(measure, cut(whole, ahead), f"cut to {ahead} frames", ahead, args.voices, arrays)
    for ahead in args.trained:
        model = trained(ahead, args.data, args.out, args.steps)
        name = f"trained {args.steps} updates with {ahead} frames"
        jobs[name] = partial(measure, model, name, ahead, args.voices, arrays)
    rows = ledger.fill(args.out / "rows.jsonl", jobs, "models")
    head, body = ["look-ahead", *(title for _, title, _ in COLUMNS)], []
    for row in rows:
        body.append([row["name"], *(form.format(row[column]) for column, _, form in COLUMNS)])
    print(ledger.table(head, body))
    print(f"{jax.default_backend()}, {len(args.voices)} voices, {len(examples.bundled())} styles")


if __name__ == "__main__":
    main()
