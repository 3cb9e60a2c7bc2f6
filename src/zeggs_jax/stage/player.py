"""One self-contained page that plays bodies in step with their speech; it asks the network for nothing."""

from __future__ import annotations

import base64
import html
import json
import os
import re
import zlib
from collections import Counter
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import soundfile
import soxr
from jaxtyping import Float

from zeggs_jax.motion import bvh
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.features import local_quaternions
from zeggs_jax.stage import anatomy, body
from zeggs_jax.stage.shapes import Station

COLOURS = ("#c4674a", "#3f8f8a", "#4f79b8", "#cf9f3d", "#8a5c90", "#78994f", "#cc7790", "#64788e")
"""What the figures wear, in turn, on the page and in strips of poses."""

SCRIPTS = ("motion", "view", "webgl", "canvas", "captions", "main")

Speech = str | Path | tuple[np.ndarray, float | int] | None


class Figure(NamedTuple):
    """One moving body on the page."""

    label: str
    clip: Clip
    speech: Speech = None  # a sound file, or (samples [n] or [n, channels], rate in Hz), or none
    colour: str | None = None  # "#rrggbb"; else one of COLOURS, in turn
    words: Sequence[tuple[str, float, float]] = ()  # (word, start, end), s: shown below the stage as they are spoken
    cues: Sequence[tuple[float, str]] = ()  # (from this second on, what the body is asked for), in order
    group: str = ""  # figures of several groups stand under tabs of these names


def read_figure(clip: str | Path, speech: Speech = None) -> Figure:
    """The figure of a BVH file, labelled with the file's name; errors are those of `motion.bvh.read`."""
    return Figure(Path(clip).stem, bvh.read(clip), speech)


def write(
    path: str | Path,
    figures: Sequence[Figure],
    title: str = "Gestures",
    max_rate: float = 60.0,
) -> None:
    """Write the page. Figures of a group stand side by side with one clock and one camera; equal speech is stored once.

    Motion is stored as local quaternions and moving positions in 16 bits (fingertips within 0.5 mm), every
    n-th frame when a clip has more than `max_rate` frames a second. Raises ValueError without figures, with
    motion that is not finite or a sound that cannot be read, OSError where the page cannot be written.
    """
    save(path, page(title, scene(figures, max_rate)))


def scene(figures: Sequence[Figure], max_rate: float = 60.0) -> dict[str, Any]:
    """All that the page knows of its figures, ready for JSON; `write` says what it raises and `max_rate` means."""
    if not figures:
        raise ValueError("the player got no figures; give at least one clip to show.")
    tracks: dict[bytes, tuple[int, dict]] = {}
    entries, counts = [], Counter()
    for figure in figures:
        colour = figure.colour or COLOURS[counts[figure.group] % len(COLOURS)]
        counts[figure.group] += 1
        entry = pack_figure(figure, max_rate) | {"colour": colour, "track": None}
        if figure.speech is not None:
            samples, rate = read_speech(figure.speech)
            key = samples.tobytes() + str(rate).encode()
            index, _ = tracks.setdefault(key, (len(tracks), {"rate": rate, "samples": pack(samples[None])}))
            entry["track"] = index
        entries.append(entry)
    return {"figures": entries, "tracks": [track for _, track in tracks.values()]}


def page(title: str, scene: dict[str, Any], name: str = "index", scripts: Sequence[str] = SCRIPTS) -> str:
    """The page's text: our own markup, style and script with the scene inside."""
    folder = resources.files("zeggs_jax.stage") / "page"
    fill = {
        "title": html.escape(title),
        "style": (folder / "style.css").read_text("utf-8"),
        "script": "\n".join((folder / f"{script}.js").read_text("utf-8") for script in scripts),
        "scene": json.dumps(scene, separators=(",", ":")).replace("<", "\\u003c"),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda hole: fill[hole[1]], (folder / f"{name}.html").read_text("utf-8"))


