"""What every command checks of the names it was given, before any work is done."""

import os
from pathlib import Path


def stem(style: str) -> str:
    """What a style is called in names of files: of 'lib.npz:NAME' its NAME."""
    _, inside, name = style.partition(".npz:")
    return name.replace("/", "_") if inside else Path(style).stem


def frame_range(text: str) -> tuple[int, int]:
    start, colon, stop = text.partition(":")
    if not (colon and start.strip().isdigit() and stop.strip().isdigit() and int(start) < int(stop)):
        raise ValueError(f"--frames got '{text}'; give START:STOP in frames, such as 30:150.")
    return int(start), int(stop)


def component(text: str) -> tuple[int, float]:
    """A principal component's number and an amount, of a --pca as in 1=+2.0."""
    which, equals, amount = text.partition("=")
    if not (equals and which.strip().isdigit()):
        raise ValueError(f"--pca got '{text}'; give COMPONENT=AMOUNT in standard deviations, such as 1=+2.0.")
    return int(which), number(amount, f"--pca got '{text}'")


def prepare_folder(folder: Path) -> None:
    """Creates the folder and proves that it can be written to, before any work is done."""
    probe = folder / f".zeggs-{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ValueError(f"cannot write to folder '{folder}' ({error.strerror}); name another one.") from error


def keep_inputs(outputs: tuple[Path, ...], inputs: tuple[str, ...]) -> None:
    """Refuses to write over what is read, over a folder, or twice to one place."""
    files = (file + inside.rstrip(":") for file, inside, _ in (name.partition(".npz:") for name in inputs))
    read = {Path(file).resolve() for file in files}
    for k, path in enumerate(outputs):
        if path.resolve() in read or path.resolve() in {other.resolve() for other in outputs[:k]}:
            raise ValueError(f"'{path}' would be written over; give the output another name.")
        if path.is_dir():
            raise ValueError(f"'{path}' is a folder; give the name of a file.")


def number(text: str, told: str) -> float:
    """The number that the text is; else a ValueError that says what was `told`."""
    try:
        return float(text)
    except ValueError as error:
        raise ValueError(f"{told}, but '{text}' is no number.") from error
