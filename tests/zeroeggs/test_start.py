"""What a stream waits for at its start: a few programs, and no package that it can do without."""

import subprocess
import sys

import pytest

SCRIPT = """
import sys
import jax
import numpy as np
compiled = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, duration_secs, fun_name="", **_: compiled.append(fun_name) if "backend_compile" in event else None
)
from zeggs_jax.zeroeggs import generate
from zeggs_jax.zeroeggs.broadcast import Broadcast
from zeggs_jax.zeroeggs.stream import StreamSession
session = StreamSession(generate.bundled_model(), "neutral")
Broadcast(session).body()
before = len(compiled)
frames = sum(len(session.push(np.zeros(n)).root.pos) for n in (9000, 1, 533, 534, 2000))
print(frames, len(compiled) - before, *compiled, *sorted({"scipy.signal", "scipy.fft", "scipy.interpolate", "librosa",
    "pyloudnorm", "matplotlib", "orbax.checkpoint", "torch", "optax"} & sys.modules.keys()))
"""


@pytest.mark.slow
def test_a_stream_starts_with_few_programs_and_imports():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    frames, later, *found = done.stdout.split()
    assert int(frames) > 0
    assert later == "0"  # nothing is compiled after the start
    assert sorted(found) == ["jit(_drawn)", "jit(advance)", "jit(begin)", "jit(joints)"]
