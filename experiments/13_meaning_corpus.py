"""Build the corpus where meaning is known: words with gestures of their own, captions, legs of other styles.

    python experiments/13_meaning_corpus.py -o CORPUS --clips 440

GestureDiffuCLIP's joint space of gestures and words (Sec. 5) and its prompts (Sec. 6) are learnt and judged on it. The
same command goes on after a stop. About 0.6 s a clip second on one core. Clips of a held-out style lie in
CORPUS/held_out; valid clips are spoken by voices that no training clip has, a third of them with held-out synonyms.
"""

import argparse
import multiprocessing
import os
from functools import partial
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")

from tqdm import tqdm

from zeggs_jax.synthetic import corpus

SECONDS = (15.0, 25.0)
VALID_SHARE = 0.12


def make(take: corpus.Take, folder: Path) -> corpus.Take:
    """Write one take, if it is not there; its JSON is written last."""
    if not (folder / f"{take.name}.json").is_file():
        corpus.write_take(folder, take, corpus.speak(take))
    return take


def main() -> None:
    """Plan the takes, write them in parallel, write the index."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--clips", type=int, default=440)
    parser.add_argument("--minutes", type=float, help="length of the corpus, instead of --clips")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--random-share", type=float, default=0.4, help="clips of random points between the styles")
    arguments = parser.parse_args()
    clips = arguments.clips
    if arguments.minutes is not None:
        clips = max(1, round(60.0 * arguments.minutes / (0.5 * sum(SECONDS))))
    config = corpus.CorpusConfig(
        clips=clips, seconds=SECONDS, seed=arguments.seed, random_share=arguments.random_share,
        valid_share=VALID_SHARE, meaning=True,
    )  # fmt: skip
    takes = corpus.plan(config)
    with multiprocessing.get_context("spawn").Pool(arguments.processes) as pool:
        for _ in tqdm(pool.imap_unordered(partial(make, folder=arguments.out), takes), total=len(takes), unit="clip"):
            pass
    corpus.write_index(arguments.out, takes)


if __name__ == "__main__":
    main()
