"""`zeggs stream` tells what `generate` makes; what is dead, missing or late is one sentence, and it goes on."""

import io
import json
import queue
import signal
import socket
import subprocess
import sys
import time
import types
import urllib.error
import urllib.request

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

from zeggs_jax.cli import hearing, listeners, pages
from zeggs_jax.cli.hearing import Ear
from zeggs_jax.cli.show import Show
from zeggs_jax.motion import features
from zeggs_jax.speech import wav
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs.broadcast import Broadcast
from zeggs_jax.zeroeggs.stream import StreamSession


@pytest.fixture(scope="module")
def model():
    return g.bundled_model()


@pytest.fixture(scope="module")
def samples():
    """1.5 s of speech at 16 kHz, int16."""
    return soundfile.read(next(iter(g.bundled_speech().values())), dtype="int16")[0][:24_000]


@pytest.fixture
def piped(monkeypatch, samples):
    """Pipes samples, or other bytes, into the command."""

    def pipe(content=None):
        content = samples.tobytes() if content is None else content
        monkeypatch.setattr(hearing, "stdin", lambda: io.BytesIO(content))

    return pipe


@pytest.fixture
def show(model):
    made = Show(StreamSession(model, "happy"), None, g.Request(), "happy")
    made.cast = Broadcast(made.session)
    made.listeners.append(Told())
    return made


class Told(list):
    """A listener that keeps what it is told."""

    def tell(self, message):
        self.append(message)

    def close(self):
        pass


def by_kind(messages, kind):
    return [message for message in messages if kind in message]


def test_lines_tell_what_generate_makes(zeggs, piped, model, samples):
    wave = samples.astype(np.float32) / 32768.0
    piped()
    status, out, _ = zeggs("stream", "--style", "old", "--loudness", repr(wav.loudness(wave)))
    assert status == 0
    body, *told, end = [json.loads(line) for line in out.splitlines()]
    frames = by_kind(told, "frame")
    clip = g.generate(wave, "old", model=model).clip
    assert body["joints"] == list(clip.skeleton.names)
    assert body["parents"] == list(clip.skeleton.parents)
    assert [one["frame"] for one in frames] == list(range(len(clip.euler)))
    assert end == {"end": len(clip.euler), "dropped": 0}
    np.testing.assert_allclose([one["place"] for one in frames], clip.positions[:, 0], atol=2e-4)
    turns, expected = np.array([one["turns"] for one in frames]), features.local_quaternions(clip)
    np.testing.assert_allclose(np.abs(np.sum(turns * expected, axis=-1)), 1.0, atol=2e-5)


def test_datagrams_are_whole_frames(zeggs, piped):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mine:
        mine.bind(("127.0.0.1", 0))
        mine.settimeout(10)
        piped()
        assert zeggs("stream", "--to", f"udp://127.0.0.1:{mine.getsockname()[1]}")[:2] == (0, "")
        told = [json.loads(mine.recv(65_535)) for _ in range(10)]
    assert "joints" in told[0]
    assert [one["frame"] for one in by_kind(told, "frame")] == list(range(8))
    assert all(len(one["turns"]) == 75 for one in by_kind(told, "frame"))


def test_osc_spells_a_frame_as_one_bundle(show):
    osc_bundle = pytest.importorskip("pythonosc.osc_bundle")
    spell = listeners.osc()
    spell(show.cast.body())
    frame = next(show.cast.frames(show.session.push(np.zeros(16_000, np.float32))))
    said = [(one.address, one.params) for one in osc_bundle.OscBundle(spell(frame))]
    assert said[0] == ("/zeggs/frame", [0, 0.0])
    assert said[2][0] == "/zeggs/turn"
    assert said[2][1][0] == "Hips"
    np.testing.assert_allclose(said[2][1][1:], frame["turns"][0], atol=1e-6)
    assert len(said) == 77
    (one,) = osc_bundle.OscBundle(spell({"dropped": 3, "at": 7}))
    assert (one.address, one.params) == ("/zeggs/dropped", [3])


