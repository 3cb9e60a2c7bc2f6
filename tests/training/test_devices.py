"""Devices and processes: shares of a batch, replicas, agreement, and errors that every process hears."""

import json
import os
import socket
import subprocess
import sys
import textwrap

import jax
import numpy as np
import pytest
from jax.sharding import Mesh, PartitionSpec

from zeggs_jax.training import checkpoint, devices

TREE = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "step": np.int32(4)}


def launch(program: str, *arguments, count: int = 1) -> subprocess.Popen:
    """A Python process of `count` virtual devices that runs `program`."""
    env = os.environ | {"JAX_PLATFORMS": "cpu", "XLA_FLAGS": f"--xla_force_host_platform_device_count={count}"}
    command = [sys.executable, "-c", textwrap.dedent(program), *map(str, arguments)]
    return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(process: subprocess.Popen, status: int = 0) -> tuple[str, str]:
    """(stdout, stderr) of a process that must end with `status`."""
    try:
        out, err = process.communicate(timeout=300)
    finally:
        process.kill()
    assert process.returncode == status, f"{process.returncode}\n{out}\n{err}"
    return out, err


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_one_device_in_one_process():
    mesh = devices.mesh()
    assert (mesh.axis_names, devices.share(), devices.first()) == (("batch",), (0, 1), True)
    state, batch = devices.replicate(TREE, mesh), devices.split({"x": TREE["a"]}, mesh)
    jax.tree.map(np.testing.assert_array_equal, (state, batch["x"]), (TREE, TREE["a"]))
    assert {leaf.sharding.spec for leaf in jax.tree.leaves(state)} == {PartitionSpec()}
    assert batch["x"].sharding.spec == PartitionSpec("batch")
    assert [devices.any_process(flag) for flag in (True, False)] == [True, False]
    devices.check_same(b"anything", "corpus")


def test_the_first_process_works_and_its_error_is_told_as_it_is():
    done = []
    devices.first_does(lambda: done.append(1))
    assert done == [1]
    with pytest.raises(KeyError, match="mine"):
        devices.first_does(lambda: {}["mine"])


@pytest.mark.parametrize(
    ("size", "near"), [(12, "make it 8 or 16"), (3, "make it 8"), (8, None), (24, None), (9, "8 devices: make it 8 or")]
)
def test_a_batch_is_shared_evenly_or_refused(size, near):
    eight = Mesh(np.array(jax.devices() * 8), ("batch",))
    if near is None:
        devices.check_batch(size, eight)
    else:
        with pytest.raises(ValueError, match=rf"a batch of {size} clips cannot be shared by .*{near}"):
            devices.check_batch(size, eight)


def test_every_part_of_a_batch_is_shared_evenly():
    eight = Mesh(np.array(jax.devices() * 8), ("batch",))
    devices.check_batch(32, eight, 4)
    with pytest.raises(ValueError, match=r"^a batch of 24 clips .* 8 devices in 2 parts .*: make it 16 or 32\.$"):
        devices.check_batch(24, eight, 2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((None, 2, 0), "add --coordinator HOST:PORT"),
        ((None, None, 1), "add --coordinator HOST:PORT"),
        (("node1", 2, 0), "'node1'; give HOST:PORT"),
        ((":80", 2, 0), "give HOST:PORT"),
        (("node1:port", 2, 0), "give HOST:PORT"),
        (("node1:70000", 2, 0), "give HOST:PORT"),
        (("node1:80", 2, None), "needs --processes .* and --process"),
        (("node1:80", 2, 2), "--process is 2 of 2"),
        (("auto", 2, None), "leave them out"),
        (("node1:80", 2, 0), "cannot join .* must be called before any JAX calls"),  # the tests have computed already
    ],
)
def test_what_does_not_start_a_run(arguments, message):
    with pytest.raises((ValueError, OSError), match=message):
        devices.start(*arguments)


def test_without_arguments_there_is_nothing_to_start():
    devices.start()
    assert not jax.distributed.is_initialized()


def test_errors_that_are_not_about_other_processes_pass():
    for text in ("UNKNOWN: all-reduce failed", "RESOURCE_EXHAUSTED: out of memory"):
        with pytest.raises(jax.errors.JaxRuntimeError, match=text), devices.company():
            raise jax.errors.JaxRuntimeError(text)


