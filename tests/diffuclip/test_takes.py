"""The takes of a corpus: what is read of each clip, what is kept of a stopped reading, what does not fit."""

import json
import shutil

import numpy as np
import pytest

from zeggs_jax.diffuclip import representation, takes
from zeggs_jax.motion import bvh
from zeggs_jax.motion.skeleton import Skeleton


@pytest.fixture
def own(corpus, tmp_path):
    """A copy of the corpus that may be spoilt."""
    return shutil.copytree(corpus, tmp_path / "corpus")


@pytest.fixture(scope="module")
def read(corpus, tiny, tmp_path_factory):
    """(where they are kept, the takes, their skeleton)."""
    out = tmp_path_factory.mktemp("run")
    found, skeleton, _ = takes.gather(corpus, out, tiny, 1)
    return out, found, skeleton


def test_every_clip_is_a_take_of_whole_latents(read, corpus, tiny):
    _, found, skeleton = read
    assert [take.name for take in found] == [f"clip{k}" for k in range(4)]
    assert [take.split for take in found] == ["train"] * 3 + ["valid"]
    assert len(skeleton) == tiny.joints
    for take in found:
        clip = bvh.read(corpus / f"{take.name}.bvh")
        np.testing.assert_allclose(take.motion, representation.encode(clip)[:120], atol=1e-4)
        assert take.rhythm.shape == (30, 2)
        assert np.isfinite(take.rhythm).all()


def test_words_and_captions_are_the_transcripts_and_a_label_makes_a_caption(read):
    first, second = read[1][:2]
    assert [word.text for word in first.words[:4]] == ["word0", "word1", "word2", "word3."]
    np.testing.assert_allclose(first.words[1].start, 0.5, atol=1e-6)
    assert first.captions == ("bent and slow", "an old person")
    assert second.captions == ("the person is happy",)


def test_what_was_read_is_kept_and_what_was_not_is_read_again(read, corpus, tiny, monkeypatch):
    out, before, _ = read
    files = sorted((out / takes.FOLDER).iterdir())
    assert len(files) == 4
    made = []
    make = takes._make
    monkeypatch.setattr(takes, "_make", lambda job: (made.append(job.entry.name), make(job)))
    files[0].unlink()
    again, _, _ = takes.gather(corpus, out, tiny, 1)
    assert len(made) == 1
    for a, b in zip(before, again, strict=True):
        assert (a.name, a.words, a.captions) == (b.name, b.words, b.captions)
        np.testing.assert_array_equal(a.motion, b.motion)
        np.testing.assert_array_equal(a.rhythm, b.rhythm)


def test_a_changed_transcript_makes_the_take_anew(read, own, tiny):
    notes = json.loads((own / "clip1.json").read_text())
    (own / "clip1.json").write_text(json.dumps(notes | {"captions": ["lively"]}))
    out, before, _ = read
    again, _, _ = takes.gather(own, out, tiny, 1)
    assert [take.captions for take in again] == [before[0].captions, ("lively",), *(t.captions for t in before[2:])]


def test_a_damaged_take_is_told_with_what_to_delete(corpus, tiny, tmp_path):
    takes.gather(corpus, tmp_path, tiny, 1)
    broken = sorted((tmp_path / takes.FOLDER).iterdir())[2]
    broken.write_bytes(broken.read_bytes()[:2000])
    with pytest.raises(ValueError, match=rf"{broken.name}' is damaged .*: delete it, and the same command"):
        takes.gather(corpus, tmp_path, tiny, 1)
    broken.unlink()
    assert len(takes.gather(corpus, tmp_path, tiny, 1)[0]) == 4


def test_another_skeleton_is_told(own, tiny, tmp_path):
    clip = bvh.read(own / "clip2.bvh")
    skeleton = clip.skeleton
    names = tuple("Tail" if name == "LeftHandIndex1" else name for name in skeleton.names)
    bvh.write(own / "clip2.bvh", clip._replace(skeleton=Skeleton(names, skeleton.parents, skeleton.offsets)))
    with pytest.raises(ValueError, match=r"clip2\.bvh' has another skeleton than 'clip0\.bvh'"):
        takes.gather(own, tmp_path / "run", tiny, 1)


def test_a_corpus_without_training_clips_is_told(own, tiny, tmp_path):
    table = (own / "corpus.csv").read_text()
    (own / "corpus.csv").write_text(table.replace(",train", ",valid"))
    with pytest.raises(ValueError, match="has no clip of the split 'train'"):
        takes.gather(own, tmp_path / "run", tiny, 1)


def test_a_clip_without_a_transcript_has_no_words(own, tiny, tmp_path):
    (own / "clip1.json").unlink()
    (own / "clip2.json").unlink()
    (own / "clip2.txt").write_text("untimed words")
    found, _, _ = takes.gather(own, tmp_path / "run", tiny, 1)
    assert [len(take.words) for take in found] == [9, 0, 0, 9]