def test_a_dead_socket_is_told_once_and_the_stream_goes_on(zeggs, piped):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as gone:
        gone.bind(("127.0.0.1", 0))
        port = gone.getsockname()[1]
    piped()
    status, out, err = zeggs("stream", "--to", f"udp://127.0.0.1:{port}", "--to", "-")
    assert status == 0
    assert json.loads(out.splitlines()[-1])["end"] == 45
    assert 1 <= err.count(f"127.0.0.1:{port} does not take frames") < 20  # once a second at most


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--to", "tcp://here:1"), "no place to send to"),
        (("--to", "udp://here"), "no place to send to"),
        (("--to", "udp://host.invalid:9"), "nothing can be sent"),
        (("--rate", "5"), "no sound"),
        (("--channels", "0"), "no sound"),
        (("socket",), "--to ws://"),
        (("microphone", "--late", "wait"), "cannot wait"),
        (("--style", "hapy"), "unknown style 'hapy'"),
        (("--lookahead", "99"), "0 to 15"),
        (("--first-pose", "no.bvh"), "no.bvh"),
        (("no.wav",), "no.wav"),
    ],
)
def test_what_is_wrong_is_one_sentence(zeggs, piped, words, sentence):
    piped()
    status, _, err = zeggs("stream", *words)
    assert status == 2
    assert err.count("\n") == 1
    assert sentence in err


def test_samples_that_end_within_one_are_told_after_the_frames_before(zeggs, piped, samples):
    piped(samples.tobytes() + b"\0")
    status, out, err = zeggs("stream")
    assert (status, err.count("\n")) == (2, 1)
    assert "1 bytes into one of 2" in err
    assert len(by_kind([json.loads(line) for line in out.splitlines()], "frame")) > 20


def test_a_terminal_is_no_speech(zeggs, monkeypatch):
    monkeypatch.setattr(sys, "stdin", types.SimpleNamespace(isatty=lambda: True))
    status, _, err = zeggs("stream")
    assert status == 2
    assert "pipe raw PCM" in err


