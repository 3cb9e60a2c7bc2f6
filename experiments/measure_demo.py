"""The bundled model measured on real voices: rhythm, style recognition, drift, human ranges, jerk (docs/RESULTS.md).

    python experiments/measure_demo.py VOICE.wav ... [--checkpoint RUN] [--json FILE] [--pages FOLDER]

Rhythm: Pearson correlation of hand speed with speech energy, against the same speech moved in time. Recognition:
nearest centroid of kinematic statistics, centroids made from synthetic truth of seeds that training never saw, with
the truth's own accuracy beside it. Jerk: mean over joints against the truth of the same styles. Ranges: frames with a
joint outside the human ranges of `synthetic/ranges.py`. Drift: largest distance of the hips from their start in 60 s.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import truth
from zeggs_jax.metrics import kinematic, recognition, rhythm
from zeggs_jax.motion import bvh
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import wav
from zeggs_jax.stage import player
from zeggs_jax.synthetic import ranges
from zeggs_jax.zeroeggs import examples
from zeggs_jax.zeroeggs import generate as g

TRUTH_SEEDS = range(900_000, 900_006)  # training corpora use seeds far below
TRUTH_SECONDS = 15.0


def own_accuracy(statistics: dict[str, np.ndarray]) -> float:
    """Share of truth clips that are recognised by centroids made without them."""
    styles = list(statistics)
    hits = []
    for style in styles:
        for k in range(len(statistics[style])):
            kept = {s: np.delete(v, k, axis=0) if s == style else v for s, v in statistics.items()}
            labels = [s for s in styles for _ in kept[s]]
            centroids = recognition.fit(np.concatenate([kept[s] for s in styles]), labels)
            hits.append(recognition.nearest(centroids, statistics[style][k]) == style)
    return float(np.mean(hits))


def measure(clip: bvh.Clip, speech: Path, centroids: recognition.Centroids) -> dict[str, Any]:
    """All measures of one generated clip."""
    rate = bvh.rate_hz(clip.frame_time)
    wave = wav.read(speech)
    energy = speech_features.frame_energy(wave, len(clip.euler), rate)
    agreement = rhythm.agreement(kinematic.hand_speed(clip), np.asarray(energy, np.float64), rate)
    return {
        "matched": agreement.matched,
        "shifted": agreement.shifted,
        "share_below": agreement.share_below,
        "recognised": recognition.nearest(centroids, kinematic.style_statistics(clip)),
        "outside_range": ranges.share_outside_range(clip),
        "jerk": kinematic.mean_jerk(clip),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("voices", type=Path, nargs="+")
    parser.add_argument("--checkpoint", type=Path, help="a model of your own; the bundled one when left out")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--pages", type=Path, help="write one page per voice to this folder")
    args = parser.parse_args()
    model = g.load_model(args.checkpoint) if args.checkpoint else g.bundled_model()
    styles = list(examples.bundled())
    real = truth.clips(styles, TRUTH_SEEDS, TRUTH_SECONDS)
    statistics = {s: np.stack([kinematic.style_statistics(c) for c in clips]) for s, clips in real.items()}
    labels = [s for s in styles for _ in statistics[s]]
    centroids = recognition.fit(np.concatenate(list(statistics.values())), labels)
    jerk = {s: float(np.mean([kinematic.mean_jerk(c) for c in clips])) for s, clips in real.items()}

    rows = []
    for voice in tqdm(args.voices, desc="voices", unit="voice"):
        figures = []
        for style in styles:
            clip = g.generate(voice, style, model=model).clip
            rows.append({"voice": voice.stem, "style": style, **measure(clip, voice, centroids)})
            figures.append(player.Figure(style, clip, voice))
        if args.pages:
            args.pages.mkdir(parents=True, exist_ok=True)
            player.write(args.pages / f"{voice.stem}.html", figures, title=voice.stem)
    drift = {style: minute_drift(args.voices, style, model) for style in tqdm(styles, desc="60 s", unit="style")}
    report(rows, jerk, drift, own_accuracy(statistics), args.json)


def minute_drift(voices: list[Path], style: str, model: g.Model) -> float:
    """Drift over a minute of speech made of the voices in turn."""
    once = np.concatenate([wav.read(voice) for voice in voices])
    minute = np.tile(once, 1 + 60 * 16000 // len(once))[: 60 * 16000]
    return kinematic.root_drift(g.generate(minute, style, model=model).clip)


def report(
    rows: list[dict], jerk: dict[str, float], drift: dict[str, float], accuracy: float, path: Path | None
) -> None:
    """Prints the table by style and the figures over all, and writes them."""
    print(
        f"{'style':10s} {'matched':>8s} {'shifted':>8s} {'recognised':>10s} "
        f"{'jerk/truth':>10s} {'drift cm':>8s} {'outside':>8s}"
    )
    for style in drift:
        of = [row for row in rows if row["style"] == style]
        mean = {
            key: float(np.mean([row[key] for row in of])) for key in ("matched", "shifted", "jerk", "outside_range")
        }
        known = float(np.mean([row["recognised"] == style for row in of]))
        print(
            f"{style:10s} {mean['matched']:8.3f} {mean['shifted']:8.3f} {known:10.0%} "
            f"{mean['jerk'] / jerk[style]:10.2f} {drift[style]:8.1f} {mean['outside_range']:8.2%}"
        )
    over_all = {
        "matched": float(np.mean([row["matched"] for row in rows])),
        "shifted": float(np.mean([row["shifted"] for row in rows])),
        "share_of_shifts_below": float(np.mean([row["share_below"] for row in rows])),
        "recognised": float(np.mean([row["recognised"] == row["style"] for row in rows])),
        "truth_recognised": accuracy,
        "jerk_over_truth": float(np.mean([row["jerk"] / jerk[row["style"]] for row in rows])),
        "largest_drift_cm": max(drift.values()),
        "outside_range": float(np.mean([row["outside_range"] for row in rows])),
    }
    print(json.dumps({key: round(value, 4) for key, value in over_all.items()}, indent=1))
    if path:
        path.write_text(json.dumps({"over_all": over_all, "drift": drift, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
