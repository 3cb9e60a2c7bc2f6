"""Put a trained demo model into the package: half-precision checkpoint, one clip per named style, spoken samples.

    python experiments/bundle_demo.py runs/demo

Style clips and the first sample are the package's own synthetic voice and body; the second sample is made with
espeak-ng where it is installed (Debian: espeak-ng), from a text of our own.
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
from zeggs_jax.zeroeggs.checkpoints import load_model, save_model
from zeggs_jax.zeroeggs.generate import BUNDLE

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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="the folder of the training run")
    parser.add_argument("--out", type=Path, default=BUNDLE)
    args = parser.parse_args()
    shutil.rmtree(args.out / "model", ignore_errors=True)
    print("model", save_model(args.out / "model", load_model(args.run), dtype="float16"))
    for folder in ("styles", "speech"):
        shutil.rmtree(args.out / folder, ignore_errors=True)
        (args.out / folder).mkdir(parents=True)
    for style in STYLES:
        bvh.write(args.out / "styles" / f"{style}.bvh", corpus.style_clip(style, STYLE_SECONDS, 30, STYLE_SEED))
    if shutil.which("espeak-ng"):
        say(TEXT, args.out / "speech" / "spoken.wav")
    sample = recording.speak(SAMPLE_SECONDS, SAMPLE_SEED).wave[: round(SAMPLE_SECONDS * wav.RATE_HZ)]
    wav.write(args.out / "speech" / "synthetic.wav", sample)


if __name__ == "__main__":
    main()
