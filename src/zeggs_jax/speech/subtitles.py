"""Subtitles, SubRip (.srt) and WebVTT (.vtt): the text of every caption and the time it is shown."""

import html
import re
from typing import NamedTuple

_CLOCK = r"(?:(\d+):)?(\d{1,2}):(\d{2})[.,](\d{1,3})"
_TIMES = re.compile(rf"\s*{_CLOCK}\s*-->\s*{_CLOCK}(?:\s.*)?")
_MARKS = re.compile(r"<[^>]*>|\{\\[^}]*\}|\[[^\]]*\]|^\s*-\s", re.MULTILINE)  # tags, places, [music], a speaker's dash


class Caption(NamedTuple):
    """What is shown from one time to another."""

    text: str  # plain, in one line
    start: float  # s
    end: float  # s


def captions(text: str) -> list[Caption]:
    """The captions of a file's text, in order, without tags, sounds in brackets and notes.

    Raises:
        ValueError: there is none, or a line with an arrow does not say when to when.
    """
    lines = text.splitlines()
    arrows = [k for k, line in enumerate(lines) if "-->" in line]
    if not arrows:
        raise ValueError("there are no captions in it; expected lines such as 00:00:01,000 --> 00:00:02,500.")
    found = []
    for k, until in zip(arrows, [*arrows[1:], len(lines)], strict=True):
        times = _TIMES.fullmatch(lines[k])
        if times is None:
            raise ValueError(f"line {k + 1} is not a caption's times; expected 00:00:01,000 --> 00:00:02,500.")
        numbered = until < len(lines) and lines[until - 1].strip().isdigit()  # the next caption's number
        shown = _plain(lines[k + 1 : until - numbered])
        if any(letter.isalnum() for letter in shown):
            found.append(Caption(shown, _seconds(times.groups()[:4]), _seconds(times.groups()[4:])))
    return found


def _plain(lines: list[str]) -> str:
    """The lines up to the first blank one, without marks; words of nothing but signs, as a note's, are left out."""
    end = next((k for k, line in enumerate(lines) if not line.strip()), len(lines))
    shown = html.unescape(_MARKS.sub("", "\n".join(lines[:end])))
    return " ".join(word for word in shown.split() if any(letter.isalnum() for letter in word))


def _seconds(clock: tuple[str | None, ...]) -> float:
    hours, minutes, seconds, parts = clock
    return 3600 * int(hours or 0) + 60 * int(minutes or 0) + int(seconds or 0) + float(f"0.{parts}")