STEP = """
    import json, re
    import jax, jax.numpy as jnp, numpy as np, optax
    from zeggs_jax.training import devices
    from zeggs_jax.training.step import begin, make_step

    def loss_fn(params, batch, keys, step):
        noise = jax.vmap(lambda key: jax.random.normal(key, (3,)))(keys)
        error = jnp.sum((batch["x"] + noise - params["w"][None]) ** 2, axis=-1)
        return jnp.mean(error), {"noise": jnp.mean(noise)}

    def run(accumulate):
        step = make_step(loss_fn, optax.adam(0.1), seed=3, accumulate=accumulate)
        state = devices.replicate(begin({"w": jnp.zeros(3)}, optax.adam(0.1)), mesh)
        losses = []
        for k in range(4):
            batch = devices.split({"x": np.random.default_rng(k).normal(size=(16, 3)).astype(np.float32)}, mesh)
            before = jax.tree.map(lambda leaf: leaf.sharding, state)
            state, metrics = step(state, batch)
            assert jax.tree.map(lambda leaf: leaf.sharding, state) == before
            losses.append([float(metrics[name]) for name in ("loss", "noise", "gradient")])
        text = step.lower(state, batch).compile().as_text()
        kinds = set(re.findall(r" (all-[a-z]+|collective-permute|reduce-scatter)(?:-start)?[(]", text))
        return [step._cache_size(), sorted(kinds), losses, np.asarray(state.params["w"]).tolist()]

    mesh = devices.mesh()
    print(json.dumps([mesh.size, run(1), run(2)]))
"""


def test_eight_devices_step_like_one():
    """Same losses, draws and parameters, also with the batch in parts; one compilation; only means cross devices."""
    (one, alone, _), (eight, *together) = (json.loads(finish(run)[0]) for run in [launch(STEP), launch(STEP, count=8)])
    assert (one, eight, alone[:2]) == (1, 8, [1, []])
    for run in together:
        assert run[:2] == [1, ["all-reduce"]]
        np.testing.assert_allclose(run[2], alone[2], rtol=1e-5)
        np.testing.assert_allclose(run[3], alone[3], rtol=1e-5)


PROCESS = """
    import sys
    from pathlib import Path
    import jax, numpy as np
    from zeggs_jax.training import checkpoint, devices

    folder, port, me = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    devices.start(f"127.0.0.1:{port}", 2, me, timeout_s=120)
    mesh = devices.mesh()
    assert (devices.share(), devices.first(), mesh.size) == ((me, 2), me == 0, 4)
    assert [device.process_index for device in mesh.devices] == [0, 0, 1, 1]

    rows = np.arange(16.0, dtype=np.float32).reshape(8, 2)
    batch = devices.split(rows[4 * me : 4 * me + 4], mesh)
    assert batch.shape == (8, 2)
    for shard in batch.addressable_shards:
        np.testing.assert_array_equal(shard.data, rows[shard.index])
    assert jax.jit(lambda x: x.mean())(batch) == rows.mean()

    tree = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "step": np.int32(4)}
    state = jax.jit(lambda t: jax.tree.map(lambda x: x + 1, t))(devices.replicate(tree, mesh))
    checkpoint.save(folder / "by_two", state, {"by": 2})
    loaded, about = checkpoint.load(folder / "by_two", state)  # complete as soon as any process is told so
    assert about == {"by": 2}
    jax.tree.map(np.testing.assert_array_equal, loaded, jax.tree.map(lambda x: x + 1, tree))
    jax.tree.map(np.testing.assert_array_equal, checkpoint.load(folder / "by_one", tree)[0], tree)

    assert [devices.any_process(flag) for flag in (me == 0, me == 1, False)] == [True, True, False]
    for work in (
        lambda: devices.check_same(b"one" if me else b"other", "corpus"),
        lambda: devices.replicate({"a": np.full(2, me)}, mesh),
        lambda: checkpoint.save(folder / "file" / "model", state, {}),
        lambda: devices.first_does(lambda: (folder / "nowhere" / "file").touch()),
    ):
        try:
            work()
        except OSError as error:
            print(error)
    try:
        if me == 1:
            raise ValueError("this process alone")
        devices.any_process(False)
    except (ValueError, OSError) as error:
        print(error, flush=True)
        devices.leave(5)
"""


def test_two_processes_agree_save_load_and_fail_together(tmp_path):
    checkpoint.save(tmp_path / "by_one", TREE, {})
    (tmp_path / "file").write_text("not a folder")
    port = free_port()
    runs = [launch(PROCESS, tmp_path, port, me, count=2) for me in range(2)]
    said = [[line for line in finish(run, 5)[0].splitlines() if "[Gloo]" not in line] for run in runs]
    for lines in said:
        assert lines[0].startswith("process 1 has another corpus than process 0")
        assert lines[1].startswith("process 1 has another state than process 0")
    assert "Not a directory" in said[0][2] or "File exists" in said[0][2]
    assert "nowhere" in said[0][3]
    assert said[1][2:4] == ["process 0 failed; its own message says why."] * 2
    assert said[0][4].startswith("the run's other processes no longer answer")
    assert said[1][4:] == ["this process alone"]
    tree, _ = checkpoint.load(tmp_path / "by_two", TREE)
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a, b + 1), tree, TREE)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["by_one", "by_two", "file"]


def test_a_process_that_finds_nobody_says_so():
    program = "import sys; from zeggs_jax.training import devices; devices.start(sys.argv[1], 2, 1, timeout_s=2)"
    _, err = finish(launch(program, f"127.0.0.1:{free_port()}"), 2)
    assert "zeggs: the run's processes did not meet within 2 s (process 1 of 2, coordinator '127.0.0.1:" in err
    assert "Traceback" not in err
