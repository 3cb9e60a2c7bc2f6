"""What a style encoder's kind does to the style space: the paper's (Fig. 3b), the release's GRU, and two of our own.

    python experiments/06_style_encoders.py corpus -o runs/encoders [--only KIND ...] [--seeds 1 2] [--steps 700]

One small training each (trials.py says how small), the same but for `model.style.kind`, with 16 numbers of style. Asked
of each: reconstruction, factors and variety of generated motion as in the ablations (04); whether known factors can be
read off the embedding and how they lie in it (DCI, SAP: metrics/disentanglement.py), of clips that training never
heard, drawn anywhere in the box of factors, where they are independent, and between the styles, as in training; and
what of the body moves when one slice of the embedding is exchanged for that of another style. For kinds without parts
the slices are the same cuts of an embedding that knows nothing of them: what can be had by chance.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

import ledger
import trials
import truth
import voices as recordings
from zeggs_jax.data import prepared
from zeggs_jax.geometry import rotation
from zeggs_jax.metrics import disentanglement
from zeggs_jax.motion import features, pose
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.synthetic import corpus, styles
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs import parts_encoder, style_clip, style_space
from zeggs_jax.zeroeggs.model import Model, encode_style
from zeggs_jax.zeroeggs.train import TrainConfig

KINDS = ("attn", "gru", "bottleneck", "parts")
CLIPS, CLIP_SECONDS, CLIP_SEED = 160, 6.0, 970_000  # training corpora and rulers use other seeds
PIECE = 20  # clips that are encoded at once
EXCHANGED = (("neutral", "happy"), ("sad", "angry"), ("old", "relaxed"), ("still", "sneaky"), ("tired", "scared"))
COLUMNS = (
    ("loss", "validation loss", "{:.4f}"),
    ("joint_cm", "joints, cm", "{:.2f}"),
    ("seen_share", "factors, seen styles", "{:.1%}"),
    ("held_out_share", "factors, oration", "{:.1%}"),
    ("matched_synthetic", "r", "{:.2f}"),
    ("variety_cm", "variety, cm", "{:.2f}"),
)
SPACE = (
    ("anywhere_informativeness", "told, anywhere", "{:.2f}"),
    ("anywhere_disentanglement", "disentangled", "{:.2f}"),
    ("anywhere_completeness", "complete", "{:.2f}"),
    ("anywhere_sap", "SAP", "{:.2f}"),
    ("between_informativeness", "told, between styles", "{:.2f}"),
    ("between_disentanglement", "disentangled", "{:.2f}"),
    ("between_completeness", "complete", "{:.2f}"),
    ("between_sap", "SAP", "{:.2f}"),
    ("own_share", "slice turns its part", "{:.2f}"),
)


def variants() -> dict[str, TrainConfig]:
    """The small model with each kind of style encoder."""
    style = trials.SMALL.model.style
    kinds = {kind: replace(style, kind=kind) for kind in KINDS}
    return {kind: replace(trials.SMALL, model=replace(trials.SMALL.model, style=of)) for kind, of in kinds.items()}


def clips(where: str, folder: Path, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Pose vectors [N, M, D] of clips of known factors [N, F], kept in `folder`."""
    path = folder / f"{where}_{count}_{CLIP_SECONDS:g}.npz"
    if not path.exists():
        draw = np.random.default_rng(CLIP_SEED)
        anywhere = where == "anywhere"
        points = [truth.anywhere(draw) if anywhere else styles.random_style(CLIP_SEED + k) for k in range(count)]
        made = [
            pose.to_vector(features.encode(corpus.style_clip(point, CLIP_SECONDS, truth.RATE_HZ, CLIP_SEED + k)).pose)
            for k, point in enumerate(tqdm(points, desc=f"clips {where}", unit="clip"))
        ]
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(path, poses=np.stack(made), factors=np.array(points))
    with np.load(path) as kept:
        return kept["poses"], kept["factors"]


def embedded(model: Model, poses: np.ndarray) -> np.ndarray:
    """Means [N, Z] of the styles of N clips."""
    one = partial(encode_style, model.params, model.config, model.scales)
    run = jax.jit(jax.vmap(lambda example: one(example).mean))
    return np.concatenate([np.asarray(run(poses[k : k + PIECE])) for k in range(0, len(poses), PIECE)])


def space(name: str, seed: int, out: Path, count: int, wave: np.ndarray) -> ledger.Row:
    """How the factors lie in the embedding of a trained run, and what its slices move."""
    model = g.load_model(out / "runs" / f"{name}_{seed}")
    row: ledger.Row = {"name": name, "seed": seed}
    for where in ("anywhere", "between"):
        poses, factors = clips(where, out, count)
        found = disentanglement.score(embedded(model, poses), factors)
        row |= {f"{where}_{key}": getattr(found, key) for key in found._fields[:4]}
        row |= {f"{where}_{key}": np.round(getattr(found, key), 4).tolist() for key in ("explained", "importance")}
    moved = influence(model, out / "examples", wave)
    return row | {"own_share": disentanglement.own_share(moved), "influence": np.round(moved, 4).tolist()}


