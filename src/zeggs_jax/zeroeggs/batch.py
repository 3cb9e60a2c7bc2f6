"""Many generations from one table: the release's CSV columns, one BVH for each row."""

import csv
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from ..nn.reduced import Precision
from . import examples, steering
from . import generate as g
from .model import Model
from .synthesis import WIDTHS, synthesize_many

COLUMNS = (
    "base_path",
    "audio",
    "style",
    "file_name",
    "temperature",
    "seed",
    "use_gpu",
    "frames",
    "first_pose",
    "generate",
)  # use_gpu is read and ignored: JAX picks the device
MOST_FRAMES = 100_000  # that are held at a time: half a GB of poses of 75 joints


class Job(NamedTuple):
    """One row of the table."""

    speech: Path
    request: g.Request
    file_name: str
    where: str  # "line 3 of table 'x.csv'"


def read_table(path: Path, defaults: g.Request) -> list[Job]:
    """The rows to generate (those whose `generate` is not false), in the table's order.

    Paths are joined to the row's `base_path`, itself taken from the table's folder. `frames` is 'START STOP'.
    A missing cell takes the value of `defaults`; backslashes in paths count as slashes.

    Raises:
        ValueError, OSError: missing table, unknown column, row without audio, malformed number.
    """
    if not path.is_file():
        raise FileNotFoundError(f"table '{path}' does not exist; give a .csv with the columns {', '.join(COLUMNS)}.")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            columns = list(reader.fieldnames or ())
            rows = [{k: (v or "").strip() for k, v in row.items() if k} for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(
            f"table '{path.name}' is not comma-separated text in UTF-8; save it as CSV (UTF-8)."
        ) from error
    unknown = [column for column in columns if column not in COLUMNS]
    if unknown or "audio" not in columns:
        wrong = f"column '{unknown[0]}'" if unknown else "no column 'audio'"
        raise ValueError(f"table '{path.name}' has {wrong}; the columns are {', '.join(COLUMNS)}.")
    wanted = [(n, row) for n, row in enumerate(rows, 2) if row.get("generate", "").lower() not in ("0", "false", "no")]
    if not wanted:
        raise ValueError(f"table '{path.name}' has no row to generate.")
    return [_job(row, f"line {n} of table '{path.name}'", path.parent, defaults) for n, row in wanted]


def _job(row: dict[str, str], where: str, folder: Path, defaults: g.Request) -> Job:
    if not row.get("audio"):
        raise ValueError(f"{where} has no audio; give the path of a recording.")
    base = folder / _slashes(row.get("base_path", ""))
    audio = base / _slashes(row["audio"])
    try:
        temperature = float(row.get("temperature") or defaults.temperature)
        seed = int(row.get("seed") or defaults.seed)
        cut = tuple(int(number) for number in row.get("frames", "").split())
    except ValueError as error:
        raise ValueError(f"{where} has a malformed number in temperature, seed or frames.") from error
    if len(cut) not in (0, 2):
        raise ValueError(f"{where} has frames '{row['frames']}'; give 'START STOP'.")
    first = row.get("first_pose")
    request = defaults._replace(
        styles=_style(row.get("style", ""), base, defaults),
        frames=((cut[0], cut[1]),) if cut else defaults.frames,
        first_pose=str(base / _slashes(first)) if first else defaults.first_pose,
        temperature=temperature,
        seed=seed,
    )
    name = row.get("file_name") or f"audio_{audio.stem}_label_{_label(request)}"
    files = [examples.split(style)[0] for style in request.styles if _is_file(style)]
    for file in (audio, *files, *map(Path, filter(None, (request.first_pose,)))):
        if not file.is_file():
            raise FileNotFoundError(f"{where}: file '{file}' does not exist; paths start from base_path.")
    return Job(audio, request, Path(_slashes(name)).name.removesuffix(".bvh"), where)


def _style(cell: str, base: Path, defaults: g.Request) -> tuple[str, ...]:
    if not cell:
        return defaults.styles
    return (str(base / _slashes(cell)) if _is_file(cell) else cell,)


def _is_file(style: str) -> bool:
    return examples.split(style)[0].suffix.lower() in (".bvh", ".npz")


def _label(request: g.Request) -> str:
    """What the name of a file says of its style: the first one, the entry where it is one of a library."""
    path, entry = examples.split(next(iter(steering.named(request)), "mean"))
    return entry or path.stem


def _slashes(text: str) -> str:
    return text.replace("\\", "/")


def generate_all(
    table: Path, out: Path, defaults: g.Request, model: Model, precision: Precision = "float32"
) -> list[Path]:
    """Generates every row into `out`, with a progress bar; the whole table is read before the first.

    The networks run for up to 32 rows at once; a row's motion is the one that `generate` makes, to rounding.

    Notes on a row's style (see `generate.Gesture`) go to stderr.

    Raises:
        ValueError, OSError: whatever `read_table` and `generate` refuse, or two rows of one file name.
    """
    jobs = read_table(table, defaults)
    names = [job.file_name for job in jobs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"table '{table.name}' writes '{twice}.bvh' twice; give each row its own file_name.")
    with tqdm(total=len(jobs), desc="generating", unit="clip") as bar:
        made = []
        for path in _generate(jobs, out, model, precision):
            made.append(path)
            bar.update()
    return made


def _generate(jobs: list[Job], out: Path, model: Model, precision: Precision) -> Iterator[Path]:
    """The files of all rows, some of which run together; also of those before a row that is refused."""
    group: list[tuple[Job, g.Asked]] = []
    for job in jobs:
        try:
            group.append((job, g.prepare(job.speech, job.request, model)))
        except (ValueError, OSError) as error:
            yield from _write(group, out, model, precision)
            if isinstance(error, ValueError):
                raise ValueError(f"{job.where}: {error}") from error
            raise
        if len(group) == WIDTHS[-1] or sum(len(asked.told.spectrum) for _, asked in group) > MOST_FRAMES:
            yield from _write(group, out, model, precision)
            group = []
    yield from _write(group, out, model, precision)


def _write(group: list[tuple[Job, g.Asked]], out: Path, model: Model, precision: Precision) -> Iterator[Path]:
    made = synthesize_many(model, [asked.told for _, asked in group], precision)
    for (job, asked), poses in zip(group, made, strict=True):
        try:
            gesture = g.finish(asked, poses, model, precision)
        except ValueError as error:
            raise ValueError(f"{job.where}: {error}") from error
        for note in gesture.notes:
            tqdm.write(f"zeggs: note: {job.where}: {note}", file=sys.stderr)
        yield g.save(out / f"{job.file_name}.bvh", gesture)
