"""The training loop, for any network: updates by number, records, validation, samples, checkpoints, a clean stop.

Every process of a run goes through the same loop; the first one alone writes, validates and shows.
"""

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import jax
from tqdm import tqdm

from . import devices, guard, keep
from .feed import Feed
from .record import Records
from .step import Step, TrainState


class Plan(NamedTuple):
    """How far to train and how often to do what, in updates; 0 is never."""

    steps: int  # updates in all, those before a resume included
    log_every: int = 10
    checkpoint_every: int = 1000
    keep: int = 3  # newest checkpoints that stay on disk
    keep_every: int = 0  # checkpoints that stay for good
    keep_best: bool = True
    validate_every: int = 0
    sample_every: int = 0
    explode: float | None = None  # stop at a loss this many times the usual one
    title: str = "training"  # of the progress bar


class Task(NamedTuple):
    """What is trained: the update, its batches, how a state is written and how it is looked at."""

    step: Step
    batches: Callable[[int], Any]  # batch k, as `step` takes it; called in a thread
    save: Callable[[Path, TrainState], Any]  # called in every process
    validate: Callable[[TrainState], dict[str, float]] | None = None  # "loss" and more; in the first process alone
    sample: Callable[[Path, TrainState], Any] | None = None  # writes a folder; in the first process alone


@devices.company()
def fit(state: TrainState, task: Task, run: Path, plan: Plan, progress: bool = True) -> TrainState:
    """Train from `state` up to `plan.steps` updates, writing to RUN (record.py, keep.py, samples/step_*).

    Ctrl-C and SIGTERM, in any process, finish the update, save, and end in KeyboardInterrupt. ValueError, naming
    update, batch and term, when a number is no longer finite or the loss explodes (guard.py): nothing is saved then,
    and the last checkpoint is good. OSError when there is no room; what `task.batches` raises, as it is.
    """
    start = int(state.step)
    with (
        Records(run, start, devices.first()) as records,
        Feed(task.batches, start, plan.steps) as feed,
        _bar(start, plan, progress and devices.first()) as bar,
        stop_requested() as stop,
    ):
        clock = _Clock(feed)
        if start:  # what a kill right after the checkpoint left undone
            _validate(state, start, task, run, plan, records)
            _sample(state, start, task, run, plan)
        for k in range(start, plan.steps):
            with clock.update():
                state, values = _update(task.step, state, feed.take(k), k)
            if fault := guard.find_fault(values, records.log, plan.explode):
                raise ValueError(
                    f"training stopped at update {k} (batch {k}): {fault}; {keep.last_good(run)}; lower the learning "
                    "rate, set clip_norm or look at the data."
                )
            if k % plan.log_every == 0 or k + 1 == plan.steps:
                records.update(k, values | clock.read())
                bar.set_postfix(loss=f"{values['loss']:.4f}", refresh=False)
            bar.update()
            stopping = devices.any_process(stop.is_set())
            if stopping or _due(k + 1, plan.checkpoint_every, plan):
                keep.write(keep.numbered(run, k + 1), state, task.save)
                keep.prune(run, plan.keep, plan.keep_every)
            if stopping:
                raise KeyboardInterrupt(f"stopped after {k + 1} updates; resume with the same command")
            _validate(state, k + 1, task, run, plan, records)
            _sample(state, k + 1, task, run, plan)
    return state


def _validate(state: TrainState, done: int, task: Task, run: Path, plan: Plan, records: Records) -> None:
    """Validation after `done` updates, if it is due and not written down; the state is read, never changed."""
    if task.validate is None or not _due(done, plan.validate_every, plan):
        return
    better, values = False, {}
    if devices.first() and not records.validated(done):
        values = task.validate(state)
        better = plan.keep_best and records.is_best(values)
    if devices.any_process(better):
        keep.write(keep.best(run), state, task.save)
    if values:
        records.validation(done, values)  # after the best is saved: a kill in between only repeats


def _sample(state: TrainState, done: int, task: Task, run: Path, plan: Plan) -> None:
    """Samples after `done` updates, if they are due and not there; the state is read, never changed."""
    folder = run / "samples" / f"step_{done:08d}"
    due = task.sample is not None and devices.first() and _due(done, plan.sample_every, plan)
    if task.sample is not None and due and not folder.exists():
        task.sample(folder, state)


class _Clock:
    """Speed of the updates since the last reading, and the share of their time that went on waiting for batches.

    Time spent on records, checkpoints and validation counts for neither.
    """

    def __init__(self, feed: Feed) -> None:
        self.feed, self.updates, self.seconds, self.waited = feed, 0, 0.0, feed.waited

    @contextmanager
    def update(self) -> Iterator[None]:
        began = time.perf_counter()
        yield
        self.updates += 1
        self.seconds += time.perf_counter() - began

    def read(self) -> dict[str, float]:
        told = {"speed": self.updates / self.seconds, "wait": (self.feed.waited - self.waited) / self.seconds}
        self.updates, self.seconds, self.waited = 0, 0.0, self.feed.waited
        return told


def _due(done: int, every: int, plan: Plan) -> bool:
    return every > 0 and (done % every == 0 or done == plan.steps)


def _update(step: Step, state: TrainState, batch: Any, k: int) -> tuple[TrainState, dict[str, float]]:
    """The step and its numbers; a device without room for it is told in one sentence."""
    try:
        state, metrics = step(state, batch)
        return state, {name: float(value) for name, value in jax.device_get(metrics).items()}
    except jax.errors.JaxRuntimeError as error:
        if "RESOURCE_EXHAUSTED" not in str(error):
            raise
        raise ValueError(
            f"update {k} does not fit into the memory of the device ({str(error).splitlines()[0]}); set accumulate to "
            "work through the batch in parts, remat, or a smaller batch."
        ) from error


def _bar(start: int, plan: Plan, progress: bool) -> tqdm:
    """The progress bar: on a terminal at once, in a file one line in 30 s."""
    pause = 0.1 if sys.stderr.isatty() else 30.0
    return tqdm(total=plan.steps, initial=start, disable=not progress, desc=plan.title, unit="step", mininterval=pause)


_awaited: list[threading.Event] = []  # of calls within calls of `stop_requested`: all of them are told


@contextmanager
def stop_requested() -> Iterator[threading.Event]:
    """An event that Ctrl-C or SIGTERM sets; a second Ctrl-C acts at once. Does nothing outside the main thread.

    Around another such block the event is set too: what the inner one has no time left to heed, the outer one can.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    def request(number: int, frame: Any) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        for event in _awaited:
            event.set()

    _awaited.append(stop)
    before = {number: signal.signal(number, request) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        _awaited.remove(stop)
        for number, handler in before.items():
            signal.signal(number, handler)
