"""Our numbers against the PyTorch release's, stage by stage: one row per quantity, exit status 1 on any failure.

    python experiments/reference_parity.py --golden DIR [--reference DIR] [--json FILE] [--only STAGE ...]

GOLDEN is a set of recorded vectors (tests/golden is a small one). REFERENCE holds the release's statistics and
speech-encoder weights, v1 and v2; the rows that need them are left out without it. What is allowed comes from the
set's own `suggested_atol`. Whatever is not compared is named on stderr and in FILE; stdout ends with the two counts.
"""

import argparse
import importlib
import json
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import jax

from parity import left_out
from parity.golden import Row

STAGES = (
    "rotations",
    "bvh",
    "audio",
    "speech_encoder",
    "style_encoder",
    "decoder",
    "losses",
    "train",
    "dataset",
    "convert",
    "generate",
)


def rows(golden: Path, reference: Path | None, stages: tuple[str, ...]) -> Iterator[Row]:
    """The rows of every stage that the set has a folder for; a stage that breaks gives a failed row."""
    for stage in stages:
        if not (golden / stage).is_dir():
            left_out.leave_out(stage, "all", "no folder in this set")
            continue
        try:
            left_out.absent_files(golden, stage)
            yield from importlib.import_module(f"parity.{stage}").check(golden, reference)
        except Exception as error:  # one broken stage must not hide the others
            traceback.print_exc()
            yield Row(stage, f"stopped by {type(error).__name__}: {error}", float("inf"), 0.0)


def not_compared(golden: Path, stages: tuple[str, ...]) -> list[left_out.LeftOut]:
    """What the stages left out, the stages that were not asked for, and folders that are none of ours."""
    for stage in STAGES:
        if stage not in stages:
            left_out.leave_out(stage, "all", "not asked for")
    left_out.other_stages(golden, STAGES)
    return left_out.take()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--golden", type=Path, required=True, help="folder of golden vectors")
    parser.add_argument("--reference", type=Path, help="folder of the release's v1 and v2 files")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    parser.add_argument("--only", nargs="+", choices=STAGES, default=STAGES, metavar="STAGE", help="stages to run")
    args = parser.parse_args()
    for folder in filter(None, (args.golden, args.reference)):
        if not folder.is_dir():
            parser.error(f"'{folder}' is not a folder")
    jax.config.update("jax_default_matmul_precision", "highest")
    done = []
    for row in rows(args.golden, args.reference, tuple(args.only)):
        done.append(row)
        verdict = "ok" if row.passed else "FAILED"
        print(f"{row.stage:16s} {row.name:58s} {row.error:10.3g} {row.allowed:10.3g}  {verdict}", flush=True)
    passed = sum(row.passed for row in done)
    missed = not_compared(args.golden, tuple(args.only))
    if args.json:
        table = [{**row._asdict(), "passed": row.passed} for row in done]
        report = {"rows": table, "left_out": [entry._asdict() for entry in missed]}
        args.json.write_text(json.dumps(report, indent=1, default=float) + "\n")
    names = "; ".join(f"{entry.stage}/{entry.name} ({entry.why})" for entry in missed) or "nothing"
    print(f"{len(missed)} left out: {names}", file=sys.stderr, flush=True)
    print(f"{passed} passed, {len(done) - passed} failed")
    sys.exit(0 if done and passed == len(done) else 1)


if __name__ == "__main__":
    main()
