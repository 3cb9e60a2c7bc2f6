"""Where a stream's frames go: lines to standard output, datagrams by UDP or OSC; a frame is whole or left out."""

import json
import socket
import sys
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable
from urllib.parse import urlsplit

Note = Callable[[str], None]
Message = dict[str, Any]


@runtime_checkable
class Listener(Protocol):
    """Is told every message, in order."""

    def tell(self, message: Message) -> None: ...

    def close(self) -> None: ...


def line(message: Message) -> str:
    """The message as one line of JSON, without its end."""
    return json.dumps(message, separators=(",", ":"), allow_nan=False)


class Lines:
    """JSON lines to standard output; raises BrokenPipeError when nobody reads on."""

    def tell(self, message: Message) -> None:
        sys.stdout.write(line(message) + "\n")
        sys.stdout.flush()

    def close(self) -> None:
        pass


class Datagrams:
    """One UDP datagram for each message: JSON, or with `spell` something else. What cannot be sent is left out."""

    def __init__(self, host: str, port: int, note: Note, spell: Callable[[Message], bytes] | None = None):
        self._spell = spell or (lambda message: line(message).encode())
        self._note, self._where = note, f"{host}:{port}"
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind, protocol)
            self._socket.connect(address)
        except (OSError, OverflowError) as error:
            raise ValueError(f"nothing can be sent to '{host}:{port}' ({error}); give another address.") from error

    def tell(self, message: Message) -> None:
        data = self._spell(message)
        try:
            if data:
                self._socket.send(data)
        except OSError as error:  # nobody there yet, or no more
            self._note(
                f"{self._where} does not take frames ({error.strerror or error}); they are left out till it does."
            )

    def close(self) -> None:
        self._socket.close()


def osc() -> Callable[[Message], bytes]:
    """Spells messages as OSC: of a frame one bundle of /zeggs/frame (number, s), /zeggs/place (x, y, z in cm) and, for
    each joint, /zeggs/turn (name, w, x, y, z); of what happens /zeggs/style, /zeggs/dropped, /zeggs/note, /zeggs/end.
    """
    try:
        from pythonosc import osc_bundle_builder, osc_message_builder
    except ImportError as error:
        raise ValueError("OSC needs the extra 'live'; pip install 'zeggs-jax[live]'.") from error
    names: list[str] = []

    def said(address: str, *values: Any) -> Any:
        builder = osc_message_builder.OscMessageBuilder(address=f"/zeggs/{address}")
        for value in values:
            builder.add_arg(value)
        return builder.build()

    def spell(message: Message) -> bytes:
        bundle = osc_bundle_builder.OscBundleBuilder(osc_bundle_builder.IMMEDIATELY)
        if "turns" in message:
            bundle.add_content(said("frame", message["frame"], message["time"]))
            bundle.add_content(said("place", *message["place"]))
            for name, turn in zip(names, message["turns"], strict=True):
                bundle.add_content(said("turn", name, *turn))
            return bundle.build().dgram
        names[:] = message.get("joints", names)
        for key in ("rate", "style", "dropped", "note", "end"):
            if key in message:
                bundle.add_content(said(key, message[key]))
        return bundle.build().dgram

    return spell


def address(text: str) -> tuple[str, str, int]:
    """Scheme, host and port of an address such as ws://127.0.0.1:8765."""
    try:
        parts = urlsplit(text)
        if (
            parts.scheme in ("udp", "osc", "ws")
            and parts.hostname
            and parts.port is not None
            and not parts.path.strip("/")
        ):
            return parts.scheme, parts.hostname, parts.port
    except ValueError:  # a port that is none
        pass
    raise ValueError(f"'{text}' is no place to send to; give -, udp://HOST:PORT, osc://HOST:PORT or ws://HOST:PORT.")
