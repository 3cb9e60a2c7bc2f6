"""What preparing costs as a corpus grows: time, processor time and peak memory at 0.2, 2 and 20 hours.

    python experiments/bench_prepare.py SCRATCH [--corpus FOLDER] [--hours 0.2 2 20] [--processes 2] [--json FILE]

Clips come from FOLDER (or are made: 0.2 hours of synthetic corpus). A longer corpus repeats them under new names, by
hard links: it is as large, and each copy is read and prepared anew, but its clips are not all distinct. Memory is what
the kernel says was in use at the most: of the main process, and of the largest worker. Arrays are deleted afterwards.
"""

import argparse
import csv
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

COLUMNS = ("name", "style", "split")


def one(corpus: Path, out: Path, processes: int) -> dict[str, float]:
    """Prepare a corpus in this process, which must be fresh, and say what it took."""
    from zeggs_jax.data.prepare import prepare

    start = time.perf_counter()
    made = prepare(corpus, out, processes=processes)
    seconds = time.perf_counter() - start
    own, workers = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    peak = next(line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line)
    return {
        "hours": len(made.pose) * made.frame_time / 3600.0,
        "clips": len(made.names),
        "seconds": seconds,
        "processor_seconds": own.ru_utime + own.ru_stime + workers.ru_utime + workers.ru_stime,
        "main_processor_seconds": own.ru_utime + own.ru_stime,
        "main_mb": int(peak) / 1024.0,
        "worker_mb": workers.ru_maxrss / 1024.0,
        "arrays_gb": sum(path.stat().st_size for path in out.glob("*.npy")) / 1e9,
    }


def repeat(base: Path, hours: float, out: Path) -> Path:
    """A corpus of at least so many hours, of the clips of `base` under as many names as it takes."""
    import soundfile

    with (base / "corpus.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    out.mkdir(parents=True)
    lines, length, copy = [], 0.0, 0
    while length < hours * 3600.0:
        for row in rows:
            name = f"{row['name']}_{copy}"
            for suffix in (".bvh", ".wav"):
                os.link(base / f"{row['name']}{suffix}", out / f"{name}{suffix}")
            lines.append((name, row["style"], row["split"]))
            length += soundfile.info(base / f"{row['name']}.wav").duration
            if length >= hours * 3600.0:
                break
        copy += 1
    with (out / "corpus.csv").open("w", newline="") as file:
        csv.writer(file).writerows([COLUMNS, *lines])
    return out


def base_corpus(scratch: Path) -> Path:
    """0.2 hours of distinct synthetic clips."""
    folder = scratch / "base"
    if not (folder / "corpus.csv").exists():
        script = Path(__file__).with_name("make_corpus.py")
        subprocess.run([sys.executable, script, folder, "--minutes", "12"], check=True)
    return folder


def row(found: dict[str, float], cores: int) -> str:
    """A line of the table."""
    share = found["processor_seconds"] / found["seconds"] / cores
    return (
        f"| {found['hours']:.1f} | {found['clips']:.0f} | {found['arrays_gb']:.1f} | {found['seconds']:.0f} | "
        f"{found['processor_seconds']:.0f} | {found['clips'] / found['seconds']:.1f} | {100 * share:.0f} % | "
        f"{found['main_mb']:.0f} | {found['worker_mb']:.0f} |"
    )


def main() -> None:
    """Every size in a process of its own."""
    parser = argparse.ArgumentParser(description="What preparing costs as a corpus grows.")
    parser.add_argument("scratch", type=Path)
    parser.add_argument("--corpus", type=Path, help="clips to repeat; a folder with corpus.csv")
    parser.add_argument("--hours", type=float, nargs="+", default=[0.2, 2.0, 20.0])
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one(given.one, given.scratch, given.processes)))
        return
    base, found = given.corpus or base_corpus(given.scratch), []
    print("| hours | clips | arrays, GB | s | processor s | clips/s | of the cores | main, MB | worker, MB |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for hours in given.hours:
        corpus, arrays = given.scratch / f"corpus_{hours:g}", given.scratch / f"arrays_{hours:g}"
        for folder in (corpus, arrays):
            shutil.rmtree(folder, ignore_errors=True)
        repeat(base, hours, corpus)
        command = [sys.executable, __file__, arrays, "--one", corpus, "--processes", str(given.processes)]
        said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        found.append(json.loads(said.splitlines()[-1]))
        print(row(found[-1], os.cpu_count() or 1), flush=True)
        for folder in (corpus, arrays):
            shutil.rmtree(folder)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
