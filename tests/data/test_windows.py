"""Windows and style examples: inside their clip, around their window, the same for the same (seed, k)."""

from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zeggs_jax.data import augment
from zeggs_jax.data import windows as windows_of
from zeggs_jax.data.draws import WindowConfig, draw
from zeggs_jax.data.prepare import Prepared
from zeggs_jax.data.rows import example_rows, released_example_rows, window_count
from zeggs_jax.data.windows import Recorded, batch
from zeggs_jax.motion.pose import to_vector

AUGMENTED = WindowConfig(batch=16, window=24, example=(24, 48))
SMALL = replace(AUGMENTED, mirror=0.0, pace=0.0)
RELEASED = replace(SMALL, as_released=True)


@st.composite
def windows(draw):
    start = draw(st.integers(0, 300))
    frames = draw(st.integers(1, 200))
    size = draw(st.integers(1, frames))
    first = draw(st.integers(start, start + frames - size))
    return (first, first + size), (start, start + frames), 2 * draw(st.integers((size + 1) // 2, 300))


@given(windows())
def test_an_example_holds_its_window_and_stays_in_its_clip(case):
    window, clip, length = case
    rows = example_rows(window, clip, length)
    assert len(rows) == min(length, clip[1] - clip[0])
    assert clip[0] <= rows[0] <= window[0]
    assert window[1] - 1 <= rows[-1] < clip[1]
    np.testing.assert_array_equal(np.diff(rows), 1)


@given(windows())
def test_in_the_middle_of_a_long_clip_ours_is_the_released_one(case):
    window, _, length = case
    inside = (window[0] - length, window[1] + length)
    expected = released_example_rows(window, inside, inside[1], length)
    if (window[1] - window[0]) % 2 == 0:
        np.testing.assert_array_equal(example_rows(window, inside, length), expected)
    assert abs(len(expected) - length) <= 1


def test_the_released_example_reaches_into_the_next_clip():
    rows = released_example_rows((128, 160), (0, 160), 400, 100)
    assert (rows[0], rows[-1]) == (61, 160)


def test_the_released_example_repeats_its_tail():
    rows = released_example_rows((0, 32), (0, 81), 402, 128)
    np.testing.assert_array_equal(rows, [*range(82), *range(36, 82)])


def test_windows_of_a_clip():
    ranges = np.array([[0, 10], [10, 14], [14, 17]], np.int32)
    assert window_count(ranges, 4).tolist() == [7, 1, 0]
    assert window_count(ranges, 4, as_released=True).tolist() == [6, 0, 0]


@pytest.mark.parametrize("config", [SMALL, AUGMENTED], ids=["plain", "augmented"])
def test_a_batch_is_a_function_of_seed_and_number(prepared: Prepared, config):
    first, again, other, seed = (batch(prepared, s, k, config) for s, k in ((3, 7), (3, 7), (3, 8), (4, 7)))
    jax.tree.map(np.testing.assert_array_equal, first, again)
    for different in (other, seed):
        assert not np.array_equal(jax.tree.leaves(first)[0], jax.tree.leaves(different)[0])


@pytest.mark.parametrize("split", ["train", "valid"])
@pytest.mark.parametrize("config", [SMALL, AUGMENTED, RELEASED], ids=["plain", "augmented", "released"])
def test_shares_put_together_are_the_batch(prepared: Prepared, split, config):
    for k in (0, 5):
        whole = batch(prepared, 2, k, config, split)
        for count in (1, 2, 4):
            parts = [batch(prepared, 2, k, config, split, (i, count)) for i in range(count)]
            assert {len(part.label) for part in parts} == {16 // count}
            assert {type(part) for part in parts} == {type(whole)}
            jax.tree.map(lambda x, *xs: np.testing.assert_array_equal(np.concatenate(xs), x), whole, *parts)


def test_what_is_gathered_on_the_device_is_what_is_copied(prepared: Prepared):
    packed = windows_of.pack(prepared)
    for k in range(4):
        copied, located = (batch(prepared, 2, k, AUGMENTED, share=(1, 2), resident=which) for which in (False, True))
        assert isinstance(located.piece, windows_of.Located)
        assert (located.piece.row == len(prepared.pose)).any()
        filled = located._replace(piece=windows_of.gather(packed, located.piece))
        jax.tree.map(np.testing.assert_array_equal, filled, copied)


def test_plain_windows_are_gathered_as_they_are(prepared: Prepared):
    packed, plain, located = (
        windows_of.pack(prepared),
        *(batch(prepared, 2, 1, SMALL, resident=r) for r in (False, True)),
    )
    filled = located._replace(piece=windows_of.gather(packed, located.piece))
    made = jax.vmap(partial(augment.augment, by=None, window=SMALL.window, frame_time=1 / 60))(filled)
    jax.tree.map(np.testing.assert_array_equal, made, plain)
    with pytest.raises(TypeError, match="gathered first"):
        augment.augment(jax.tree.map(lambda a: a[0], located), None, SMALL.window, 1 / 60)
    with pytest.raises(ValueError, match="released are not gathered"):
        batch(prepared, 2, 1, RELEASED, resident=True)


@pytest.mark.parametrize("share", [(2, 2), (-1, 2), (0, 3), (0, 0)])
def test_a_share_that_is_none_is_refused(prepared: Prepared, share):
    with pytest.raises(ValueError, match=f"Share {share[0]} of {share[1]} of a batch of 16"):
        batch(prepared, 0, 0, SMALL, share=share)


def test_a_share_reads_its_own_rows_only(prepared: Prepared, monkeypatch):
    made = []
    rows = windows_of.example_rows
    monkeypatch.setattr(windows_of, "example_rows", lambda *around: made.append(around[0][0]) or rows(*around))
    batch(prepared, 0, 0, AUGMENTED, share=(1, 4))
    assert sorted(made) == sorted(draw(prepared, 0, 0, AUGMENTED, "train").first[4:8])


def test_shapes_depend_on_the_config_alone(prepared: Prepared):
    for config in (SMALL, AUGMENTED, replace(AUGMENTED, mirror=0.0), replace(AUGMENTED, pace=0.0)):
        assert len({str(jax.tree.map(np.shape, batch(prepared, 0, k, config))) for k in range(5)}) == 1
    one = batch(prepared, 0, 0, SMALL)
    assert one.speech.shape == (16, 24, 81)
    assert one.poses.joint_axes.shape == (16, 24, 8, 2, 3)
    assert one.example.shape == (16, 48, 126)
    assert all(leaf.dtype in (np.float32, np.int32) for leaf in jax.tree.leaves(one))


@pytest.mark.parametrize("split", ["train", "valid"])
def test_windows_are_frames_of_one_clip_with_its_label_and_example(prepared: Prepared, split):
    rows = {row.tobytes(): i for i, row in enumerate(np.asarray(prepared.pose))}
    for k in range(4):
        b = batch(prepared, 1, k, SMALL, split)
        vectors = np.asarray(to_vector(b.poses))
        for i in range(SMALL.batch):
            window = [rows[row.tobytes()] for row in vectors[i]]
            np.testing.assert_array_equal(np.diff(window), 1)
            clip = next(c for c, (s, e) in enumerate(prepared.ranges) if s <= window[0] and window[-1] < e)
            assert prepared.splits[clip] == split
            assert prepared.labels[clip] == b.label[i]
            np.testing.assert_array_equal(b.gaze[i], prepared.gaze[clip])
            np.testing.assert_array_equal(b.speech[i], prepared.speech[window])
            np.testing.assert_array_equal(b.poses.root.rot[i], prepared.root_rot[window])
            example = [rows[row.tobytes()] for row in b.example[i, : b.example_length[i]]]
            assert set(window) <= set(example)
            assert prepared.ranges[clip, 0] <= example[0]
            assert example[-1] < prepared.ranges[clip, 1]
            np.testing.assert_array_equal(b.example[i, b.example_length[i] :], 0)


@pytest.mark.parametrize("changed", [{}, {"mirror": 0.0}, {"pace": 0.0}], ids=["both", "paced", "mirrored"])
def test_augmented_are_the_windows_that_were_recorded(prepared: Prepared, changed):
    """Examples hold their windows; what is heard is the speech of the clip, at the pace that was drawn."""
    config = replace(AUGMENTED, **changed)
    by = augment.mirror_of(prepared.skeleton, prepared.across)
    step = jax.jit(jax.vmap(partial(augment.augment, by=by, window=24, frame_time=prepared.frame_time)))
    for k in range(3):
        drawn, recorded = draw(prepared, 1, k, config, "train"), batch(prepared, 1, k, config)
        assert isinstance(recorded, Recorded)
        b = step(recorded)
        assert b.example.shape == (16, 48, 126)
        vectors = np.asarray(to_vector(b.poses))
        for i, clip in enumerate(drawn.clip):
            start, length = recorded.start[i], recorded.length[i]
            np.testing.assert_allclose(vectors[i], b.example[i, start : start + 24], rtol=1e-5, atol=1e-5)
            np.testing.assert_array_equal(b.example[i, length:], 0)
            first, stop = prepared.ranges[clip]
            at = (drawn.first[i] - first + np.arange(24)) * drawn.pace
            assert at[-1] <= stop - first - 1 + 1e-6
            heard = [np.interp(at, np.arange(stop - first), column) for column in prepared.speech[first:stop].T]
            np.testing.assert_allclose(b.speech[i], np.transpose(heard), atol=1e-4)
            side = -1 if drawn.mirrored[i] else 1
            np.testing.assert_array_equal(b.gaze[i], prepared.gaze[clip] * np.array([side, 1, 1], np.float32))
            x = np.interp(at, np.arange(stop - first), prepared.root_pos[first:stop, 0])
            np.testing.assert_allclose(b.poses.root.pos[i, :, 0], side * x, atol=1e-3)
            assert (drawn.mirrored.any(), drawn.pace != 1) == ("mirror" not in changed, "pace" not in changed)


def test_every_window_and_length_is_drawn(prepared: Prepared):
    """Short clips count by their windows; lengths are even, shorter only where the clip is."""
    lengths, labels = [], []
    for k in range(60):
        b = batch(prepared, 0, k, SMALL)
        lengths += b.example_length.tolist()
        labels += b.label.tolist()
    assert set(lengths) >= set(range(24, 49, 2))
    share = window_count(prepared.ranges[[0, 1, 2, 3, 5]], 24)
    expected = np.array([share[0], share[1:4].sum(), share[4]]) / share.sum()
    np.testing.assert_allclose(np.bincount(labels) / len(labels), expected, atol=0.05)


def test_as_released_one_length_for_all_and_the_shortest_first(prepared: Prepared):
    config = WindowConfig(batch=8, window=20, example=(20, 24), as_released=True)
    assert batch(prepared, 0, 0, config).example_length.tolist() == [20] * 8
    for k in range(1, 5):
        lengths = batch(prepared, 0, k, config).example_length
        assert len(set(lengths.tolist())) == 1


def test_no_window_fits(prepared: Prepared):
    with pytest.raises(ValueError, match=r"window of 100 frames, the longest has 62"):
        batch(prepared, 0, 0, WindowConfig(batch=2, window=100, example=(100, 200)))
    with pytest.raises(ValueError, match="No test clip"):
        batch(prepared, 0, 0, SMALL, "test")


@pytest.mark.parametrize("wrong", [{"window": 300}, {"example": (255, 512)}, {"example": (512, 256)}, {"batch": 0}])
def test_a_config_that_does_not_fit_is_refused(wrong):
    with pytest.raises(ValueError, match="do not fit"):
        WindowConfig(**wrong)


def test_a_clip_shorter_than_the_longest_example_is_padded(prepared: Prepared):
    """Paper sizes on one clip of 300 frames."""
    frames, width = 300, 6 + 15 * 75
    random = np.random.default_rng(0)
    short = replace(
        prepared,
        names=("short",),
        splits=("train",),
        labels=np.zeros(1, np.int32),
        gaze=np.zeros((1, 3), np.float32),
        ranges=np.array([[0, frames]], np.int32),
        speech=random.normal(size=(frames, 81)).astype(np.float32),
        pose=random.normal(size=(frames, width)).astype(np.float32),
        root_pos=np.zeros((frames, 3), np.float32),
        root_rot=np.zeros((frames, 4), np.float32),
    )
    b = batch(short, 0, 0, WindowConfig(mirror=0.0, pace=0.0))
    assert b.example.shape == (32, 512, width)
    assert b.example_length.max() == 300
    assert (b.example_length >= 256).all()
