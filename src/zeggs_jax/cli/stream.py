"""`zeggs stream`: speech that is going on in, frames out as they are made."""

import math
import os
import queue
import sys
import threading
import time
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg

from . import hearing, listeners, pages
from .hearing import Ear, Form

LATE_S = 0.5  # a live stream that is later than this leaves frames out
Late = Literal["drop", "wait"]
OFTEN_S = 1.0  # a note of one kind is not told more often


def stream(
    source: Positional[str] = "-",
    /,
    *,
    to: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="WHERE")] = (),
    style: str = "neutral",
    rate: int = 16_000,
    form: Form = "s16",
    channels: int = 1,
    loudness: float | None = None,
    lookahead: int | None = None,
    late: Late | None = None,
    first_pose: Path | None = None,
    temperature: float = 1.0,
    seed: int = 1234,
    library: Path | None = None,
    checkpoint: Path | None = None,
    precision: Literal["float32", "bfloat16", "int8"] = "float32",
) -> None:
    """Move a body live: speech in bit by bit, frames out as JSON lines, UDP, OSC, or to a page by WebSocket.

    Args:
        source: Raw PCM from standard input (-), 'microphone' or 'microphone:NAME', 'socket' (what a page says, with
            --to ws://...), or a recording, played in its own time.
        to: Where frames go: - (JSON lines to standard output, the default), udp://HOST:PORT, osc://HOST:PORT, or
            ws://HOST:PORT, where a page shows the body; repeat for several.
        style: The style to begin with; a page can change it. A name, a .bvh clip or an entry of a library.
        rate: Samples a second of the PCM or the microphone.
        form: How the PCM is written: s16 or f32, little-endian.
        channels: Channels of the PCM, interleaved.
        loudness: Of the whole speech in LUFS, where it is known; without it the loudness so far is levelled.
        lookahead: Frames of speech to wait for; fewer answer sooner and move later and softer.
        late: When late, 'drop' frames or let the source 'wait': a pipe waits, the others cannot and drop.
        first_pose: A .bvh whose first frame the body starts from.
        temperature: 0 gives the mean of the style, higher values vary more.
        seed: The same seed gives the same style.
        library: A library from 'zeggs embed' that --style may name an entry of.
        checkpoint: A model of your own, from 'zeggs train' or 'zeggs convert'.
        precision: Of the decoder's weights; fewer bytes are read faster (see 'zeggs generate').
    """
    places = [listeners.address(where) for where in to if where != "-"]
    _check(source, rate, channels, late, any(scheme == "ws" for scheme, _, _ in places))
    from ..zeroeggs import generate as g
    from ..zeroeggs.broadcast import Broadcast
    from ..zeroeggs.stream import StreamSession

    model = g.load_model(checkpoint) if checkpoint else g.bundled_model()
    asked = g.Request(seed=seed, temperature=temperature, library=None if library is None else str(library))
    pose = None if first_pose is None else str(first_pose)
    session = StreamSession(
        model,
        asked._replace(styles=(style,)),
        first_pose=pose,
        lookahead=lookahead,
        loudness=loudness,
        rate_hz=rate,
        precision=precision,
    )
    show = Show(session, Broadcast(session), asked, style)
    try:
        if "-" in to or not to:
            show.listeners.append(listeners.Lines())
        for scheme, host, port in places:
            show.listeners.append(_listener(scheme, host, port, show))
        ear, kept, live = _source(source, rate, form, channels, late == "drop", show)
        show.run(ear, live)
        del kept
    except BrokenPipeError:  # nobody reads standard output any more: `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    finally:
        show.close()


def _check(source: str, rate: int, channels: int, late: Late | None, pages: bool) -> None:
    if not 1000 <= rate <= 400_000 or not 1 <= channels <= 64:
        raise ValueError(f"--rate {rate} and --channels {channels} are no sound; give 1000 to 400000 Hz, 1 to 64.")
    if source == "socket" and not pages:
        raise ValueError("the source 'socket' is what a page says; also give --to ws://HOST:PORT.")
    if late == "wait" and source != "-":
        raise ValueError(f"the source '{source}' cannot wait; --late wait is for samples that are piped in.")


def _listener(scheme: str, host: str, port: int, show: "Show") -> listeners.Listener:
    if scheme != "ws":
        return listeners.Datagrams(host, port, show.note, listeners.osc() if scheme == "osc" else None)
    from ..stage import live

    def page() -> str:
        return live.page(show.cast.clip, show.names, show.style)

    served = pages.Pages(host, port, page, show.note, show.ask)
    print(f"zeggs: note: open http://{host}:{served.port}/ to watch.", file=sys.stderr, flush=True)
    return served


