"""Data parallelism through JAX's own engine: the state on every device, the batch cut along its first axis.

A jitted step needs no change for it: `jit` follows the shardings of its arguments, so that every device computes the
clips it holds and the mean over the batch becomes an all-reduce. One device in one process takes the same path.
"""

import os
import sys
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec

AXIS = "batch"
AUTO = "auto"
GRACE = 60  # s, by which JAX is more patient than we are


def start(
    coordinator: str | None = None, processes: int | None = None, process: int | None = None, timeout_s: int = 300
) -> None:
    """Join the processes of a run; to be called before any computation. Without arguments: one process, nothing to do.

    `coordinator` is HOST:PORT of process 0, or 'auto': then JAX asks the cluster (SLURM, MPI, TPU pods) for all three.
    ValueError: arguments that do not fit each other; OSError: the processes did not find each other in `timeout_s`.
    """
    if coordinator is None:
        if processes is not None or process is not None:
            raise ValueError("several processes need the address of the first: add --coordinator HOST:PORT.")
        return
    if coordinator == AUTO:
        if processes is not None or process is not None:
            raise ValueError("with --coordinator auto the cluster says how many processes there are: leave them out.")
    else:
        _check_address(coordinator, processes, process)
    # JAX's own notice of SIGTERM would take the place of the loop's; see `any_process`.
    jax.config.update("jax_enable_preemption_service", False)
    where = "the cluster" if coordinator == AUTO else f"process {process} of {processes}, coordinator '{coordinator}'"
    with _patience(timeout_s if process else timeout_s + 5, where):  # without process 0, JAX would abort the others
        try:
            if coordinator == AUTO:
                jax.distributed.initialize(initialization_timeout=timeout_s + GRACE)
            else:
                jax.distributed.initialize(
                    coordinator,
                    processes,
                    process,
                    cluster_detection_method="deactivate",  # else SLURM would leave us one of the host's devices
                    initialization_timeout=timeout_s + GRACE,
                )
        except (RuntimeError, ValueError) as error:
            hint = "; no cluster that JAX knows? give --coordinator HOST:PORT" if coordinator == AUTO else ""
            raise OSError(f"cannot join the run's processes ({where}): {_one_line(error)}{hint}") from error


@contextmanager
def _patience(seconds: int, where: str) -> Iterator[None]:
    """Ends the process with one sentence when the block takes longer; JAX would abort it with a stack trace."""

    def give_up() -> None:
        print(
            f"zeggs: the run's processes did not meet within {seconds} s ({where}): start all of them, with the same "
            "coordinator and number of processes and each with its own number, where they can reach its port.",
            file=sys.stderr,
            flush=True,
        )
        os._exit(2)  # the main thread is inside JAX and hears nothing

    timer = threading.Timer(seconds, give_up)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextmanager
def company() -> Iterator[None]:
    """OSError in place of JAX's own error when, within the block, another process of the run is gone."""
    try:
        yield
    except jax.errors.JaxRuntimeError as error:
        if jax.process_count() == 1 or "RESOURCE_EXHAUSTED" in str(error):
            raise
        raise OSError(
            f"the run's other processes no longer answer ({_one_line(error)}); one of them says why, and the same "
            "commands go on from the last checkpoint."
        ) from error


def leave(status: int) -> None:
    """End this process after an error. Among several, at once: the usual way out waits for the others, which wait."""
    if jax.distributed.is_initialized():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]


def mesh() -> Mesh:
    """All devices of all processes in one row, those of process 0 first."""
    devices = sorted(jax.devices(), key=lambda device: (device.process_index, device.id))
    return Mesh(np.array(devices), (AXIS,))


def share() -> tuple[int, int]:
    """(index of this process, number of processes): which rows of a batch this process makes."""
    return jax.process_index(), jax.process_count()


def first() -> bool:
    """Whether this process writes what is written once: logs, pages, the checkpoint's folder."""
    return jax.process_index() == 0


def replicate(tree: Any, mesh: Mesh) -> Any:
    """The arrays of `tree`, equal in all processes, on every device. OSError when they are not equal."""
    tree = jax.tree.map(np.asarray, tree)
    if jax.process_count() > 1:
        sums = (zlib.crc32(np.ascontiguousarray(leaf).data.cast("B")) for leaf in jax.tree.leaves(tree) if leaf.size)
        check_same(b"".join(each.to_bytes(4, "little") for each in sums), "state")
    return _place(tree, NamedSharding(mesh, PartitionSpec()))


def split(batch: Any, mesh: Mesh) -> Any:
    """This process's rows of a batch (the first axis of every array) as part of the global batch, cut over devices."""
    return _place(batch, NamedSharding(mesh, PartitionSpec(AXIS)))


def _place(tree: Any, sharding: NamedSharding) -> Any:
    return jax.tree.map(lambda leaf: jax.make_array_from_process_local_data(sharding, leaf), tree)


def check_batch(size: int, mesh: Mesh, parts: int = 1) -> None:
    """ValueError when `size` clips, worked through in `parts`, cannot be shared evenly among the devices."""
    unit = mesh.size * parts
    if size % unit:
        low = size - size % unit
        near = f"{low} or {low + unit}" if low else f"{unit}"
        how = f"{mesh.size} devices" + (f" in {parts} parts (accumulate)" if parts > 1 else "")
        raise ValueError(f"a batch of {size} clips cannot be shared by {how}: make it {near}.")


@company()
def check_same(content: bytes, what: str) -> None:
    """OSError, in every process, when `content` is not the same in all of them."""
    if jax.process_count() == 1:
        return
    sums = multihost_utils.process_allgather(np.uint32(zlib.crc32(content)))
    if other := [number for number, value in enumerate(sums) if value != sums[0]]:
        raise OSError(
            f"process {other[0]} has another {what} than process 0: all processes must read the same files, in a "
            "folder that they share, and get the same settings."
        )


@company()
def any_process(flag: bool) -> bool:
    """Whether `flag` is set in any process; all of them must ask, and all get the same answer."""
    if jax.process_count() == 1:
        return flag
    return bool(multihost_utils.process_allgather(np.asarray(flag)).any())


def first_does(work: Callable[[], Any]) -> None:
    """Process 0 does `work` while the others wait; when it fails, all fail: no process waits for a dead one."""
    any_process(False)  # they meet first: JAX's patience ends for a first connection, not for a late answer
    problem: Exception | None = None
    if first():
        try:
            work()
        except Exception as error:
            problem = error
    failed = any_process(problem is not None)
    if problem is not None:
        raise problem
    if failed:
        raise OSError("process 0 failed; its own message says why.")


def _check_address(coordinator: str, processes: int | None, process: int | None) -> None:
    host, _, port = coordinator.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 2**16:
        raise ValueError(f"--coordinator is '{coordinator}'; give HOST:PORT of process 0, or 'auto' on a cluster.")
    if processes is None or process is None:
        raise ValueError("--coordinator HOST:PORT needs --processes (how many) and --process (which one, from 0).")
    if not 0 <= process < processes:
        raise ValueError(f"--process is {process} of {processes}; it must be at least 0 and below --processes.")
