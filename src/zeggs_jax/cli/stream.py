"""`zeggs stream`: speech that is going on in, frames out as they are made."""

import os
import sys
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, UseAppendAction, arg

from . import listeners

Form = Literal["s16", "f32"]
Late = Literal["drop", "wait"]


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
    from ..nn import reduced
    from ..zeroeggs import generate as g
    from ..zeroeggs.broadcast import Broadcast
    from ..zeroeggs.stream import StreamSession
    from . import show as shows

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
    for note in reduced.notes(precision):
        print(f"zeggs: note: {note}", file=sys.stderr)
    show = shows.Show(session, Broadcast(session), asked, style)
    try:
        if "-" in to or not to:
            show.listeners.append(listeners.Lines())
        for scheme, host, port in places:
            show.listeners.append(shows.listener(scheme, host, port, show))
        ear, kept, live = shows.source(source, rate, form, channels, late == "drop", show)
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
