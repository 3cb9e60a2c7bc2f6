"""The command that judges made clips: evaluate."""

import sys
from pathlib import Path

from tyro.conf import Positional

from .arguments import Out
from .guards import prepare_folder


def evaluate(
    generated: Positional[tuple[str, ...]],
    /,
    *,
    truth: Path,
    out: Out,
    speech: Path | None = None,
    split: str | None = None,
    rate: float | None = None,
    feature_net: Path | None = None,
    players: int = 6,
    unpaired: bool = False,
    title: str = "Evaluation",
    level: float = 0.95,
    draws: int = 500,
    seed: int = 0,
) -> None:
    """Measure generated clips beside the recorded ones; OUT/report.html shows tables, drawings and players.

    A generated clip is matched with the recorded one of the same speech by the provenance that 'zeggs generate' wrote
    beside it, else by its name: NAME.bvh, or NAME__STYLE.bvh, NAME__STYLE__2.bvh where there are several.
    docs/METRICS.md says what every measure is and where it misleads.

    Args:
        generated: Folders of .bvh files, one group each (NAME=FOLDER gives it a name), or single files.
        truth: A folder of recorded clips: name.bvh, with name.wav and a transcript where there are.
        out: The folder to write to.
        speech: The folder of the recordings, where they are not beside the recorded clips.
        split: Judge by the clips of this split of a corpus folder only: train or valid.
        rate: Resample all motion to this many frames per second first.
        feature_net: A feature_net.npz of an earlier report, so that its Frechet gesture distances compare with these.
        players: How many clips the page plays side by side.
        unpaired: Go on where no generated clip goes with a recorded one.
        title: What stands above the page.
        level: How sure the intervals are.
        draws: How often clips are drawn again for the intervals.
        seed: Of the drawing, and of a feature net that is trained here.
    """
    from ..metrics.rows import ReportConfig
    from . import judging

    config = ReportConfig(level, draws, seed)
    if not generated:
        raise ValueError("nothing to evaluate was given; name folders of generated .bvh files.")
    if players < 0:
        raise ValueError(f"--players is {players}; give how many clips the page plays, 0 or more.")
    if seed < 0:
        raise ValueError(f"--seed is {seed}; give 0 or more.")
    if rate is not None and not 0.0 < rate <= judging.FASTEST_HZ:
        raise ValueError(f"--rate is {rate:g}; give frames per second, above 0 and up to {judging.FASTEST_HZ:g}.")
    case = judging.read(generated, truth, speech, split, rate, unpaired)
    given = None if feature_net is None else judging.read_net(feature_net, case)
    prepare_folder(out)
    print(
        f"{len(case.truth)} recorded clips; " + "; ".join(f"{len(g)} of {n}" for n, g in case.made.items()),
        file=sys.stderr,
    )
    if given is None:
        net, told = judging.train_net(case, seed)
    else:
        net, told = given, f"the feature net was read from '{feature_net}'"
    print(told, file=sys.stderr)
    found = judging.measure(case, net, told, config)
    judging.write(out, found, case, net, players, title)
    for row in judging.summary(found):
        print(row)
    print(f"wrote {out / 'report.html'} and {out / 'report.json'}")
