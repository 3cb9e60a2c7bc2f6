"""A corpus folder -> arrays for training on disk, their statistics, a manifest of how they were made.

Every clip becomes a file under OUT/clips, in as many processes as there are cores; then they are put one behind
the other. What a clip's file was made of is in its name: after a stop, whatever the reason, the same call goes on
where it was, and the result has the same bytes.
"""

import errno
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from zeggs_jax.data import corpus, report, shard, workers
from zeggs_jax.data.body import BodyConfig
from zeggs_jax.data.entry import Problem
from zeggs_jax.data.job import Job, chosen, jobs_of, make
from zeggs_jax.data.job import save_trimmed as save_trimmed
from zeggs_jax.data.join import join
from zeggs_jax.data.prepared import FORMAT, MANIFEST, Prepared, load
from zeggs_jax.data.settings import MENDED, PrepareConfig
from zeggs_jax.data.shard import Body
from zeggs_jax.data.takes import body_of
from zeggs_jax.motion import bvh

CLIPS = "clips"  # the folder of shards; gone when all is done
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
BYTES_PER_WORKER = 16e6  # of motion files; with less, a worker's start of seconds is not worth it


def prepare(
    folder: str | Path, out: str | Path, config: PrepareConfig = MENDED, processes: int | None = None
) -> Prepared:
    """Write the arrays of a corpus folder (see corpus.find) into the folder `out` and load them.

    Neither `processes` (None: the number of cores, fewer for little data) nor earlier calls that were stopped
    change a byte of the result; where it is there already, nothing is done. A script that calls this keeps its
    own work under `if __name__ == "__main__"`, as always with worker processes.

    Raises FileNotFoundError or ValueError where the folder holds no corpus, and, unless config.skip_bad,
    ValueError where a clip does not read, is not finite, is too short, does not fit its speech, or has another
    skeleton or frame rate than the first good one: OUT/report.json lists them all. OSError for a full disk,
    ChildProcessError when a worker dies, KeyboardInterrupt after Ctrl-C, each with a sentence.
    """
    folder, out = Path(folder), Path(out)
    if processes is not None and processes < 1:
        raise ValueError(f"{processes} processes were asked for; give at least 1.")
    if out.resolve() == folder.resolve():
        raise ValueError(f"'{out}' is the corpus itself; name another folder for its arrays.")
    if config.save_trimmed and out.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"'{out}' lies in the corpus, where trimmed clips would be taken for its own; name another.")
    plan = _plan(folder, out, config)
    if _finished(out) != plan.made_of:
        (out / CLIPS).mkdir(parents=True, exist_ok=True)
        (out / MANIFEST).unlink(missing_ok=True)
        with _in_one_sentence(out, plan.jobs):
            good, shared = _make_all(plan, out, processes)
            manifest = {"format": FORMAT, "source": folder.resolve().name, "made_of": plan.made_of}
            manifest |= {"config": asdict(config), "body": asdict(plan.body), **join(good, shared, out, out / CLIPS)}
            partial = out / f"{MANIFEST}.partial"
            partial.write_text(json.dumps(manifest, indent=1) + "\n")
            os.replace(partial, out / MANIFEST)
    _clear(out / CLIPS)
    return load(out)


def _clear(folder: Path) -> None:
    """Remove the shards, and their folder unless something else lies in it."""
    for path in [*folder.glob(f"{shard.NAMES}*"), *folder.glob("look.npy*")]:
        path.unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()


def made_of(folder: str | Path, config: PrepareConfig = MENDED) -> str:
    """A hash of all that the arrays of a corpus are made of: every file in it, styles and splits, the settings."""
    return _plan(folder, Path(), config).made_of


class _Plan(NamedTuple):
    """What is to be done for a corpus."""

    jobs: list[Job]  # one for each pair
    problems: list[Problem]  # files without a partner
    body: BodyConfig  # how all clips are read
    made_of: str


