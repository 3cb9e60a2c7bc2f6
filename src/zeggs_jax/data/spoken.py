"""The speech that a made clip is judged by: its samples, its loudness in every frame, its stressed words."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from zeggs_jax.data.entry import beside
from zeggs_jax.data.recorded import Recorded, read_notes
from zeggs_jax.speech import features, transcript, wav
from zeggs_jax.speech.transcript import Word

TIMED = (".json", ".srt", ".vtt", ".tsv", ".TextGrid")  # transcripts that may hold times
LOUD_RATE_HZ = 100.0  # at which the loudest moment of a word is found


class Spoken(NamedTuple):
    """One recording."""

    wave: Float[np.ndarray, " n"]  # 16 kHz
    stresses: Float[np.ndarray, " S"] | None  # s, of stressed words; None without a transcript that has times


def hear(recorded: Recorded) -> Spoken | None:
    """The speech of a recorded clip, None where it has none; an error names the file that does not read."""
    if recorded.speech is None:
        return None
    wave = wav.read(recorded.speech)
    return Spoken(wave, _stresses(recorded, recorded.speech, wave))


def loudness(wave: Float[np.ndarray, " n"], frames: int, rate_hz: float) -> Float[np.ndarray, " T"]:
    """Root mean square of the samples around each frame of motion."""
    return np.asarray(features.frame_energy(wave, frames, rate_hz), np.float64)


def _stresses(recorded: Recorded, speech: Path, wave: Float[np.ndarray, " n"]) -> Float[np.ndarray, " S"] | None:
    """ "stresses" of the JSON beside the clip where it has them, else those of its timed words."""
    stems = (recorded.path.with_suffix(""), speech.with_suffix(""))
    timed = next((path for stem in stems if (path := beside(stem, TIMED))), None)
    if timed is None:
        return None
    if timed.suffix.lower() == ".json":
        given = read_notes(timed).get("stresses")
        if isinstance(given, list) and given:
            try:
                return np.sort([float(item["time"] if isinstance(item, dict) else item) for item in given])
            except (KeyError, TypeError, ValueError) as error:
                raise ValueError(f"'{timed}' has stresses that are no times; give numbers of seconds.") from error
        if not read_notes(timed).get("words") and not read_notes(timed).get("segments"):
            return None
    return stressed(transcript.read(timed), wave)


def stressed(words: tuple[Word, ...], wave: Float[np.ndarray, " n"]) -> Float[np.ndarray, " S"]:
    """Loudest moments of the louder half of the words, s: what is taken for stress where nobody marked it."""
    loud = np.asarray(features.frame_energy(wave, None, LOUD_RATE_HZ), np.float64)
    spans = [(int(word.start * LOUD_RATE_HZ), int(np.ceil(word.end * LOUD_RATE_HZ))) for word in words]
    heard = [(start, loud[start:stop]) for start, stop in spans if start < stop and start < len(loud)]
    peaks = np.array([[(start + part.argmax()) / LOUD_RATE_HZ, part.max()] for start, part in heard]).reshape(-1, 2)
    return np.unique(peaks[peaks[:, 1] >= np.median(peaks[:, 1]), 0]) if len(peaks) else np.zeros(0)