def pack_figure(figure: Figure, max_rate: float) -> dict[str, Any]:
    """What the page knows of one figure: its skeleton, its shapes, its motion; lengths in metres."""
    clip = figure.clip
    if not len(clip.euler):
        raise ValueError(f"the clip of figure '{figure.label}' has no frames; give one with at least one.")
    if not (np.isfinite(clip.euler).all() and np.isfinite(clip.positions).all()):
        raise ValueError(f"the motion of figure '{figure.label}' has values that are not finite; repair it.")
    step = int(np.ceil(1.0 / (clip.frame_time * max_rate) - 1e-3))
    euler, positions = clip.euler[::step], clip.positions[::step]
    clip = clip._replace(euler=euler, positions=positions, frame_time=clip.frame_time * step)
    skeleton, frames = anatomy.at_rest(clip), np.linspace(0, len(clip.euler) - 1, 96).round().astype(int)
    dressed = body.dress(skeleton, anatomy.world(clip, frames))
    scale = metres(dressed.stature)
    moving = np.ptp(clip.positions, axis=0).max(axis=1) > 1e-3 * dressed.stature
    moving[0] = True
    places = scale * clip.positions[:, moving]
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    grain = max(float(np.abs(places - middle).max()), 1e-6) / 32767.0
    return {
        "label": figure.label,
        "group": figure.group,
        "words": [[text, round(start, 3), round(end, 3)] for text, start, end in figure.words],
        "cues": [[round(time, 3), text] for time, text in figure.cues],
        "frames": len(clip.euler),
        "frameTime": clip.frame_time,
        "parents": list(skeleton.parents),
        "offsets": rounded(scale * skeleton.offsets),
        "moving": np.flatnonzero(moving).tolist(),
        "moveMiddle": rounded(middle),
        "moveStep": grain,
        "moves": pack(np.rint((places - middle) / grain).reshape(len(places), -1).T),
        "turns": pack(np.rint(32767.0 * continuous(clip)).reshape(len(places), -1).T),
        "parts": [[part.tone, *(pack_station(s, scale) for s in part.stations)] for part in dressed.parts],
        "centre": dressed.centre,
        "unit": scale,
        "stature": scale * dressed.stature,
        "floor": scale * dressed.floor,
        "facing": dressed.facing,
    }


def pack_station(s: Station, scale: float) -> list:
    """One ellipse of a shape as 14 numbers, lengths in metres."""
    sizes = scale * np.array([s.width, s.depth, s.cap])
    return [s.joint, *rounded(np.concatenate([scale * s.centre, s.side, s.along, sizes, [s.slope]]))]


def continuous(clip: Clip) -> Float[np.ndarray, "T J 4"]:
    """Local quaternions whose signs do not jump from frame to frame."""
    turns = np.asarray(local_quaternions(clip), np.float64)
    near = np.sum(turns[1:] * turns[:-1], axis=-1, keepdims=True)
    return np.concatenate([turns[:1], turns[1:] * np.cumprod(np.where(near < 0, -1.0, 1.0), axis=0)])


def metres(stature: float) -> float:
    """Metres per unit: of the units people use, the one that makes the body man-high; else it gets 1.7 m."""
    units = np.array([1.0, 0.1, 0.01, 0.001, 0.0254, 0.3048])
    best = units[np.argmin(np.abs(np.log(units * stature / 1.7)))]
    return float(best) if 1.1 < best * stature < 2.4 else 1.7 / stature


def rounded(values: np.ndarray) -> list:
    """Numbers to a hundredth of a millimetre, as short JSON."""
    return np.round(values, 5).tolist()


def pack(values: np.ndarray) -> str:
    """[rows, n] 16-bit numbers -> base64 text: differences along rows, low bytes, then high, deflated."""
    whole = np.asarray(values).astype(np.int16)
    steps = np.diff(whole, axis=1, prepend=np.zeros((len(whole), 1), np.int16))
    planes = np.ascontiguousarray(steps.astype("<i2")).view(np.uint8).reshape(-1, 2).T
    return base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode()


def unpack(text: str, rows: int) -> np.ndarray:
    """The numbers [rows, n] that `pack` was given; what the page does when it opens."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(2, -1)
    steps = np.ascontiguousarray(planes.T).view("<i2").reshape(rows, -1)
    return np.cumsum(steps, axis=1, dtype=np.int16)


def read_speech(speech: str | Path | tuple[np.ndarray, float | int]) -> tuple[np.ndarray, int]:
    """Mono 16-bit samples [n] and their rate, at most 24 kHz: enough for a voice."""
    if isinstance(speech, tuple):
        samples, rate = np.asarray(speech[0], np.float32), speech[1]
    else:
        if not Path(speech).is_file():
            raise FileNotFoundError(f"There is no sound file '{speech}'.")
        try:
            samples, rate = soundfile.read(speech, dtype="float32")
        except (soundfile.LibsndfileError, TypeError) as error:
            raise ValueError(f"'{speech}' is not a sound file that can be read; give WAV, FLAC or OGG.") from error
    samples = samples.mean(axis=1) if samples.ndim == 2 else samples
    if samples.ndim != 1 or not samples.size or not np.isfinite(samples).all():
        raise ValueError(f"speech of shape {samples.shape} is empty or not finite; give samples [n] within -1 and 1.")
    if rate > 24000:
        samples, rate = soxr.resample(samples, rate, 24000), 24000
    return np.clip(np.rint(samples * 32767.0), -32768, 32767).astype(np.int16), round(rate)


def save(path: str | Path, text: str) -> None:
    """Write text under a passing name and put it in place when it is whole."""
    path = Path(path)
    partial = path.with_name(f"{path.name}.tmp{os.getpid()}")
    try:
        partial.write_text(text, encoding="utf-8", newline="\n")
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OSError(f"'{path}' cannot be written ({error.strerror}); name a folder that exists.") from error