def _plan(folder: str | Path, out: Path, config: PrepareConfig) -> _Plan:
    entries, problems = corpus.survey(folder)
    body = body_of(entries, config.body, config.as_released)
    alike = replace(body, roles=config.body.roles)  # roles go by names: another skeleton shall not fail by them
    jobs = jobs_of(entries, replace(config, body=alike), out, out / CLIPS)
    clips = [[job.entry.name, job.entry.style, job.entry.split, job.path.stem] for job in jobs]
    lost = [problem.name for problem in problems]
    return _Plan(jobs, problems, body, shard.key({"clips": clips, "lost": lost, "config": chosen(config)}))


def _finished(out: Path) -> str | None:
    """The fingerprint of the arrays in a folder, None where they are not complete."""
    try:
        load(out)
        return json.loads((out / MANIFEST).read_text()).get("made_of")
    except (OSError, ValueError):
        return None


def _make_all(plan: _Plan, out: Path, processes: int | None) -> tuple[list[Job], Body]:
    """Shards of all clips that can be used, and what they share; the others are reported."""
    jobs, problems = plan.jobs, list(plan.problems)
    there = {job.path for job in jobs if job.path.exists()}
    missing = [job for job in jobs if job.path not in there]
    made = workers.each(make, missing, processes or _processes(missing))
    good: list[tuple[Job, Body]] = []  # the first one's body only is kept
    for job in tqdm(jobs, desc="preparing", unit="clip", disable=None):
        outcome = _there(job) if job.path in there else next(made)
        if isinstance(outcome, Body) and good:
            outcome = _unlike(good[0], job, outcome) or good[0][1]
        if isinstance(outcome, Body):
            good.append((job, outcome))
        else:
            problems.append(outcome)
    report.settle(out, len(good), problems, jobs[0].config.skip_bad)
    return [job for job, _ in good], good[0][1]


def _processes(jobs: list[Job]) -> int:
    """As many as there are cores, if there is enough to do for them."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    size = sum(job.entry.bvh.stat().st_size for job in jobs if job.entry.bvh.exists())
    return max(1, min(cores, int(size / BYTES_PER_WORKER)))


def _there(job: Job) -> Body | Problem:
    """What an earlier call made of a clip; made again where the file is damaged."""
    try:
        return shard.read_body(job.path)
    except ValueError:
        return make(job)


def _unlike(first: tuple[Job, Body], job: Job, b: Body) -> Problem | None:
    """All clips of a corpus share one skeleton and one frame rate: those of the first good clip."""
    a, name, file = first[1], first[0].entry.bvh.name, job.entry.bvh
    if bvh.rate_hz(a.frame_time) != bvh.rate_hz(b.frame_time):
        return Problem(
            job.entry.name,
            f"'{file}' has {bvh.rate_hz(b.frame_time):g} frames a second, '{name}' {bvh.rate_hz(a.frame_time):g}; "
            "choose one with --rate.",
        )
    expected, found = (list(zip(x.skeleton.names, x.skeleton.parents, strict=True)) for x in (a, b))
    if expected == found:
        return None
    differ = [one or other for one, other in zip_longest(expected, found) if one != other]
    return Problem(
        job.entry.name,
        f"'{file}' has {len(found)} joints, '{name}' {len(expected)}, and one skeleton was expected; first "
        f"different joint: '{differ[0][0]}'; prepare each skeleton by itself.",
    )


@contextmanager
def _in_one_sentence(out: Path, jobs: list[Job]) -> Iterator[None]:
    """What may stop the work from outside, said with how far it came."""

    def how_far() -> str:
        made = sum(job.path.exists() for job in jobs)
        return f"{made} of {len(jobs)} clips are made, and the same command goes on from there"

    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"stopped: {how_far()}") from None
    except ChildProcessError as error:
        raise ChildProcessError(f"{error}: {how_far()}; give fewer --processes if memory is short.") from None
    except MemoryError:
        raise OSError(f"The memory is full: {how_far()}; give fewer --processes.") from None
    except OSError as error:
        if error.errno not in FULL:
            raise
        raise OSError(f"The disk of '{out}' is full: free some space; {how_far()}.") from None
