"""Put a trained demo model into the package: half-precision checkpoint, style clips, spoken samples, style library.

    python experiments/bundle_demo.py runs/demo --corpus corpus

Style clips and the first sample are the package's own synthetic voice and body; the second sample is made with
espeak-ng where it is installed (Debian: espeak-ng), from a text of our own. The library holds all clips of the corpus
that the model was trained on, without first poses, and the style clips with theirs.
"""

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

from zeggs_jax.motion import bvh
from zeggs_jax.speech import wav
from zeggs_jax.synthetic import corpus, recording
from zeggs_jax.synthetic.styles import STYLES
from zeggs_jax.zeroeggs import library, style_clip
from zeggs_jax.zeroeggs.checkpoints import load_model, save_model
from zeggs_jax.zeroeggs.generate import BUNDLE
from zeggs_jax.zeroeggs.library import Library
from zeggs_jax.zeroeggs.model import Model

STYLE_SECONDS, STYLE_SEED = 6.0, 700_000
SAMPLE_SECONDS, SAMPLE_SEED = 12.0, 700_001
TEXT = (
    "Good morning, and welcome! Today I want to show you something small. You speak, and a body moves with you. "
    "It lifts its hands on the strong words, and it rests when you rest."
)


def say(text: str, path: Path) -> None:
    """One espeak-ng recording, 16 kHz, at most SAMPLE_SECONDS long."""
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "raw.wav"
        subprocess.run(["espeak-ng", "-v", "en-gb+f2", "-s", "150", "-w", str(raw), text], check=True)
        wav.write(path, wav.read(raw)[: round(SAMPLE_SECONDS * wav.RATE_HZ)])


def write_library(path: Path, folder: Path, model: Model) -> None:
    """The corpus's clips and the bundled styles under the model, as the package reads them."""
    clips = library.embed_corpus(folder, model)
    styles = (style_clip.read_clip(BUNDLE / "styles" / f"{name}.bvh", model)._replace(source=name) for name in STYLES)
    startless = (entry._replace(start=None) for entry in clips.entries)
    library.save(path, Library(clips.model, (*styles, *startless)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="the folder of the training run")
    parser.add_argument("--corpus", type=Path, required=True, help="the corpus that it was trained on")
    args = parser.parse_args()
    shutil.rmtree(BUNDLE / "model", ignore_errors=True)
    print("model", save_model(BUNDLE / "model", load_model(args.run), dtype="float16"))
    for folder in ("styles", "speech"):
        shutil.rmtree(BUNDLE / folder, ignore_errors=True)
        (BUNDLE / folder).mkdir(parents=True)
    for style in STYLES:
        bvh.write(BUNDLE / "styles" / f"{style}.bvh", corpus.style_clip(style, STYLE_SECONDS, 30, STYLE_SEED))
    if shutil.which("espeak-ng"):
        say(TEXT, BUNDLE / "speech" / "spoken.wav")
    sample = recording.speak(SAMPLE_SECONDS, SAMPLE_SEED).wave[: round(SAMPLE_SECONDS * wav.RATE_HZ)]
    wav.write(BUNDLE / "speech" / "synthetic.wav", sample)
    write_library(library.BUNDLED, args.corpus, load_model(BUNDLE / "model"))


if __name__ == "__main__":
    main()
