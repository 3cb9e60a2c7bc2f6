"""Where a stream's speech comes from: raw PCM from a pipe, a microphone, a page's socket, or a recording."""

import io
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

Form = Literal["s16", "f32"]
BYTES = 1 << 15  # read from a pipe at once
BLOCK_S = 0.02  # of a microphone
SILENT_S = 0.25  # without sound for so long, a live stream is told silence


class Ear:
    """Samples that another thread puts and the stream takes; a full ear makes the thread wait."""

    def __init__(self, rate_hz: float | int, room: int = 0):
        self.rate_hz = rate_hz
        self._queue: queue.Queue = queue.Queue(room)

    def put(self, samples: np.ndarray, rate_hz: float | int | None = None) -> None:
        self._queue.put((samples, rate_hz or self.rate_hz))

    def end(self, error: Exception | None = None) -> None:
        """No more will come; an error is raised where the samples are taken."""
        self._queue.put(error)

    def take(self, wait_s: float | int) -> list[tuple[np.ndarray, float | int]] | None:
        """What has come since, each with its rate; nothing after `wait_s`; None when all has been taken."""
        found = []
        try:
            item = self._queue.get(timeout=wait_s)
            while True:
                if not isinstance(item, tuple):
                    self._queue.put(item)  # also told the next time
                    if not found and item is not None:
                        raise item
                    return found or None
                found.append(item)
                item = self._queue.get_nowait()
        except queue.Empty:
            return found


def listen(ear: Ear, samples: Iterator[np.ndarray]) -> None:
    """Puts samples into the ear, in a thread of its own."""

    def run() -> None:
        error = None
        try:
            for piece in samples:
                ear.put(piece)
        except Exception as raised:
            error = raised
        ear.end(error)

    threading.Thread(target=run, daemon=True).start()


def pcm(pipe: io.BufferedIOBase | io.RawIOBase, form: Form, channels: int) -> Iterator[np.ndarray]:
    """Little-endian samples of a pipe as they come, channels averaged; ValueError for one that ends within a sample."""
    dtype = {"s16": np.dtype("<i2"), "f32": np.dtype("<f4")}[form]
    width, rest = dtype.itemsize * channels, b""
    read: Callable[[int], bytes] = getattr(pipe, "read1", pipe.read)
    while data := read(BYTES):
        rest += data
        whole = len(rest) - len(rest) % width
        if whole:
            yield mixed(np.frombuffer(rest[:whole], dtype).reshape(-1, channels))
            rest = rest[whole:]
    if rest:
        raise ValueError(
            f"the samples end {len(rest)} bytes into one of {width} (--form {form}, --channels {channels}); "
            "tell how they are written."
        )


def mixed(samples: np.ndarray) -> np.ndarray:
    """[n, channels] -> [n]; int16 of one channel stays as it is."""
    if samples.shape[1] == 1:
        return samples[:, 0]
    full = 32768.0 if samples.dtype == np.int16 else 1.0
    return samples.mean(axis=1, dtype=np.float32) / np.float32(full)


def played(path: Path, rate_hz: int) -> Iterator[np.ndarray]:
    """A recording in the time that it takes to hear it."""
    from ..zeroeggs import generate as g

    wave, step, start = g.wav.read(path, rate_hz), round(0.02 * rate_hz), time.monotonic()
    for at in range(0, len(wave), step):
        time.sleep(max(start + at / rate_hz - time.monotonic(), 0.0))
        yield wave[at : at + step]


def microphone(ear: Ear, device: str, note: Callable[[str], None]) -> Any:
    """Starts to hear a microphone, the default one without a name; the caller keeps what is given back.

    Raises:
        ValueError: the package sounddevice is missing, or there is no such microphone.
    """
    try:
        import sounddevice
    except (ImportError, OSError) as error:  # OSError: the library PortAudio is missing
        raise ValueError(
            f"a microphone needs the extra 'live' and PortAudio ({' '.join(str(error).split())}); pip install "
            "'zeggs-jax[live]', or pipe the sound in."
        ) from error

    def heard(samples: Any, frames: int, moment: Any, status: Any) -> None:
        if status:
            note(f"the microphone lost samples ({status}).")
        ear.put(np.frombuffer(samples, np.int16).copy())

    try:
        stream = sounddevice.RawInputStream(
            samplerate=ear.rate_hz,
            blocksize=round(BLOCK_S * ear.rate_hz),
            device=(int(device) if device.isdigit() else device) or None,
            channels=1,
            dtype="int16",
            callback=heard,
            finished_callback=lambda: ear.end(OSError("the microphone has gone; plug it in and begin again.")),
        )
        stream.start()
    except (sounddevice.PortAudioError, ValueError) as error:
        raise ValueError(
            f"no microphone {device!r} can be heard ({' '.join(str(error).split())}); name one of "
            "'python -m sounddevice', or pipe the sound in."
        ) from error
    return stream


def stdin() -> io.RawIOBase:
    """Standard input as bytes; a ValueError where somebody would have to type them.

    Unbuffered: a thread that waits within a buffer holds its lock, and Python aborts when it ends then (Ctrl-C).
    """
    if sys.stdin is None or sys.stdin.isatty():
        raise ValueError("no samples are piped in; pipe raw PCM, or give 'microphone', 'socket' or a recording.")
    return io.FileIO(sys.stdin.fileno(), closefd=False)
