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


TOLD = """<script>
(async () => {
  while (!document.documentElement.dataset.ready) await new Promise(go => setTimeout(go, 20));
  const found = [], lines = view => [...view.children].filter(part => !part.hidden).map(part => part.textContent);
  const read = () => ({
    words: $("words").hidden ? null : $("words").textContent.trim(),
    now: $("words").hidden ? null : $("words").querySelector(".now")?.textContent ?? null,
    shown: [...document.querySelectorAll(".view")].filter(view => !view.hidden).map(lines),
    tab: $("tabs").querySelector("[aria-selected=true]").textContent,
  });
  for (const time of TIMES) { player.seek(time); found.push(read()); }
  $("tabs").children[0].click(); found.push(read());
  document.body.dataset.found = JSON.stringify(found);
})().catch(error => { document.body.dataset.found = JSON.stringify(String(error)); });
</script></body>"""


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
def test_words_prompts_and_tabs_are_shown_in_time(tmp_path, clip, speech):
    words = [("Good", 0.1, 0.4), ("day.", 0.4, 0.8), ("Look", 1.2, 1.5), ("up.", 1.5, 1.8)]
    told = Figure("b", clip, speech, words=words, cues=[(0.0, "sad"), (1.0, "happy")], group="second")
    found = look(
        tmp_path, [Figure("a", clip, group="first"), told, told._replace(label="c", cues=())], TOLD, [0.5, 1.6], 2
    )
    assert [(one["tab"], one["words"], one["now"]) for one in found] == [
        ("second", "Good day.", "day."), ("second", "Look up.", "up."), ("first", None, None),
    ]  # fmt: skip
    assert [one["shown"] for one in found] == [[["b", "sad"], ["c"]], [["b", "happy"], ["c"]], [["a"]]]


def look(tmp_path, figures, probe, times, tab=1):
    """What the probe finds in the page of these figures."""
    path = tmp_path / "page.html"
    player.write(path, figures)
    path.write_text(path.read_text("utf-8").replace("</body>", probe.replace("TIMES", json.dumps(times))), "utf-8")
    flags = [f"--disable-{what}" for what in ("gpu", "quic", "background-networking", "component-update", "sync")]
    flags += ["--headless", "--no-sandbox", "--no-first-run", f"--user-data-dir={tmp_path / 'profile'}"]
    command = [
        str(BROWSER),
        *flags,
        "--virtual-time-budget=20000",
        "--dump-dom",
        path.as_uri() + f"#renderer=canvas&tab={tab}",
    ]
    page = subprocess.run(command, capture_output=True, timeout=120, text=True).stdout
    assert 'data-ready="canvas"' in page
    return json.loads(re.search(r'data-found="([^"]*)"', page)[1].replace("&quot;", '"'))


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
def test_the_browser_shows_our_kinematics(tmp_path, clip, speech):
    times = [0.0, 0.7, 1.95]
    found = look(tmp_path, [Figure("a", clip, speech), Figure("b", clip)], PROBE, times)
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