def _source(source: str, rate: int, form: Form, channels: int, drop: bool, show: "Show") -> tuple[Ear, Any, bool]:
    """The ear, what has to be kept for it to hear, and whether it is live: what comes late is left out."""
    if source == "-":
        ear = Ear(rate, room=0 if drop else 4)
        hearing.listen(ear, hearing.pcm(hearing.stdin(), form, channels))
        return ear, None, drop
    ear = Ear(rate)
    if source == "socket":
        for listener in show.listeners:
            if isinstance(listener, pages.Pages):
                listener.heard = ear.put
        return ear, None, True
    if source.partition(":")[0] == "microphone":
        return ear, hearing.microphone(ear, source.partition(":")[2], show.note), True
    hearing.listen(ear, hearing.played(Path(source), rate))
    return ear, None, True


class Show:
    """A session, who is told of it, and what is asked of it by others while it runs."""

    def __init__(self, session: Any, cast: Any, request: Any, style: str):
        from ..zeroeggs import examples

        self.session, self.cast, self.style = session, cast, style
        self.names = session.model.config.labels or tuple(examples.bundled())
        self.listeners: list[listeners.Listener] = []
        self._request, self._told = request, {}
        self._events: queue.SimpleQueue = queue.SimpleQueue()  # functions that the stream's own thread calls

    def run(self, ear: Ear, live: bool) -> None:
        """Tells frames until the source ends."""
        self.tell(self.cast.body())
        self.tell({"style": self.style})
        most = max(math.ceil(LATE_S * self.session.rate), 1) if live else None
        last, clipped = time.monotonic(), False
        while (heard := ear.take(0.02)) is not None:
            while not self._events.empty():
                self._events.get()()
            now = time.monotonic()
            if heard:
                last = now
            elif live and now - last > hearing.SILENT_S:  # nothing comes: silence, so that the body goes on
                self._perform(self.session.gap(now - last, most))
                last = now
            for number, (samples, rate_hz) in enumerate(heard):
                behind = len(heard) - number - 1
                self._perform(self.session.push(samples, rate_hz, None if most is None else max(most - behind, 1)))
            if self.session.clipped and not clipped:
                clipped = True
                self.note("the speech is clipped: samples are at full scale; turn the input down.")
        self._perform(self.session.flush())
        self.tell({"end": self.session.frame, "dropped": self.session.dropped})

    def _perform(self, poses: Any) -> None:
        dropped = self.session.dropped - self._told.get("dropped", 0)
        if dropped:
            self._told["dropped"] = self.session.dropped
            self.tell({"dropped": dropped, "at": self.session.frame - len(poses.root.pos)})
            self.note(f"too slow for live speech: {dropped} frame{'s'[: dropped != 1]} left out.")
        for message in self.cast.frames(poses):
            self.tell(message)

    def tell(self, message: dict[str, Any]) -> None:
        for listener in self.listeners:
            listener.tell(message)

    def note(self, text: str) -> None:
        """Says something on stderr, each kind at most once a second; any thread may."""
        kind, now = text[:24], time.monotonic()
        if now - self._told.get(kind, -OFTEN_S) >= OFTEN_S:
            self._told[kind] = now
            print(f"zeggs: note: {text}", file=sys.stderr)

    def ask(self, wish: dict[str, Any]) -> None:
        """Another style: read in a thread of its own, then turned to; one that cannot be read is told, no more."""

        def read() -> None:
            try:
                name, seconds = wish.get("style"), wish.get("transition", 1.0)
                if not isinstance(name, str) or type(seconds) not in (int, float) or not 0.0 <= seconds < math.inf:
                    raise ValueError(f'{wish} is no style to turn to; ask for {{"style": NAME, "transition": S}}.')
                point = self.session.embedding(self._request._replace(styles=(name,)))
                self._events.put(lambda: self._turn(name, point, seconds))
            except (ValueError, TypeError, OSError) as error:
                told = " ".join(str(error).split())
                self._events.put(lambda: (self.note(told), self.tell({"note": told})))

        threading.Thread(target=read, daemon=True).start()

    def _turn(self, name: str, point: Any, seconds: float) -> None:
        self.session.set_style(point, seconds)
        self.style = name
        self.tell({"style": name, "at": self.session.frame})

    def close(self) -> None:
        for listener in self.listeners:
            listener.close()
