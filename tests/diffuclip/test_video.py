"""Video files: what is written is read again, stretches of long ones, files that are no videos."""

import sys

import numpy as np
import pytest

from zeggs_jax.diffuclip import video


@pytest.fixture
def av():
    return pytest.importorskip("av")


def film(seconds, height, width, hz=10):
    """Black to red over time; a green square in the middle."""
    images = np.zeros((int(seconds * hz), height, width, 3))
    images[..., 0] = np.linspace(0, 1, len(images))[:, None, None]
    images[:, height // 2 - 8 : height // 2 + 8, width // 2 - 8 : width // 2 + 8] = (0, 1, 0)
    return images


def test_a_video_is_read_as_it_was_written(av, tmp_path):
    video.write(tmp_path / "a.mp4", film(4, 64, 64), 10)
    found = video.read(tmp_path / "a.mp4", 5, 32)
    assert found.shape == (1, 5, 32, 32, 3)
    assert (found >= 0).all()
    assert (found <= 1).all()
    np.testing.assert_allclose(found[0, :, 2, 2, 0], [0, 0.25, 0.5, 0.75, 1], atol=0.06)
    np.testing.assert_allclose(found[0, :, 16, 16, 1], 1.0, atol=0.06)
    assert list(tmp_path.iterdir()) == [tmp_path / "a.mp4"]


def test_a_long_video_comes_in_stretches(av, tmp_path):
    video.write(tmp_path / "a.mp4", film(18, 32, 32), 10)
    found = video.read(tmp_path / "a.mp4", 4, 16)
    assert found.shape[:2] == (3, 4)
    assert (np.diff(found[:, :, 1, 1, 0].ravel()) >= -0.02).all()
    assert found[2, 0, 1, 1, 0] == pytest.approx(2 / 3, abs=0.06)


def test_one_picture_is_a_video(av, tmp_path):
    video.write(tmp_path / "a.mp4", film(0.1, 32, 32), 10)
    assert video.read(tmp_path / "a.mp4", 4, 16).shape == (1, 4, 16, 16, 3)


@pytest.mark.parametrize("size", [(64, 96), (96, 64)])
def test_the_middle_of_the_picture_is_what_counts(av, tmp_path, size):
    video.write(tmp_path / "a.mp4", film(1, *size), 10)
    found = video.read(tmp_path / "a.mp4", 1, 48)[0, 0]
    np.testing.assert_allclose(found[24, 24], (0, 1, 0), atol=0.1)
    np.testing.assert_allclose(found[:, 1], found[:, -2], atol=0.1)


def test_what_is_no_video_is_told_in_one_sentence(av, tmp_path):
    with pytest.raises(FileNotFoundError, match="no video"):
        video.read(tmp_path / "none.mp4", 4, 16)
    video.write(tmp_path / "a.mp4", film(1, 32, 32), 10)
    for name, content in {"text.mp4": b"hello", "cut.mp4": (tmp_path / "a.mp4").read_bytes()[:300]}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ValueError, match=rf"{name}' is no video that can be decoded .*\.$"):
            video.read(tmp_path / name, 4, 16)
    with pytest.raises(ValueError, match="even sizes"):
        video.write(tmp_path / "odd.mp4", np.zeros((2, 31, 32, 3)), 10)


def test_sound_alone_is_no_video(av, tmp_path):
    import soundfile

    soundfile.write(tmp_path / "a.wav", np.zeros(8000), 16000)
    with pytest.raises(ValueError, match="has no pictures"):
        video.read(tmp_path / "a.wav", 4, 16)


def test_without_the_package(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ValueError, match=r"pip install 'zeggs-jax\[video\]'"):
        video.read(tmp_path / "a.mp4", 4, 16)
