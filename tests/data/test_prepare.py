"""Prepared corpora: what goes in comes out, statistics are those of the arrays, bad clips are named."""

import json
import shutil

import numpy as np
import pytest

from zeggs_jax.data import augment
from zeggs_jax.data.prepare import PrepareConfig, Prepared, load, prepare
from zeggs_jax.data.scale import fit_columns
from zeggs_jax.data.windows import Piece
from zeggs_jax.motion import bvh, features
from zeggs_jax.motion.pose import to_vector
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import wav

from .conftest import NAMES, add_pair, make_clip


def test_clips_lie_one_after_the_other(prepared: Prepared):
    assert prepared.names == ("angry/a", "calm/a", "calm/b", "calm/c", "calm/d", "old/x")
    assert prepared.styles == ("angry", "calm", "old")
    assert prepared.labels.tolist() == [0, 1, 1, 1, 1, 2]
    assert prepared.splits == ("train", "train", "train", "train", "valid", "train")
    assert np.diff(prepared.ranges, axis=1)[:, 0].tolist() == [62, 40, 55, 30, 45, 26]
    assert prepared.ranges[0, 0] == 0
    np.testing.assert_array_equal(prepared.ranges[1:, 0], prepared.ranges[:-1, 1])
    assert prepared.speech.shape == (258, 81)
    assert prepared.pose.shape == (258, 6 + 15 * 8)


def test_arrays_are_memory_maps(prepared: Prepared):
    for array in (prepared.speech, prepared.pose, prepared.root_pos, prepared.root_rot):
        assert isinstance(array, np.memmap)
        assert array.dtype == np.float32


def test_rows_are_the_features_of_the_clip(prepared: Prepared, corpus_folder):
    """Joint and velocity features do not change by centring; speech is that of the file."""
    motion = features.encode(bvh.read(corpus_folder / "calm" / "b.bvh"))
    start, stop = prepared.ranges[prepared.names.index("calm/b")]
    np.testing.assert_allclose(prepared.pose[start:stop], to_vector(motion.pose), atol=2e-3)
    speech = speech_features.extract(wav.read(corpus_folder / "calm" / "b.wav"))
    np.testing.assert_allclose(prepared.speech[start:stop], speech, atol=1e-5)


def test_clips_start_facing_z(prepared: Prepared, corpus_folder, tmp_path):
    """To the tilt of the hips: the yaw taken away is theirs, the root turns with their forward axis."""
    first = prepared.ranges[:, 0]
    turned = prepare(corpus_folder, tmp_path / "as_they_are", PrepareConfig(centre=False))
    assert (prepared.root_rot[first, 0] > np.cos(0.15)).all()
    assert (turned.root_rot[first, 0] < np.cos(0.3)).all()
    np.testing.assert_allclose(prepared.pose, turned.pose, atol=2e-3)


def test_frames_come_back_as_poses(prepared: Prepared):
    poses = prepared.poses(slice(10, 15))
    np.testing.assert_array_equal(to_vector(poses), prepared.pose[10:15])
    np.testing.assert_array_equal(poses.root.pos, prepared.root_pos[10:15])


