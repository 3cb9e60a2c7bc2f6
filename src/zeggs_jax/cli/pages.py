"""A WebSocket server and the page that it shows: frames out, the page's sound and wishes in."""

import json
import logging
import queue
import socket
import threading
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

import numpy as np

from .listeners import Message, Note, line

WAITING = 60  # messages that a page may be behind before frames are left out for it


class Pages:
    """A WebSocket server that shows the stream on a page, hears what the page says and does what it asks."""

    def __init__(self, host: str, port: int, page: Callable[[], str], note: Note, asked: Callable[[Message], None]):
        try:
            from websockets.sync.server import serve
        except ImportError as error:
            raise ValueError("a WebSocket needs the extra 'live'; pip install 'zeggs-jax[live]'.") from error
        self._page, self._note, self._asked = page, note, asked
        self._clients: dict[Any, Any] = {}
        self._first: Message | None = None
        self._lock = threading.Lock()
        try:
            door = socket.create_server((host, port))
        except (OSError, OverflowError) as error:
            raise ValueError(f"'{host}:{port}' cannot be served ({error}); give another port.") from error
        self.port = door.getsockname()[1]
        own = [f"http://{name}:{self.port}" for name in (host, "localhost", "127.0.0.1", "[::1]")]
        origins: list[Any] = [None, *own]
        quiet = logging.getLogger("zeggs.pages")  # pages come and go; that is no error
        quiet.addHandler(logging.NullHandler())
        quiet.propagate = False
        self._server = serve(
            self._client,
            sock=door,
            process_request=self._show,
            origins=origins,  # a page from elsewhere may not listen
            max_size=1 << 20,
            logger=quiet,
        )
        self.heard: Callable[[np.ndarray, float], None] | None = None  # where a page's sound goes; None: it may not
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def tell(self, message: Message) -> None:
        """Queued for each page; a page that is behind gets no more frames till it has caught up, and is told."""
        with self._lock:
            self._first = message if "joints" in message else self._first
            for waiting in self._clients.values():
                if "frame" in message:
                    behind = waiting.qsize() >= WAITING or (waiting.left_out and waiting.qsize())
                    if behind:
                        waiting.left_out += 1
                        continue
                    self._tell_left_out(waiting, message["frame"])
                waiting.put(message)

    def _tell_left_out(self, waiting: Any, frame: int) -> None:
        if waiting.left_out:
            waiting.put({"dropped": waiting.left_out, "at": frame})
            self._note(f"a page is too slow: {waiting.left_out} frames were left out for it.")
            waiting.left_out = 0

    def close(self) -> None:
        """Lets the pages have what is queued, for a second, and ends."""
        with self._lock:
            clients = list(self._clients.values())
        for waiting in clients:
            waiting.put(None)
        for waiting in clients:
            waiting.done.wait(1.0)
        self._server.shutdown()

    def _show(self, connection: Any, request: Any) -> Any:
        """The page for who asks for it by HTTP; None goes on to the WebSocket."""
        if "websocket" in request.headers.get("Upgrade", "").lower():
            return None
        if request.path.split("?")[0] != "/":
            return connection.respond(HTTPStatus.NOT_FOUND, "there is only the page at /\n")
        response = connection.respond(HTTPStatus.OK, self._page())
        del response.headers["Content-Type"]
        response.headers["Content-Type"] = "text/html; charset=utf-8"
        response.headers["Cache-Control"] = "no-store"
        return response

    def _client(self, connection: Any) -> None:
        waiting: Any = queue.Queue()
        waiting.left_out, waiting.done = 0, threading.Event()
        with self._lock:
            if self._first is not None:
                waiting.put(self._first)
            self._clients[connection] = waiting
        threading.Thread(target=self._send, args=(connection, waiting), daemon=True).start()
        rate = 16_000.0
        from websockets.exceptions import ConnectionClosed

        try:
            for message in connection:
                rate = self._take(message, rate)
        except ConnectionClosed:  # it broke off
            pass
        finally:
            with self._lock:
                self._clients.pop(connection, None)
            waiting.put(None)

    def _send(self, connection: Any, waiting: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            while (message := waiting.get()) is not None:
                connection.send(line(message))
        except (ConnectionClosed, OSError):  # the page has gone; the others stay
            pass
        waiting.done.set()

    def _take(self, message: str | bytes, rate: float) -> float:
        """Sound (16 bits, one channel) or a wish ({"rate": Hz} of the sound, {"style": NAME}) of a page."""
        if isinstance(message, bytes):
            if self.heard is None or len(message) % 2:
                why = "the stream hears something else" if self.heard is None else f"{len(message)} bytes is no whole"
                self._note(f"sound from a page was left out ({why}; give 'socket' as the source, and 16-bit samples).")
            else:
                self.heard(np.frombuffer(message, "<i2"), rate)
            return rate
        try:
            wish = json.loads(message)
            if not isinstance(wish, dict):
                raise ValueError
            if "rate" not in wish:
                self._asked(wish)
                return rate
            if not 1000 <= float(wish["rate"]) <= 400_000:
                raise ValueError
            return float(wish["rate"])
        except (ValueError, TypeError, OverflowError):
            self._note(
                f'a message from a page is not understood ({message[:40]!r}); send {{"style": NAME}} or {{"rate": HZ}}.'
            )
            return rate