@pytest.mark.skipif(sys.platform == "win32", reason="interrupted by a signal")
def test_interrupted_while_it_waits_for_samples_it_stops():
    """As Ctrl-C does while the reading thread waits; in a process of its own, as the end of Python is what can fail."""
    code = (
        "import sys, time; from zeggs_jax.cli import hearing\n"
        "ear = hearing.Ear(16000); hearing.listen(ear, hearing.pcm(hearing.stdin(), 's16', 1))\n"
        "try: print(len(ear.take(60)[0][0]), flush=True); time.sleep(60)\n"
        "except KeyboardInterrupt: sys.exit(130)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdin
        assert process.stdout
        process.stdin.write(bytes(200))
        process.stdin.flush()
        assert int(process.stdout.readline()) == 100
        process.send_signal(signal.SIGINT)
        status = process.wait(60)
        assert process.stderr
        told = process.stderr.read()
    assert (status, told) == (130, b"")


def test_no_microphone_is_one_sentence(zeggs, monkeypatch):
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    status, _, err = zeggs("stream", "microphone")
    assert status == 2
    assert "zeggs-jax[live]" in err

    class Missing(Exception):
        pass

    def stream(**asked):
        raise Missing("Error querying device -1")

    monkeypatch.setitem(
        sys.modules, "sounddevice", types.SimpleNamespace(PortAudioError=Missing, RawInputStream=stream)
    )
    status, _, err = zeggs("stream", "microphone:desk")
    assert (status, err.count("\n")) == (2, 1)
    assert "no microphone 'desk' can be heard (Error querying device -1)" in err


def test_a_microphone_that_goes_away_ends_the_stream(monkeypatch):
    asked = {}

    def stream(**options):
        asked.update(options)
        return types.SimpleNamespace(start=lambda: None)

    monkeypatch.setitem(
        sys.modules, "sounddevice", types.SimpleNamespace(PortAudioError=Exception, RawInputStream=stream)
    )
    ear = Ear(16_000)
    hearing.microphone(ear, "", print)
    asked["callback"](np.arange(320, dtype=np.int16).tobytes(), 320, None, None)
    asked["finished_callback"]()
    ((samples, rate),) = ear.take(0.1) or []
    assert (len(samples), rate, asked["samplerate"]) == (320, 16_000, 16_000)
    with pytest.raises(OSError, match="the microphone has gone"):
        ear.take(0.1)


class Pipe(io.BytesIO):
    """Gives its bytes in pieces of these sizes, over and over."""

    def __init__(self, content, sizes):
        super().__init__(content)
        self.sizes, self.number = sizes, 0

    def read1(self, most=-1):
        self.number += 1
        return super().read1(self.sizes[self.number % len(self.sizes)])


@given(st.lists(st.integers(1, 9), min_size=1, max_size=4), st.sampled_from([1, 2, 3]), st.sampled_from(["s16", "f32"]))
def test_samples_are_the_same_in_any_pieces(sizes, channels, form):
    written = np.arange(12 * channels, dtype="<i2" if form == "s16" else "<f4").reshape(12, channels)
    found = np.concatenate(list(hearing.pcm(Pipe(written.tobytes(), sizes), form, channels)))
    np.testing.assert_array_equal(found, hearing.mixed(written))
    assert found.dtype == (np.int16 if form == "s16" and channels == 1 else np.float32)


def test_a_stream_that_is_late_says_so_and_drops_whole_frames(show, capsys):
    ear = Ear(16_000)
    ear.put(np.zeros(48_000, np.float32))  # three seconds at once
    ear.end()
    show.run(ear, live=True)
    (told,) = show.listeners
    frames = [one["frame"] for one in by_kind(told, "frame")]
    (dropped,) = [one for one in by_kind(told, "dropped") if "at" in one]
    assert dropped["dropped"] == dropped["at"] == frames[0] > 50
    assert frames == list(range(frames[0], 90))
    assert told[-1] == {"end": 90, "dropped": frames[0]}
    assert f"{frames[0]} frames left out" in capsys.readouterr().err


def test_a_stream_that_is_late_in_small_pieces_drops_as_much(show):
    ear = Ear(16_000)
    for _ in range(150):  # as a microphone puts them
        ear.put(np.zeros(320, np.float32))
    ear.end()
    show.run(ear, live=True)
    (told,) = show.listeners
    (dropped,) = [one for one in by_kind(told, "dropped") if "at" in one]
    assert dropped["dropped"] > 50
    assert told[-1] == {"end": 90, "dropped": dropped["dropped"]}


def test_a_source_that_fails_is_performed_to_its_end(show):
    ear = Ear(16_000)
    ear.put(np.zeros(16_000, np.float32))
    ear.end(ValueError("the samples end early."))
    with pytest.raises(ValueError, match="end early"):
        show.run(ear, live=False)
    assert show.listeners[0][-1] == {"end": 30, "dropped": 0}


def test_a_transition_beyond_all_numbers_is_refused(show):
    with pytest.raises(ValueError, match="the transition is 1000"):
        show.session.set_style("old", 10**400)
    show.ask({"style": "old", "transition": 10**400})
    ear = Ear(16_000)
    ear.end()
    while show._events.empty():
        time.sleep(0.01)
    show._events.get()()
    show.run(ear, live=False)
    assert any("note" in one for one in show.listeners[0])


def test_a_source_that_waits_loses_nothing(show):
    ear = Ear(16_000)
    ear.put(np.zeros(48_000, np.float32))
    ear.end()
    show.run(ear, live=False)
    assert len(by_kind(show.listeners[0], "frame")) == 90


def test_silence_goes_on_where_nothing_comes_and_a_style_can_be_asked_for(show, monkeypatch):
    monkeypatch.setattr(hearing, "SILENT_S", 0.05)
    events = []
    for wish in (
        {"style": "hapy"},
        {"style": 3},
        {"style": "old", "transition": "soon"},
        {"style": "old", "transition": 0.1},
    ):
        show.ask(wish)
        events.append(show._events.get(timeout=60))
    for event in events:
        show._events.put(event)

    class Awhile(Ear):
        left = 12

        def take(self, wait_s):
            self.left -= 1
            return super().take(wait_s) if self.left else None

    show.run(Awhile(16_000), live=True)
    (told,) = show.listeners
    notes = " ".join(one["note"] for one in by_kind(told, "note"))
    assert "unknown style 'hapy'" in notes
    assert "no style to turn to" in notes
    assert "soon" in notes
    assert [one["style"] for one in by_kind(told, "style")] == ["happy", "old"]
    assert by_kind(told, "frame")


@pytest.fixture
def served():
    """Pages on a free port; what they note, what they are asked, what they hear."""
    pytest.importorskip("websockets")
    notes, wishes, heard = queue.Queue(), queue.Queue(), queue.Queue()
    made = pages.Pages("127.0.0.1", 0, lambda: "<p>page</p>", notes.put, wishes.put)
    yield made, notes, wishes, heard
    made.close()


def test_a_page_is_shown_told_and_heard(served):
    from websockets.sync.client import connect

    made, notes, wishes, heard = served
    with urllib.request.urlopen(f"http://127.0.0.1:{made.port}/") as answer:
        assert answer.read() == b"<p>page</p>"
        assert answer.headers["Content-Type"].startswith("text/html")
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(f"http://127.0.0.1:{made.port}/else")
    made.tell({"joints": ["Hips"]})
    with connect(f"ws://127.0.0.1:{made.port}/") as page:
        assert json.loads(page.recv(10)) == {"joints": ["Hips"]}  # also who comes later is told the body
        made.tell({"frame": 1})
        assert json.loads(page.recv(10)) == {"frame": 1}
        page.send(b"\1\0\2\0")
        assert "'socket'" in notes.get(timeout=10)
        made.heard = lambda samples, rate: heard.put((samples.tolist(), rate))
        page.send('{"rate": 48000}')
        page.send(b"\1\0\2\0")
        assert heard.get(timeout=10) == ([1, 2], 48_000.0)
        page.send(b"\1\0\2")
        assert "3 bytes" in notes.get(timeout=10)
        page.send('{"style": "old"}')
        assert wishes.get(timeout=10) == {"style": "old"}
        for nonsense in ("hello", "[1]", '{"rate": "fast"}', '{"rate": 0}'):
            page.send(nonsense)
            assert "not understood" in notes.get(timeout=10)
    made.tell({"frame": 2})  # to nobody


def test_a_page_from_elsewhere_may_not_listen(served):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://127.0.0.1:{served[0].port}/", origin="http://elsewhere.example")
    with connect(f"ws://127.0.0.1:{served[0].port}/", origin=f"http://localhost:{served[0].port}"):
        pass


def test_a_page_that_is_behind_gets_whole_frames_and_is_told_how_many_not(served, monkeypatch):
    from websockets.sync.client import connect

    monkeypatch.setattr(pages, "WAITING", 3)
    made, notes, *_ = served
    with connect(f"ws://127.0.0.1:{made.port}/") as page:
        made.tell({"joints": []})  # a page that comes later is told it too
        assert "joints" in json.loads(page.recv(10))
        (waiting,) = made._clients.values()
        with waiting.mutex:  # the page stands still
            for number in range(5):
                waiting.queue.append({"frame": number, "turns": [[number] * 4] * 75})
            waiting.not_empty.notify()
        for number in range(5, 400):
            made.tell({"frame": number, "turns": [[number] * 4] * 75})
        made.tell({"end": 400})
        told = []
        while "end" not in (message := json.loads(page.recv(10))):
            told.append(message)
    assert [one["frame"] for one in by_kind(told, "frame")] == sorted(one["frame"] for one in by_kind(told, "frame"))
    assert all(one["turns"] == [[one["frame"]] * 4] * 75 for one in by_kind(told, "frame"))  # none is torn
    left_out = sum(one["dropped"] for one in by_kind(told, "dropped"))
    assert left_out + len(by_kind(told, "frame")) + waiting.left_out == 400
    assert notes.empty() or "left out" in notes.get()


def test_a_port_in_use_is_one_sentence(served, zeggs, piped):
    piped()
    status, _, err = zeggs("stream", "--to", f"ws://127.0.0.1:{served[0].port}")
    assert (status, err.count("\n")) == (2, 1)
    assert "cannot be served" in err


@pytest.mark.parametrize(
    ("module", "where"), [("pythonosc", "osc://127.0.0.1:9"), ("websockets.sync.server", "ws://127.0.0.1:0")]
)
def test_a_missing_extra_is_one_sentence(zeggs, piped, monkeypatch, module, where):
    monkeypatch.setitem(sys.modules, module, None)
    piped()
    status, _, err = zeggs("stream", "--to", where)
    assert status == 2
    assert "zeggs-jax[live]" in err