def test_statistics_are_those_of_the_inner_training_rows_and_their_images(prepared: Prepared):
    by = augment.mirror_of(prepared.skeleton, prepared.across)
    arrays = (prepared.speech, prepared.pose, prepared.root_pos, prepared.root_rot)
    inner = [slice(a + 2, b - 2) for i, (a, b) in enumerate(prepared.ranges) if i != 4]
    seen = [prepared.pose[rows] for rows in inner]
    images = [np.asarray(augment.mirror(Piece(*(x[rows] for x in arrays)), by).pose) for rows in inner]
    expected, scales = fit_columns([*seen, *images]), prepared.scales
    np.testing.assert_allclose(scales.pose_out.mean, expected.mean, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(scales.pose_out.std, expected.std, rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(scales.pose_in.mean[:-3], scales.pose_out.mean)
    assert (scales.pose_in.std > 0).all()
    offsets = slice(9, 6 + 3 * len(NAMES))
    np.testing.assert_array_equal(scales.pose_out.std[offsets], 0)  # they never change: the body stays the same one
    np.testing.assert_array_equal(scales.pose_out.mean[offsets], seen[0][0, offsets])
    assert scales.pose_in.mean[-3] == 0
    assert scales.pose_in.mean[-1] > 50  # people look ahead


def test_loading_gives_the_same(prepared: Prepared):
    again = load(prepared.folder)
    assert again.names == prepared.names
    assert again.skeleton.names == NAMES
    assert again.skeleton.roles == prepared.skeleton.roles
    np.testing.assert_array_equal(again.pose, prepared.pose)
    np.testing.assert_array_equal(again.scales.speech.mean, prepared.scales.speech.mean)


def test_preparing_twice_gives_the_same_bytes(prepared: Prepared, corpus_folder, tmp_path):
    prepare(corpus_folder, tmp_path / "again")
    for file in sorted(prepared.folder.glob("*.npy")):
        assert file.read_bytes() == (tmp_path / "again" / file.name).read_bytes()
    digests = [json.loads((f / "manifest.json").read_text())["sha256"] for f in (prepared.folder, tmp_path / "again")]
    assert digests[0] == digests[1]


def test_the_rate_can_be_changed(corpus_folder, tmp_path):
    slow = prepare(corpus_folder, tmp_path / "slow", PrepareConfig(rate_hz=30))
    assert bvh.rate_hz(slow.frame_time) == 30
    lengths = np.diff(slow.ranges, axis=1)[:, 0]
    np.testing.assert_allclose(lengths, [31, 20, 27.5, 15, 22.5, 13], atol=1)


def test_paced_copies_follow_each_other(corpus_folder, tmp_path):
    paced = prepare(corpus_folder, tmp_path / "paced", PrepareConfig(pace=(0.9, 1.0)))
    assert paced.names[:2] == ("angry/a_x_0_9", "angry/a_x_1_0")
    assert np.diff(paced.ranges, axis=1)[:2, 0].tolist() == [55, 62]


def test_trimmed_clips_are_written_on_request(corpus_folder, tmp_path):
    prepare(corpus_folder, tmp_path / "out", PrepareConfig(save_trimmed=True))
    assert len(bvh.read(tmp_path / "out" / "trimmed" / "valid" / "calm" / "d.bvh").euler) == 45
    ours, given = (folder / "calm" / "d.wav" for folder in (tmp_path / "out" / "trimmed" / "valid", corpus_folder))
    np.testing.assert_array_equal(wav.read(ours), wav.read(given))


def test_longer_speech_or_motion_is_cut(tmp_path):
    add_pair(tmp_path / "c", "a", 60)
    wav.write(tmp_path / "c" / "a.wav", 0.1 * np.random.default_rng(0).normal(size=20000))
    add_pair(tmp_path / "c", "b", 60)
    wav.write(tmp_path / "c" / "b.wav", 0.1 * np.random.default_rng(0).normal(size=12000))
    assert np.diff(prepare(tmp_path / "c", tmp_path / "out").ranges, axis=1)[:, 0].tolist() == [60, 45]


def _spoil(folder, case):
    path = folder / "calm" / "c"
    if case == "lengths":
        wav.write(path.with_suffix(".wav"), np.ones(32000) * 0.1)
    elif case == "short":
        add_pair(folder, "calm/c", 7)
    elif case == "skeleton":
        bvh.write(path.with_suffix(".bvh"), make_clip(30, names=(*NAMES[:7], "Tail")))
    elif case == "fewer joints":
        bvh.write(path.with_suffix(".bvh"), make_clip(30, names=NAMES[:7]))
    elif case == "rate":
        add_pair(folder, "calm/c", 30, rate_hz=30)
    elif case == "nan":
        text = path.with_suffix(".bvh").read_text().splitlines()
        path.with_suffix(".bvh").write_text("\n".join([*text[:-1], "nan " + text[-1].split(" ", 1)[1]]))
    elif case == "sound":
        path.with_suffix(".wav").write_text("no sound")


@pytest.mark.parametrize(
    ("case", "words"),
    [("lengths", r"0\.50 s.*2\.00 s"), ("short", "7 .*frames"),
     ("skeleton", "first different joint: 'RightFoot'"),
     ("fewer joints", "7 joints.*first different joint: 'RightFoot'"), ("rate", "30 frames a second.*--rate"),
     ("nan", "(?i)nan"), ("sound", "not an audio file")],
)  # fmt: skip
def test_a_bad_clip_is_named_in_one_sentence(corpus_folder, tmp_path, case, words):
    _spoil(corpus_folder, case)
    with pytest.raises(ValueError, match=words) as caught:
        prepare(corpus_folder, tmp_path / "out")
    message = str(caught.value)
    assert ("c.bvh" in message) or ("c.wav" in message)
    assert "\n" not in message
    with pytest.raises(FileNotFoundError, match="manifest"):
        load(tmp_path / "out")


def test_a_corpus_needs_training_clips(tmp_path):
    add_pair(tmp_path / "c", "a", 40)
    (tmp_path / "c" / "corpus.csv").write_text("name,style,split\na,calm,valid\n")
    with pytest.raises(ValueError, match="'valid'"):
        prepare(tmp_path / "c", tmp_path / "out")


@pytest.mark.parametrize("file", ["manifest.json", "pose.npy", "scales.npz"])
def test_a_damaged_folder_is_refused(prepared: Prepared, tmp_path, file):
    folder = shutil.copytree(prepared.folder, tmp_path / "copy")
    (folder / file).write_bytes((folder / file).read_bytes()[:100])
    with pytest.raises(ValueError, match="is damaged") as caught:
        load(folder)
    assert "\n" not in str(caught.value)
