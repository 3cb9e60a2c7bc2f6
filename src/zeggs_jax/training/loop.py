"""The training loop, for any network: a state, a jitted step, batches by number, a log, checkpoints, a clean stop.

The state is all there is: batch k and the random keys of update k follow from k and the seed, so a run that
is stopped and resumed gives the same numbers as one that is not.
"""

import json
import math
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int
from tqdm import tqdm

from . import checkpoint

Metrics = dict[str, Float[Array, ""]]
LossFn = Callable[[Any, Any, Array, Array], tuple[Array, Metrics]]  # params, batch, key, step -> loss, terms
Step = Callable[["TrainState", Any], tuple["TrainState", Metrics]]


class TrainState(NamedTuple):
    """All that an update reads and changes; `step` counts the updates done."""

    step: Int[Array, ""]
    params: Any
    opt_state: Any


class Plan(NamedTuple):
    """How far to train, and how often to write."""

    steps: int  # updates in all, those before a resume included
    log_every: int = 10
    checkpoint_every: int = 1000
    keep: int = 3  # newest checkpoints that stay on disk


def begin(params: Any, optimiser: optax.GradientTransformation) -> TrainState:
    """The state before the first update."""
    return TrainState(jnp.zeros((), jnp.int32), params, optimiser.init(params))


def make_step(loss_fn: LossFn, optimiser: optax.GradientTransformation, seed: int) -> Step:
    """One update, jitted; the state that it is given is consumed (donated)."""

    def step(state: TrainState, batch: Any) -> tuple[TrainState, Metrics]:
        key = jax.random.fold_in(jax.random.key(seed), state.step)
        (loss, terms), grads = jax.value_and_grad(loss_fn, has_aux=True)(state.params, batch, key, state.step)
        updates, opt_state = optimiser.update(grads, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        metrics = {"loss": loss, **terms, "gradient": jnp.sqrt(sum(jnp.sum(g * g) for g in jax.tree.leaves(grads)))}
        return TrainState(state.step + 1, params, opt_state), metrics

    return jax.jit(step, donate_argnums=0)


def fit(
    state: TrainState,
    step: Step,
    batches: Callable[[int], Any],
    run: Path,
    plan: Plan,
    save: Callable[[Path, TrainState], Any],
    progress: bool = True,
) -> TrainState:
    """Train from `state` up to `plan.steps` updates; writes RUN/log.jsonl and RUN/checkpoints/step_*.

    While update k runs, batch k + 1 is made. Ctrl-C and SIGTERM finish the update, save, and end in
    KeyboardInterrupt. ValueError, naming update and term, when a number is no longer finite: nothing is saved
    then, and the last checkpoint is good.
    """
    start = int(state.step)
    log = open_log(run / "log.jsonl", start)
    bar = tqdm(total=plan.steps, initial=start, disable=not progress, desc="training", unit="step")
    with log, bar, _stop_requested() as stop:
        batch = batches(start) if start < plan.steps else None
        for k in range(start, plan.steps):
            state, metrics = step(state, batch)
            if k + 1 < plan.steps:
                batch = batches(k + 1)
            values = {name: float(value) for name, value in jax.device_get(metrics).items()}
            _check_finite(values, k, run)
            if k % plan.log_every == 0 or k + 1 == plan.steps:
                log.write(json.dumps({"step": k, "loss": values["loss"], **values}) + "\n")
                log.flush()
                bar.set_postfix(loss=f"{values['loss']:.4f}", refresh=False)
            bar.update()
            if stop.is_set() or (k + 1) % plan.checkpoint_every == 0 or k + 1 == plan.steps:
                _keep_state(state, run, plan.keep, save)
            if stop.is_set():
                raise KeyboardInterrupt(f"stopped after {k + 1} updates; resume with the same command")
    return state


def checkpoints(run: str | Path) -> list[Path]:
    """Finished checkpoints of a run, oldest first."""
    found = (Path(run) / "checkpoints").glob("step_*")
    return sorted(path for path in found if checkpoint.is_checkpoint(path))


def open_log(path: Path, start: int) -> Any:
    """The log, open for appending; lines of updates from `start` on, which a killed run left, are dropped."""
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = [line for line in read_log(path) if line["step"] < start] if path.exists() else []
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text("".join(json.dumps(line) + "\n" for line in kept))
    partial.replace(path)
    return path.open("a")


def read_log(path: str | Path) -> Iterator[dict[str, float]]:
    """The log's lines; one that a kill cut off in the middle is left out."""
    for line in Path(path).read_text().splitlines():
        try:
            yield json.loads(line)
        except ValueError:
            continue


def _check_finite(values: Mapping[str, float], k: int, run: Path) -> None:
    wrong = [name for name, value in values.items() if not math.isfinite(value) and name != "loss"]
    if wrong or not math.isfinite(values["loss"]):
        last = checkpoints(run)
        kept = f"the last good checkpoint is '{last[-1]}'" if last else "there is no checkpoint yet"
        raise ValueError(
            f"training stopped at update {k} (batch {k}): '{(wrong or ['loss'])[0]}' is not finite; {kept}; lower "
            "the learning rate or look at the data."
        )


def _keep_state(state: TrainState, run: Path, keep: int, save: Callable[[Path, TrainState], Any]) -> None:
    save(run / "checkpoints" / f"step_{int(state.step):08d}", state)
    for old in checkpoints(run)[: -max(keep, 1)]:
        checkpoint.remove(old)


@contextmanager
def _stop_requested() -> Iterator[threading.Event]:
    """An event that Ctrl-C or SIGTERM sets; a second Ctrl-C acts at once. Does nothing outside the main thread."""
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    def request(number: int, frame: Any) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    before = {number: signal.signal(number, request) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
