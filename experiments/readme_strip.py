"""The strip of poses on the README's first screen: one speech in four styles, made by the bundled model.

python experiments/readme_strip.py docs/strip.svg
"""

import sys

from zeggs_jax.stage import figures
from zeggs_jax.zeroeggs import generate as g

STYLES = ("neutral", "happy", "old", "oration")
TIMES = (1.5, 3.0, 4.5, 6.0, 7.5)


def main() -> None:
    model, speech = g.bundled_model(), next(iter(g.bundled_speech().values()))
    clips = [g.generate(speech, style, model=model).clip for style in STYLES]
    figures.pose_strip(sys.argv[1], clips, labels=STYLES, times=TIMES)


if __name__ == "__main__":
    main()
