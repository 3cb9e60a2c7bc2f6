"""Which recorded clip a made clip goes with, and which style it was made in, by its name or its provenance.

A made clip is called as its recorded clip, `NAME`; or `NAME__STYLE`, `NAME__STYLE__2`, where there are several for one
speech; or, as the tables of `zeggs generate --csv` name it, `audio_NAME_label_STYLE`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

JOINT = "__"
FROM_TABLE = ("audio_", "_label_")


class Counterpart(NamedTuple):
    """What a made clip goes with; None where that is not known."""

    truth: str | None  # name of the recorded clip of the same speech
    style: str | None


def of_name(name: str, names: Sequence[str]) -> Counterpart:
    """The recorded clip that `name` is called after, the longest one where several would fit, and the style it names.

    Names of recorded clips may hold folders ("sad/one"); the last part alone is enough where only one ends so.
    """
    short = by_last_part(names)
    if (found := short.get(name)) is not None:
        return Counterpart(found, None)
    if name.startswith(FROM_TABLE[0]):
        speech, _, style = name.removeprefix(FROM_TABLE[0]).rpartition(FROM_TABLE[1])
        if (found := short.get(speech)) is not None:
            return Counterpart(found, style or None)
    stems = [stem for stem in short if name.startswith(stem + JOINT)]
    if not stems:
        return Counterpart(None, None)
    stem = max(stems, key=len)
    style = name.removeprefix(stem + JOINT).split(JOINT)[0]
    return Counterpart(short[stem], None if not style or style.isdigit() else style)


def of_provenance(notes: Mapping[str, Any], names: Sequence[str]) -> Counterpart:
    """The same of what `zeggs generate` writes beside a clip: the recording and the one style that it was given.

    A blend, a timeline or a style moved along principal components is no style of the truth.
    """
    speech = stem(str(_at(notes, "speech", "name") or ""))
    styles = _at(notes, "arguments", "styles")
    one = isinstance(styles, Sequence) and not isinstance(styles, str) and len(styles) == 1
    one = one and not _at(notes, "arguments", "timeline") and not _at(notes, "arguments", "pca")
    return Counterpart(by_last_part(names).get(speech), stem(str(styles[0])) if one else None)


def by_last_part(names: Sequence[str]) -> dict[str, str]:
    """Names by themselves and by their last part, where that is one clip's only."""
    parts = [name.rsplit("/", 1)[-1] for name in names]
    return {part: name for part, name in zip(parts, names, strict=True) if parts.count(part) == 1} | {
        n: n for n in names
    }


def style_of(given: str | None, truth: str | None, styles: Mapping[str, str | None]) -> str | None:
    """The style to recognise: the given one, or the recorded clip's that it names, or that of `truth` itself.

    `styles` holds the recorded clips' styles by name.
    """
    if given is not None:
        clip = by_last_part(list(styles)).get(given)
        return (styles[clip] or given) if clip is not None and given not in styles.values() else given
    return None if truth is None else styles[truth]


def stem(path: str) -> str:
    """The last part of a path of either system, without a suffix of sound or motion; of 'library.npz:NAME' the NAME."""
    _, inside, name = path.partition(".npz:")
    if inside:
        return name
    last = path.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1]
    for suffix in (".wav", ".flac", ".ogg", ".mp3", ".bvh", ".npz"):
        if last.lower().endswith(suffix):
            return last[: -len(suffix)]
    return last


def _at(notes: Any, *keys: str) -> Any:
    for key in keys:
        notes = notes.get(key) if isinstance(notes, Mapping) else None
    return notes
