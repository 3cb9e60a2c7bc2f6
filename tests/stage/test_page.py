"""The page in a real browser, where one is installed: it starts, and its own kinematics are ours."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from zeggs_jax.motion import features
from zeggs_jax.stage import player
from zeggs_jax.stage.player import Figure

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PROBE = """<script>
(async () => {
  while (!document.documentElement.dataset.ready) await new Promise(go => setTimeout(go, 20));
  const found = { ready: document.documentElement.dataset.ready, duration: player.duration, places: [] };
  for (const time of TIMES) {
    player.seek(time);
    player.figures[0].pose(player.time);
    found.places.push([player.time, [...player.figures[0].place]]);
  }
  const track = player.tracks[0];
  found.sound = [track.seconds, ...track.pcm.slice(0, 50)];
  document.body.dataset.found = JSON.stringify(found);
})();
</script></body>"""


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
def test_the_browser_shows_our_kinematics(tmp_path, clip, speech):
    path, times = tmp_path / "page.html", [0.0, 0.7, 1.95]
    player.write(path, [Figure("a", clip, speech), Figure("b", clip)])
    path.write_text(path.read_text("utf-8").replace("</body>", PROBE.replace("TIMES", json.dumps(times))), "utf-8")
    flags = [f"--disable-{what}" for what in ("gpu", "quic", "background-networking", "component-update", "sync")]
    flags += ["--headless", "--no-sandbox", "--no-first-run", f"--user-data-dir={tmp_path / 'profile'}"]
    command = [
        str(BROWSER),
        *flags,
        "--virtual-time-budget=20000",
        "--dump-dom",
        path.as_uri() + "#renderer=canvas",
    ]
    page = subprocess.run(command, capture_output=True, timeout=120, text=True).stdout
    assert 'data-ready="canvas"' in page
    found = json.loads(re.search(r'data-found="([^"]*)"', page)[1].replace("&quot;", '"'))
    assert found["duration"] == pytest.approx(2.0)
    assert found["sound"][0] == pytest.approx(2.0)
    np.testing.assert_array_equal(found["sound"][1:], player.read_speech(speech)[0][:50])
    ours = 0.01 * features.world_positions(clip)
    for asked, (time, places) in zip(times, found["places"], strict=True):
        assert time == pytest.approx(asked)
        at = min(time / clip.frame_time, 59.0)
        low, part = int(at), at - int(at)
        expected = (1 - part) * ours[low] + part * ours[min(low + 1, 59)]
        np.testing.assert_allclose(np.reshape(places, (-1, 3)), expected, atol=2e-3)
