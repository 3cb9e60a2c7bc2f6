"""The live page in a real browser: real speech goes over a socket, the browser shows the frames that come back."""

import base64
import io
import json
import re
import shutil
import subprocess
import sys
import time
import urllib.request
from contextlib import ExitStack

import matplotlib.pyplot as plt
import numpy as np
import pytest
import soundfile

from zeggs_jax.zeroeggs import generate as g

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FIGURES = r"live · [1-9]\d* frames a second · 633 ms behind the voice · \d+ left out"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="needs Chromium")]


def soon(look, seconds=120.0):
    """What `look` finds, as soon as it finds something."""
    for _ in range(round(10 * seconds)):
        try:
            if found := look():
                return found
        except (OSError, ValueError, LookupError):  # not there yet
            pass
        time.sleep(0.1)
    raise AssertionError(f"nothing came within {seconds:g} s")


@pytest.fixture
def running():
    """Starts programs; they end with the test."""
    with ExitStack() as stack:

        def start(*words, **where):
            process = stack.enter_context(subprocess.Popen(list(map(str, words)), **where))
            stack.callback(process.wait, 30)
            stack.callback(process.terminate)
            return process

        yield start


def test_the_page_moves_with_the_voice(running, tmp_path):
    client = pytest.importorskip("websockets.sync.client")
    with open(tmp_path / "told", "w") as told:
        running(sys.executable, "-m", "zeggs_jax.cli", "stream", "socket", "--to", "ws://127.0.0.1:0", stderr=told)
        address = soon(lambda: (tmp_path / "told").read_text().split("http://")[1].split("/")[0])
    off = [f"--disable-{what}" for what in ("gpu", "background-networking", "component-update", "sync")]
    profile = tmp_path / "profile"
    flags = ["--headless", "--no-sandbox", "--no-first-run", f"--user-data-dir={profile}", "--remote-debugging-port=0"]
    running(BROWSER, *off, *flags, f"http://{address}/#renderer=canvas", stderr=subprocess.DEVNULL)
    port = soon(lambda: (profile / "DevToolsActivePort").read_text().split()[0])
    tab = soon(
        lambda: next(
            (t for t in json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/json")) if address in t["url"]), None
        )
    )
    samples, rate = soundfile.read(next(iter(g.bundled_speech().values())), dtype="int16")
    with (
        client.connect(tab["webSocketDebuggerUrl"], max_size=None, ping_interval=None) as browser,
        client.connect(f"ws://{address}/", ping_interval=None) as voice,
    ):

        def order(method, **params):
            browser.send(json.dumps({"id": 1, "method": method, "params": params}))
            while (answer := json.loads(browser.recv(120))).get("id") != 1:
                pass
            return answer["result"]

        def ask(expression):
            return order("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

        def picture():
            """What the browser shows of the figure: [H, W, 3]."""
            return plt.imread(io.BytesIO(base64.b64decode(order("Page.captureScreenshot", format="png")["data"])))

        soon(lambda: ask("document.documentElement.dataset.ready") == "canvas")
        before = np.array(ask("[...live.figure.place]"))
        voice.send(json.dumps({"rate": rate}))
        voice.send(json.dumps({"style": "old"}))
        for at in range(0, 6 * rate, rate // 20):
            voice.send(samples[at : at + rate // 20].tobytes())
            time.sleep(0.05)
        soon(lambda: ask("live.state.frames") > 20)
        shown = picture()
        soon(lambda: (np.abs(picture() - shown).max(-1) > 0.2).mean() > 1e-3)  # it moves in the picture too
        soon(lambda: ask("$('style').value") == "old")
        soon(lambda: re.fullmatch(FIGURES, ask("$('state').textContent")))
        after = np.array(ask("[...live.figure.place]"))
    assert np.isfinite(after).all()
    assert 0.01 < np.abs(after - before).max() < 3.0  # metres
