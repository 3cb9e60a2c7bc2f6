"""The coming batches, made by one thread while the step runs; how long the step waited for them is counted."""

import queue
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

DEPTH = 2  # batches that lie ready; one more is in the making


class Feed:
    """Batches start, start + 1, ... stop - 1, in this order, each made once by `make(k)`; for one `with` block.

    What `make` raises is raised by `take` of that batch, unchanged. Leaving the block ends the thread after the batch
    that it is making.
    """

    def __init__(self, make: Callable[[int], Any], start: int, stop: int, depth: int = DEPTH) -> None:
        self.waited = 0.0  # s, in `take`
        self._make, self._numbers = make, range(start, stop)
        self._ready: queue.Queue[tuple[int, Any, BaseException | None]] = queue.Queue(max(depth, 1))
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="batches", daemon=True)

    def __enter__(self) -> "Feed":
        self._thread.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._closed.set()
        while not self._ready.empty():  # makes room for the batch that the thread may be waiting to put
            self._ready.get_nowait()
        self._thread.join()

    def take(self, k: int) -> Any:
        """Batch k; they are to be taken in order."""
        began = time.perf_counter()
        number, batch, error = self._ready.get()
        self.waited += time.perf_counter() - began
        if error is not None:
            raise error
        if number != k:
            raise RuntimeError(f"batch {k} was asked for, batch {number} is next.")
        return batch

    def _run(self) -> None:
        for k in self._numbers:
            try:
                made = (k, self._make(k), None)
            except BaseException as error:
                made = (k, None, error)
            if self._closed.is_set():
                return
            self._ready.put(made)
            if self._closed.is_set() or made[2] is not None:
                return
