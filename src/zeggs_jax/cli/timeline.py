"""The command that makes, edits and shows timelines: which style when."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, UseAppendAction, arg

from .guards import keep_inputs, number, prepare_folder

Puts = Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="TIME=STYLE")]
Times = Annotated[UseAppendAction[tuple[float, ...]], arg(metavar="TIME")]


def timeline(
    file: Positional[Path],
    /,
    *,
    put: Puts = (),
    remove: Times = (),
    transition: float | None = None,
    curve: str | None = None,
    intensity: float | None = None,
    shift: float = 0.0,
    stretch: float = 1.0,
    transcript: Path | None = None,
    styles: Annotated[tuple[str, ...], arg(metavar="STYLE")] = (),
    out: Annotated[Path | None, arg(aliases=["-o"])] = None,
) -> None:
    """Make, edit and show a timeline of styles, for 'zeggs generate --timeline'.

    Args:
        file: The timeline, .json or .csv; made when it does not exist. Without a flag it is only shown.
        put: At this second turn into this style or mix, as in 12.5=old or 12.5="0.3 old + 0.7 happy"; repeat for more.
        remove: Take away what is put at this second; repeat for more.
        transition: Seconds that the styles of --put (1 when left out) or --transcript (1 at most) take to be there.
        curve: How they get there: smooth, linear or hard (at once, as in the release).
        intensity: Of the styles of --put: 0 is the mean of all styles, 1 the style, above 1 exaggerated.
        shift: Move everything by so many seconds, before anything is put.
        stretch: Multiply all times by this, before anything is put.
        transcript: Make a new timeline from the sentences of these timed words: .json, .srt, .vtt, .tsv or .TextGrid.
        styles: The styles of the sentences, in turn; or for single sentences, numbered from 0, as in 0=neutral 3=happy.
        out: Write to this file and leave FILE as it is.
    """
    from ..zeroeggs import timeline as t

    details = {"transition": transition, "curve": curve, "intensity": intensity}
    given = {key: value for key, value in details.items() if value is not None}
    _check_flags(put, given, transcript, styles)
    if transcript is not None:
        if file.exists():
            raise ValueError(f"'{file}' exists, and --transcript makes a new timeline; name another file.")
        lines, spoken = _from_transcript(transcript, styles, given)
    else:
        spoken = ()
        if not (file.exists() or put):
            raise FileNotFoundError(f"timeline '{file}' does not exist; begin one with --put 0=STYLE or --transcript.")
        new = not (file.exists() or remove or shift or stretch != 1.0)
        lines = t.Timeline(()) if new else t.read(file)
    lines = _edited(lines, put, remove, shift, stretch, given if transcript is None else {})
    target = file if out is None else out
    if transcript is not None or put or remove or shift or stretch != 1.0 or out is not None:
        inputs = [str(path) for path in (transcript, file if out is not None else None) if path is not None]
        keep_inputs((target,), tuple(inputs))
        prepare_folder(target.parent)
        t.write(target, lines)
        print(f"wrote {target}")
    print(_table(lines, spoken))


def _check_flags(put: Sequence[str], given: dict[str, Any], transcript: Path | None, styles: Sequence[str]) -> None:
    if bool(transcript) != bool(styles):
        raise ValueError("--transcript and --styles belong together: the sentences, and the styles that they get.")
    if given and not put and transcript is None:
        raise ValueError(f"--{next(iter(given))} says how a style is put, and none is; give --put TIME=STYLE too.")
    if given and put and transcript is not None:
        raise ValueError(f"--{next(iter(given))} could be meant for --put or --transcript; edit in a second step.")


def _edited(lines: Any, put: Sequence[str], remove: Sequence[float], shift: float, stretch: float, given: dict) -> Any:
    """The timeline moved, stretched, without what is removed and with what is put, in this order."""
    from ..zeroeggs import timeline as t

    lines = t.shift(lines, shift) if shift else lines
    lines = t.stretch(lines, stretch) if stretch != 1.0 else lines
    for time in remove:
        lines = t.remove(lines, time)
    for cue in sorted((_cue(text, given) for text in put), key=lambda cue: cue.time):
        lines = t.put(lines, cue)
    return lines


def _cue(text: str, given: dict[str, Any]) -> Any:
    from ..zeroeggs import timeline as t
    from ..zeroeggs import timeline_text

    time, equals, style = text.partition("=")
    if not (equals and style.strip()):
        raise ValueError(f"--put got '{text}'; give TIME=STYLE with the time in seconds, such as 12.5=old.")
    return t.Cue(number(time, f"--put got '{text}'"), tuple(timeline_text.mix_of(style).items()), **given)


def _from_transcript(path: Path, styles: Sequence[str], given: dict[str, Any]) -> tuple[Any, Any]:
    """A timeline by sentence, and the sentences."""
    from ..zeroeggs import timeline as t

    spoken = t.spoken(path)
    named = [style.partition("=") for style in styles]
    numbered = [bool(equals) and index.isdigit() for index, equals, _ in named]
    if any(numbered) and not all(numbered):
        raise ValueError("--styles mixes styles in turn and styles of numbered sentences; give one form or the other.")
    chosen = {int(index): style for index, _, style in named} if all(numbered) else styles
    lines = t.by_sentence(spoken, chosen, **{key: value for key, value in given.items() if key != "intensity"})
    how = {key: value for key, value in given.items() if key == "intensity"}
    return t.check(t.Timeline(tuple(cue._replace(**how) for cue in lines.cues))), spoken


def _table(lines: Any, spoken: Sequence[Any]) -> str:
    """Every cue in a line, with what is said in its time."""
    from ..zeroeggs import timeline_text
    from ..zeroeggs.cue import lasting

    rows = [("from", "there", "style", "curve", "intensity", "says" if spoken else "")]
    for k, cue in enumerate(lines.cues):
        end = lines.cues[k + 1].time if k + 1 < len(lines.cues) else float("inf")
        said = " ".join(one.text for one in spoken if cue.time <= 0.5 * (one.start + one.end) < end)
        style = timeline_text.text_of(dict(cue.mix))
        moves = ("", "") if k == 0 else (f"{cue.time + lasting(cue):.2f}", cue.curve)
        rows.append((f"{cue.time:.2f}", moves[0], style, moves[1], f"{cue.intensity:g}", said[:60]))
    widths = [max(len(row[c]) for row in rows) for c in range(6)]
    aligned = ["  ".join(f"{cell:{'>' if c < 2 else '<'}{widths[c]}}" for c, cell in enumerate(row)) for row in rows]
    return "\n".join(row.rstrip() for row in aligned)