def influence(model: Model, folder: Path, wave: np.ndarray) -> np.ndarray:
    """[P, P]: how much part q turns when slice p is exchanged, against the exchange of all; mean over EXCHANGED."""
    spectrum, of = g.read_speech(wave, model), parts_encoder.of_joints(model.skeleton)
    cuts = parts_encoder.slices(replace(model.config.style, parts=of))
    entries = {}
    for k, (name, factors) in enumerate(styles.STYLES.items()):
        clip = truth.example(folder, name, factors, trials.EXAMPLE_SECONDS, truth.EXAMPLE_SEED + k)
        if any(name in pair for pair in EXCHANGED):
            entries[name] = style_clip.read_clip(clip, model)
    moved = []
    for pair in EXCHANGED:
        before, after = (np.asarray(entries[name].distribution.mean) for name in pair)

        def made(style: np.ndarray, start=entries[pair[0]].start) -> np.ndarray:
            return np.asarray(g.synthesize(model, spectrum, style_space.hold(style, len(spectrum)), start).joint_axes)

        own, whole = made(before), turned(made(before), made(after), of)
        for start, stop in cuts.values():
            one = before.copy()
            one[start:stop] = after[start:stop]
            moved.append(turned(own, made(one), of) / whole)
    return np.mean(np.reshape(moved, (len(EXCHANGED), len(cuts), len(cuts))), axis=0)


def turned(a: np.ndarray, b: np.ndarray, of: tuple[str, ...]) -> np.ndarray:
    """Mean angle, rad, between the joints' rotations [T, J, 2, 3] of two motions, for each part of the body."""
    matrices = [np.asarray(rotation.axes_to_matrix(jnp.asarray(axes))) for axes in (a, b)]
    cosine = (np.einsum("tjab,tjab->tj", *matrices) - 1.0) / 2.0
    angle = np.arccos(np.clip(cosine, -1.0, 1.0)).mean(0)
    present = [part for part in parts_encoder.PARTS if part in of]
    return np.array([angle[[part == name for name in of]].mean() for part in present])


def report(rows: list[ledger.Row], spaces: list[ledger.Row], out: Path, body: Skeleton) -> None:
    """The tables: the trainings, their spaces, and of the encoder of parts what each slice tells and moves."""
    print(ledger.by_seeds("style encoder", rows, COLUMNS))
    print("\n" + ledger.by_seeds("style encoder", spaces, SPACE))
    for row in spaces:
        if row["name"] == "parts":
            print(f"\nparts, seed {row['seed']}\n" + by_slice(row, parts_encoder.of_joints(body)))
    ledger.save(out / "results.json", {"trials": rows, "spaces": spaces})


def by_slice(row: ledger.Row, of: tuple[str, ...]) -> str:
    """Where the weight of each factor lies with what is explained of it, and how much of each part a slice turns."""
    cuts = parts_encoder.slices(replace(trials.SMALL.model.style, parts=of))
    weight = np.array([np.array(row["anywhere_importance"])[start:stop].sum(0) for start, stop in cuts.values()])
    shares = (weight / np.maximum(weight.sum(0), 1e-9)).T
    told = [
        [name, *(f"{x:.0%}" for x in share), f"{explained:.2f}"]
        for name, share, explained in zip(truth.NAMES, shares, row["anywhere_explained"], strict=True)
    ]
    moved = [[part, *(f"{x:.0%}" for x in moves)] for part, moves in zip(cuts, row["influence"], strict=True)]
    return ledger.table(["factor", *cuts, "told"], told) + "\n\n" + ledger.table(["slice exchanged", *cuts], moved)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("corpus", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--only", nargs="+", choices=KINDS, default=KINDS, help="do no more than these")
    parser.add_argument("--seeds", type=int, nargs="+", default=trials.SEEDS)
    parser.add_argument("--steps", type=int, default=trials.SMALL.steps)
    parser.add_argument("--clips", type=int, default=CLIPS, help="of each kind, for the scores of the embedding")
    parser.add_argument("--ruler-clips", type=int, default=truth.RULER_CLIPS)
    args = parser.parse_args()
    data = trials.arrays(args.corpus, args.out / "prepared")
    ruler, waves = truth.ruler(args.out, args.ruler_clips), recordings.of_corpus(args.corpus, "valid", 2)
    runs = {kind: (replace(config, steps=args.steps), data) for kind, config in variants().items() if kind in args.only}
    jobs = trials.jobs(runs, tuple(args.seeds), args.out, ruler, waves)
    rows = ledger.fill(args.out / "trials.jsonl", jobs, "trials")
    wave = next(iter(waves.values()))
    asked: dict[str, Callable[[], ledger.Row]] = {
        row["job"]: partial(space, row["name"], row["seed"], args.out, args.clips, wave) for row in rows
    }
    spaces = ledger.fill(args.out / "spaces.jsonl", asked, "style spaces")
    report(rows, spaces, args.out, prepared.load(data).skeleton)


if __name__ == "__main__":
    main()
