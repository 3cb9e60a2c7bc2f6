"""What `zeggs stream` does: it hears, lets the session perform, and tells whoever listens."""

import math
import queue
import sys
import threading
import time
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from . import hearing, listeners, pages
from .hearing import Ear, Form

LATE_S = 0.5  # a live stream that is later than this leaves frames out
OFTEN_S = 1.0  # a note of one kind is not told more often


def listener(scheme: str, host: str, port: int, show: "Show") -> listeners.Listener:
    if scheme != "ws":
        return listeners.Datagrams(host, port, show.note, listeners.osc() if scheme == "osc" else None)
    from ..stage import live

    def page() -> str:
        return live.page(show.cast.clip, show.names, show.style)

    served = pages.Pages(host, port, page, show.note, show.ask)
    print(f"zeggs: note: open http://{host}:{served.port}/ to watch.", file=sys.stderr, flush=True)
    return served


def source(name: str, rate: int, form: Form, channels: int, drop: bool, show: "Show") -> tuple[Ear, Any, bool]:
    """The ear, what has to be kept for it to hear, and whether it is live: what comes late is left out."""
    if name == "-":
        ear = Ear(rate, room=0 if drop else 4)
        hearing.listen(ear, hearing.pcm(hearing.stdin(), form, channels))
        return ear, None, drop
    ear = Ear(rate)
    if name == "socket":
        for one in show.listeners:
            if isinstance(one, pages.Pages):
                one.heard = ear.put
        return ear, None, True
    if name.partition(":")[0] == "microphone":
        return ear, hearing.microphone(ear, name.partition(":")[2], show.note), True
    hearing.listen(ear, hearing.played(Path(name), rate))
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
        try:
            self._hear(ear, most)
        except KeyboardInterrupt:
            self._end()
            raise
        self._perform(self.session.flush())
        self._end()

    def _end(self) -> None:
        self.tell({"end": self.session.frame, "dropped": self.session.dropped})

    def _take(self, ear: Ear) -> list[tuple[np.ndarray, float | int]] | None:
        """What has come; where the source fails, all that it said is still performed."""
        try:
            return ear.take(0.02)
        except (ValueError, OSError):
            self._perform(self.session.flush())
            self._end()
            raise

    def _hear(self, ear: Ear, most: int | None) -> None:
        """Performs what comes; `most` frames of it at once where the source is live."""
        last, clipped = time.monotonic(), False
        while (heard := self._take(ear)) is not None:
            while not self._events.empty():
                self._events.get()()
            now = time.monotonic()
            if heard:
                last = now
            elif most is not None and now - last > hearing.SILENT_S:  # nothing comes: silence, so that the body goes on
                self._perform(self.session.gap(now - last, most))
                last = now
            pieces = _joined(heard)
            for number, (samples, rate_hz) in enumerate(pieces):
                later = sum(len(more) / rate for more, rate in pieces[number + 1 :])
                room = None if most is None else max(most - math.ceil(later * self.session.rate), 0)
                self._perform(self.session.push(samples, rate_hz, room))
            if self.session.clipped and not clipped:
                clipped = True
                self.note("the speech is clipped: samples are at full scale; turn the input down.")

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

    def note(self, text: str, kind: str = "") -> None:
        """Says something on stderr, each kind (its first words, if not told) at most once a second; any thread may."""
        kind, now = kind or text[:24], time.monotonic()
        if now - self._told.get(kind, -OFTEN_S) >= OFTEN_S:
            self._told[kind] = now
            print(f"zeggs: note: {text}", file=sys.stderr)

    def ask(self, wish: dict[str, Any]) -> None:
        """Another style: read in a thread of its own, then turned to; one that cannot be read is told, no more."""

        def read() -> None:
            try:
                name, seconds = wish.get("style"), wish.get("transition", 1.0)
                if not isinstance(name, str) or type(seconds) not in (int, float) or not 0.0 <= seconds < math.inf:
                    raise ValueError(
                        f'{str(wish)[:60]} is no style to turn to; ask for {{"style": NAME, "transition": S}}.'
                    )
                seconds = float(seconds)
                point = self.session.embedding(self._request._replace(styles=(name,)))
                self._events.put(lambda: self._turn(name, point, seconds))
            except (ValueError, TypeError, OSError, OverflowError) as error:
                told = " ".join(str(error).split())[:300]
                self._events.put(lambda: (self.note(told, "wish"), self.tell({"note": told})))

        threading.Thread(target=read, daemon=True).start()

    def _turn(self, name: str, point: Any, seconds: float) -> None:
        self.session.set_style(point, seconds)
        self.style = name
        self.tell({"style": name, "at": self.session.frame})

    def close(self) -> None:
        for listener in self.listeners:
            listener.close()


def _joined(heard: list[tuple[np.ndarray, float | int]]) -> list[tuple[np.ndarray, float | int]]:
    """The pieces, those of one rate and form in a row as one: only together do they tell how late the stream is."""
    alike = groupby(heard, lambda one: (one[1], one[0].dtype.char))
    return [(np.concatenate([samples for samples, _ in same]), rate) for (rate, _), same in alike]
