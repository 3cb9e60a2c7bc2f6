"""Put a trained GestureDiffuCLIP into the package: half-precision checkpoint, and speech with timed words.

    python experiments/bundle_diffuclip.py runs/diffuclip

The speech is our own: a text of the corpus's kind by its synthetic voice (held-out seed), and a text written for it,
said by espeak-ng where that is installed (Debian: espeak-ng). A model that is too large replaces nothing.
"""

import argparse
import json
import shutil
import tempfile
from pathlib import Path

import numpy as np

import espeak
from zeggs_jax.diffuclip.checkpoints import load_model, save_model
from zeggs_jax.diffuclip.generate import BUNDLE
from zeggs_jax.speech import wav
from zeggs_jax.synthetic import lexicon, recording

LARGEST_MB = 12.0
SEED, SECONDS = 700_002, 11.0
TEXT = (
    "Good morning, and welcome! I brought you a huge box today. Inside it lies a tiny round stone. "
    "Look up, it came from far away. No, stop, do not touch it! There are many more of them. "
    "Yes, that one is for you, and this one is for me."
)


def megabytes(folder: Path) -> float:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def bundle_model(run: Path) -> None:
    """The run's model in half precision, whole or not at all."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "model"
        told = save_model(made, load_model(run), dtype="float16")
        if (size := megabytes(made)) > LARGEST_MB:
            raise SystemExit(f"'{run}' takes {size:.1f} MB; at most {LARGEST_MB:g} are bundled: train a smaller model.")
        shutil.rmtree(BUNDLE / "model", ignore_errors=True)
        BUNDLE.mkdir(parents=True, exist_ok=True)
        shutil.copytree(made, BUNDLE / "model")
        print(f"model: {size:.1f} MB, digest {told}")


def write_speech(name: str, wave: np.ndarray, words: list[tuple[str, float, float]], text: str) -> None:
    """name.wav and name.json of the bundle."""
    folder = BUNDLE / "speech"
    folder.mkdir(parents=True, exist_ok=True)
    wav.write(folder / f"{name}.wav", 0.7 * wave / np.abs(wave).max())
    rows = [{"text": word, "start": round(start, 3), "end": round(end, 3)} for word, start, end in words]
    (folder / f"{name}.json").write_text(json.dumps({"text": text, "words": rows}, indent=1) + "\n")
    print(f"speech '{name}': {len(wave) / wav.RATE_HZ:.1f} s, {len(rows)} words")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, nargs="?", help="the folder of the training run; only speech when left out")
    args = parser.parse_args()
    if args.run is not None:
        bundle_model(args.run)
    said = lexicon.monologue(SEED, round(recording.WORDS_PER_SECOND * SECONDS))
    spoken = recording.speak(SECONDS, SEED, said)
    words = [(word.text, word.start, word.end) for word in spoken.words]
    write_speech("synthetic", recording.room(spoken.wave, SEED), words, said)
    if espeak.installed():
        write_speech("spoken", *espeak.speak(TEXT, "en-us+f3", 140), TEXT)


if __name__ == "__main__":
    main()
