"""Every wrong pair is refused in one sentence that names the file and says what to do."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from zeggs_jax.data import takes as rooms
from zeggs_jax.data.body import BodyConfig
from zeggs_jax.data.entry import Entry
from zeggs_jax.data.takes import body_of, takes
from zeggs_jax.motion import bvh
from zeggs_jax.speech import wav

from .conftest import add_pair


@pytest.fixture
def entry(tmp_path) -> Entry:
    add_pair(tmp_path, "a", 30)
    return Entry("a", tmp_path / "a.bvh", tmp_path / "a.wav", "calm", "train")


def edited(path: Path, **changes) -> None:
    bvh.write(path, bvh.read(path)._replace(**changes))


def spoil(entry: Entry, case: str) -> Entry:
    clip, samples = bvh.read(entry.bvh), wav.read(entry.wav)
    text, note = entry.bvh.read_text(), entry.bvh.with_suffix(".json")
    changes = {
        "longer speech": lambda: wav.write(entry.wav, np.tile(samples, 3)),
        "no sound": lambda: wav.write(entry.wav, 0 * samples),
        "only hum": lambda: wav.write(entry.wav, 0.9 + 1e-4 * samples),
        "empty wav": lambda: entry.wav.write_bytes(b""),
        "torn header": lambda: entry.wav.write_bytes(entry.wav.read_bytes()[:30]),
        "torn wav": lambda: wav.write(entry.wav, samples[:10]),
        "no wav": lambda: entry.wav.unlink(),
        "text for sound": lambda: entry.wav.write_text("hello"),
        "one pose": lambda: edited(entry.bvh, euler=np.repeat(clip.euler[:1], 30, axis=0)),
        "few frames": lambda: (
            edited(entry.bvh, euler=clip.euler[:7], positions=clip.positions[:7]),
            wav.write(entry.wav, samples[:1867]),
        ),
        "nan": lambda: entry.bvh.write_text(text[: text.index("Frame Time")] + "Frame Time: 0.016667\n" + "nan " * 27),
        "empty bvh": lambda: entry.bvh.write_text(""),
        "torn bvh": lambda: entry.bvh.write_text(text[:-40]),
        "torn hierarchy": lambda: entry.bvh.write_text(text[:200]),
        "binary bvh": lambda: entry.bvh.write_bytes(b"\0\1\2" * 99),
        "no bvh": lambda: entry.bvh.unlink(),
        "transcript": lambda: note.write_text('{"words": ['),
        "latin transcript": lambda: note.write_bytes("für".encode("latin-1")),
    }
    changes[case]()
    return entry._replace(transcript=note if note.exists() else None)


CASES = {
    "longer speech": r"a\.bvh' lasts 0\.50 s and 'a\.wav' 1\.50 s.* cut them",
    "no sound": r"a\.wav' has no speech \(its loudest part is digital silence\)",
    "only hum": r"a\.wav' has no speech \(its loudest part is -\d+ dB\)",
    "empty wav": r"a\.wav' is not an audio file",
    "torn header": r"a\.wav'",
    "torn wav": r"a\.wav'",
    "no wav": r"a\.wav' does not exist",
    "text for sound": r"a\.wav' is not an audio file",
    "one pose": r"a\.bvh' holds one pose that never moves",
    "few frames": r"a\.bvh' has 7 usable frames, 8 are needed; leave it out",
    "nan": r"a\.bvh'",
    "empty bvh": r"'a\.bvh' is empty",
    "torn bvh": r"a\.bvh' ",
    "torn hierarchy": r"a\.bvh' has a HIERARCHY but no MOTION",
    "binary bvh": r"a\.bvh' is not a BVH file",
    "no bvh": r"no BVH file .*a\.bvh'",
    "transcript": r"a\.json' is not JSON .*; mend or remove it",
    "latin transcript": r"a\.json' is not JSON .*; mend or remove it",
}


@pytest.mark.parametrize("case", CASES)
def test_it_is_refused_in_one_sentence(entry, case):
    with pytest.raises((ValueError, OSError), match=CASES[case]) as caught:
        list(takes(spoil(entry, case)))
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize("kind", [RuntimeError, MemoryError, ZeroDivisionError, IndexError, TypeError])
def test_whatever_a_reader_raises(entry, monkeypatch, kind):
    def fail(*_):
        raise kind("x\ny")

    monkeypatch.setattr(rooms.wav, "read", fail)
    with pytest.raises(ValueError, match=r"a\.wav' is damaged and does not read \(x y\); export it again\.$"):
        list(takes(entry))


def test_a_file_that_may_not_be_read(entry, monkeypatch):
    def fail(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(rooms.bvh, "read", fail)
    with pytest.raises(OSError, match=r"a\.bvh' cannot be read: Permission denied; check the file\.$"):
        list(takes(entry))


@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 4000), st.binary(min_size=1, max_size=8), st.booleans())
def test_bytes_gone_wrong_anywhere(entry, at, bad, motion):
    """Either the take is still one, or a sentence that ends in a full stop."""
    add_pair(entry.bvh.parent, "a", 30)
    path = entry.bvh if motion else entry.wav
    data = path.read_bytes()
    at = at % len(data)
    path.write_bytes(data[:at] + bad + data[at + len(bad) :])
    told = ""
    try:
        (take,) = takes(entry, centre=False)
    except (ValueError, OSError) as error:
        told = str(error)
    else:
        assert np.isfinite(take.clip.positions).all()
    assert "\n" not in told
    assert not told or "a." in told


def test_more_frames_can_be_asked_for(entry):
    with pytest.raises(ValueError, match="has 30 usable frames, 60 are needed"):
        list(takes(entry, min_frames=60))


def test_a_good_transcript_is_no_problem(entry):
    note = entry.bvh.with_suffix(".json")
    note.write_text(json.dumps({"text": "hello"}))
    assert len(list(takes(entry._replace(transcript=note)))) == 1


def test_the_body_is_that_of_the_first_clip_that_tells(entry):
    broken = entry._replace(bvh=entry.bvh.with_name("gone.bvh"))
    found = body_of([broken, entry], BodyConfig())
    assert (found.scale, found.up, found.facing, found.axes, found.lead) == (1.0, "y", "z", (), False)
    assert found.roles is not None
    assert found.roles.hips == "Hips"
    assert body_of([broken], BodyConfig()) == BodyConfig()
    assert body_of([entry], BodyConfig(), as_released=True).scale == 1.0


def test_as_released_changes_no_body_unless_told(entry):
    clip = bvh.read(entry.bvh)
    edited(entry.bvh, positions=clip.positions / 100)
    (take,) = takes(entry, centre=False, as_released=True)
    np.testing.assert_allclose(take.clip.positions[:, 0], clip.positions[:, 0] / 100, atol=1e-6)
    (take,) = takes(entry, centre=False, as_released=True, body=BodyConfig(scale=100.0))
    np.testing.assert_allclose(take.clip.positions[:, 0], clip.positions[:, 0], atol=1e-3)
