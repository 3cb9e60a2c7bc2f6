"""Worker processes: a function over many jobs at once, results in the order of the jobs."""

import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

import jax

Job = TypeVar("Job")
Result = TypeVar("Result")


def each(function: Callable[[Job], Result], jobs: Sequence[Job], processes: int) -> Iterator[Result]:
    """function(job) for every job, in `processes` new processes, or in this one where that is 1.

    Work runs ahead of what is taken. When the caller stops taking, jobs that have begun are finished and no
    others begin. What the function raises is raised here; ChildProcessError when a process dies. Ctrl-C stops
    this process only, and its workers end with it, however it ends.
    """
    if processes <= 1 or len(jobs) <= 1:
        for job in jobs:
            with jax.default_device(jax.local_devices(backend="cpu")[0]):
                result = function(job)
            yield result
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(processes, len(jobs)), context, initializer=_begin)
    done = 0
    try:
        with _interrupts_held():  # workers inherit it
            waiting = [pool.submit(function, job) for job in jobs]
        waiting.reverse()
        while waiting:
            yield waiting.pop().result()
            done += 1
    except BrokenProcessPool:
        raise ChildProcessError(
            f"a worker process died (out of memory?) at job {done + 1} of {len(jobs)} or one of the next {processes}"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """A worker computes on the CPU, and does not outlive the process that started it."""
    jax.config.update("jax_platforms", "cpu")
    threading.Thread(target=_follow, args=(multiprocessing.parent_process(),), daemon=True).start()


def _follow(parent: Any) -> None:
    parent.join()
    signal.raise_signal(signal.SIGTERM)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Ctrl-C waits until the block is left, and never reaches processes that are started in it."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
