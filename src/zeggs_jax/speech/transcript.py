"""What was said and when: words from JSON, TSV, TextGrid, subtitle or text files, and the sentences they make."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from . import subtitles, voiced

PAUSE_S = 0.6  # between sentences, where nothing is punctuated
ENDS = (".", "!", "?", "…", "。", "！", "？")
CLOSING = "\"'”’»)]"
SILENCES = ("", "sil", "sp", "spn", "<eps>", "<sil>", "<p:>", "[silence]")  # labels of aligners that are no words
FORMS = ".json (a corpus' or Whisper's), .srt, .vtt, .tsv (start, end, word) or .TextGrid"
FASTEST = 40.0  # letters in a second of voice; nobody speaks faster


class Word(NamedTuple):
    """A word, with the punctuation that belongs to it, if any is known."""

    text: str
    start: float  # s
    end: float  # s


class Sentence(NamedTuple):
    """One word or more, in order."""

    words: tuple[Word, ...]

    @property
    def start(self) -> float:
        """Begin of the first word, s."""
        return self.words[0].start

    @property
    def end(self) -> float:
        """End of the last word, s."""
        return self.words[-1].end

    @property
    def text(self) -> str:
        """The words with blanks between."""
        return " ".join(word.text for word in self.words)


def read(path: str | Path, wave: Float[np.ndarray, " n"] | None = None) -> tuple[Word, ...]:
    """The timed words of a speech, in seconds, in order.

    Read are: JSON with "words" (text or word, start, end), as a synthetic corpus and aligners have it, or with
    "segments" (Whisper, WhisperX); TSV with start, end and word in seconds (GENEA), or Whisper's in milliseconds (it
    has a head line); TextGrids of Praat in either text form, from a tier called "words" or the only one; subtitles
    (SubRip, WebVTT). Where only segments or captions are timed, their words share the time by their numbers of letters.
    So do those of a plain text (.txt without tabs) the time in which a voice is heard, where the speech's samples at
    16 kHz are given: right for a sentence, rough for minutes.

    Raises:
        ValueError, OSError: no such file, another format, no words, times that are negative, no numbers or
            not in order; a plain text without samples, or with far more words than they can hold.
    """
    path = Path(path)
    kinds = {".json": _json, ".tsv": _tsv, ".txt": _tsv, ".textgrid": _textgrid, ".srt": _shown, ".vtt": _shown}
    if path.suffix.lower() not in kinds:
        raise ValueError(f"'{path}' is no transcript that can be read; give {FORMS}.")
    if not path.is_file():
        raise FileNotFoundError(f"transcript '{path}' does not exist; give {FORMS}.")
    try:
        text = _decoded(path)
        words = tuple(_heard(text, wave) if _is_plain(path, text) else kinds[path.suffix.lower()](text))
        _check(words)
    except UnicodeDecodeError as error:
        raise ValueError(f"transcript '{path.name}' is not text in UTF-8 or UTF-16; save it as such.") from error
    except (KeyError, TypeError, AttributeError, StopIteration, RecursionError) as error:
        raise ValueError(f"transcript '{path.name}' has no timed words in a known form; give {FORMS}.") from error
    except ValueError as error:
        raise ValueError(f"transcript '{path.name}': {error}") from error
    return words


def is_untimed(path: str | Path) -> bool:
    """Is this transcript, which `read` reads, a plain text?"""
    return _is_plain(Path(path), _decoded(Path(path)))


def _is_plain(path: Path, text: str) -> bool:
    return path.suffix.lower() == ".txt" and "\t" not in text and bool(text.strip())


def _decoded(path: Path) -> str:
    raw = path.read_bytes()
    return raw.decode("utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")


def _check(words: Sequence[Word]) -> None:
    if not words:
        raise ValueError("there are no words in it; give a transcript with timed words.")
    last = 0.0
    for number, (text, start, end) in enumerate(words, 1):
        if not (0.0 <= start <= end < math.inf):
            raise ValueError(f"word {number}, '{text}', lasts from {start:g} to {end:g} s; expected 0 <= start <= end.")
        if start < last:
            raise ValueError(
                f"word {number}, '{text}', starts at {start:g} s, before the one before it; sort the words."
            )
        last = start


def _json(text: str) -> list[Word]:
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"it is not JSON ({error}).") from error
    data = {"words": data} if isinstance(data, list) else data
    if data.get("words") or "segments" not in data:
        return _punctuated(list(_timed(data["words"])), data.get("text"))
    found: list[Word] = []
    for part in data["segments"]:
        if part.get("words"):
            found += _timed(part["words"])
        else:
            found += _shared(str(part["text"]), float(part["start"]), float(part["end"]))
    return found


def _timed(items: Sequence[dict[str, Any]]) -> Iterable[Word]:
    """Words of JSON objects; one without times (WhisperX has none for digits) lies between its neighbours."""
    end = 0.0
    for k, item in enumerate(items):
        start = float(item["start"]) if "start" in item else end
        later = [float(other["start"]) for other in items[k + 1 :] if "start" in other]
        end = float(item["end"]) if "end" in item else max(start, later[0] if later else start)
        if label := str(item["text"] if "text" in item else item["word"]).strip():
            yield Word(label, start, end)


def _punctuated(words: list[Word], text: Any) -> list[Word]:
    """The words as the whole text spells them, where it begins with the same ones."""
    spelled = str(text).split()[: len(words)] if text else []
    if [_letters(word.text) for word in words] != [_letters(one) for one in spelled]:
        return words
    return [word._replace(text=one) for word, one in zip(words, spelled, strict=True)]


def _letters(text: str) -> str:
    return re.sub(r"[\W_]", "", text).lower()


def _shared(text: str, start: float, end: float) -> list[Word]:
    """The words of a timed segment, each with a share of its time by its letters."""
    labels = text.split()
    until = [sum(len(one) for one in labels[:k]) for k in range(len(labels) + 1)]
    at = [start + (end - start) * letters / max(until[-1], 1) for letters in until]
    return [Word(label, *span) for label, *span in zip(labels, at[:-1], at[1:], strict=True)]


def _heard(text: str, wave: Float[np.ndarray, " n"] | None) -> list[Word]:
    """The words of a plain text, which share the time of the voice."""
    if wave is None:
        raise ValueError(f"its words have no times; give {FORMS}.")
    words = _shared(text, 0.0, 1.0)
    spans = voiced.times(wave, np.array([(word.start, word.end) for word in words]))
    letters, seconds = sum(len(word.text) for word in words), float(voiced.speaking(wave).sum() / voiced.RATE_HZ)
    if letters > FASTEST * seconds:
        raise ValueError(f"it has {len(words)} words for {seconds:.1f} s of voice; give the text of this recording.")
    return [word._replace(start=float(a), end=float(b)) for word, (a, b) in zip(words, spans, strict=True)]


def _shown(text: str) -> list[Word]:
    return [word for caption in subtitles.captions(text) for word in _shared(*caption)]


def _tsv(text: str) -> list[Word]:
    rows = [(n, line.split("\t")) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    whisper = bool(rows) and [cell.strip().lower() for cell in rows[0][1][:2]] == ["start", "end"]
    found: list[Word] = []
    for number, row in rows[whisper:]:
        try:
            start, end, label = float(row[0]), float(row[1]), row[2].strip()
        except (ValueError, IndexError) as error:
            raise ValueError(f"line {number} is not start, end and word with tabs between.") from error
        if whisper:
            found += _shared(label, start / 1000.0, end / 1000.0)
        elif label:
            found.append(Word(label, start, end))
    return found


def _textgrid(text: str) -> list[Word]:
    """Praat reads a text file as the quoted texts and the numbers that stand alone; all else in it is comment."""
    found = re.finditer(r'"((?:[^"]|"")*)"|(?<!\S)(-?\d[\d.eE+-]*)(?!\S)', text)
    tokens: Iterator[Any] = iter([m[1].replace('""', '"') if m[1] is not None else float(m[2]) for m in found])
    if next(tokens) != "ooTextFile" or next(tokens) != "TextGrid":
        raise ValueError("it is not a TextGrid in one of Praat's text forms; save it as text.")
    _skip(tokens, 2)  # its begin and end
    tiers: dict[str, list[Word]] = {}
    for _ in range(int(next(tokens))):
        kind, name = str(next(tokens)), str(next(tokens))
        _skip(tokens, 2)
        spans = [[next(tokens) for _ in range(2 + (kind == "IntervalTier"))] for _ in range(int(next(tokens)))]
        if kind == "IntervalTier":
            tiers[name] = [Word(str(t).strip(), a, b) for a, b, t in spans if str(t).strip().lower() not in SILENCES]
    named = [name for name in tiers if "word" in name.lower()] or list(tiers)
    if len(named) != 1:
        raise ValueError(f"it has the tiers {', '.join(map(repr, tiers)) or 'none'}; call the one with words 'words'.")
    return tiers[named[0]]


def _skip(tokens: Iterator[Any], count: int) -> None:
    for _ in range(count):
        next(tokens)


def sentences(words: Sequence[Word], pause: float = PAUSE_S) -> tuple[Sentence, ...]:
    """Words in sentences: up to one that ends in . ! ? or …; where none does, up to a pause of more than `pause` s."""
    punctuated = any(_ends(word) for word in words)
    found: list[list[Word]] = []
    for k, word in enumerate(words):
        fresh = k == 0 or (_ends(words[k - 1]) if punctuated else word.start - words[k - 1].end > pause)
        found += [[word]] if fresh else []
        found[-1] += [] if fresh else [word]
    return tuple(Sentence(tuple(one)) for one in found)


def _ends(word: Word) -> bool:
    return word.text.rstrip(CLOSING).endswith(ENDS)
