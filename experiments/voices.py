"""Speeches to generate from, cut to one length: clips of a corpus's split, and recordings of people."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from zeggs_jax.speech import wav

SECONDS = 15.0


def of_corpus(folder: Path, split: str, count: int) -> dict[str, np.ndarray]:
    """Up to `count` speeches of a split, spread over the corpus, by name."""
    with (folder / "corpus.csv").open(newline="") as file:
        names = [row["name"] for row in csv.DictReader(file) if row["split"] == split]
    if not names:
        raise ValueError(
            f"corpus '{folder}' has no clip of the split '{split}'; make a longer one with make_corpus.py."
        )
    chosen = names[:: max(len(names) // count, 1)][:count]
    return {name: cut(wav.read(folder / f"{name}.wav")) for name in chosen}


def of_people(paths: Sequence[Path]) -> dict[str, np.ndarray]:
    """Recordings of people, as 'real NAME'."""
    return {f"real {path.stem}": cut(wav.read(path)) for path in paths}


def cut(wave: np.ndarray) -> np.ndarray:
    """The first SECONDS of samples at 16 kHz; short recordings are said again."""
    samples = round(SECONDS * wav.RATE_HZ)
    return np.resize(wave, samples) if len(wave) < samples else wave[:samples]
