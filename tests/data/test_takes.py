"""Takes: time codes cut both files to the acted part, other voices are silenced, copies keep in step."""

import numpy as np
import pytest

from zeggs_jax.data.corpus import Entry, Sync
from zeggs_jax.data.takes import takes
from zeggs_jax.motion import bvh
from zeggs_jax.speech import wav

from .conftest import add_pair


@pytest.fixture
def entry(tmp_path) -> Entry:
    """One second; motion acts from frame 6 to 46, speech from 0.2 s on; somebody else speaks from 0.5 s."""
    add_pair(tmp_path, "a", 60)
    sync = Sync((0.2, 0.2 + 40 / 60), (0.1, 46 / 60), ((0.0, 0.5),))
    return Entry("a", tmp_path / "a.bvh", tmp_path / "a.wav", "calm", "train", sync)


def test_time_codes_cut_both_files(entry: Entry):
    (take,) = takes(entry, centre=False)
    whole, sound = bvh.read(entry.bvh), wav.read(entry.wav)
    np.testing.assert_array_equal(take.clip.euler, whole.euler[6:46])
    np.testing.assert_array_equal(take.wave[:4800], sound[3200:8000])


def test_other_voices_are_silenced(entry: Entry):
    (take,) = takes(entry)
    assert (take.wave[:4800] != 0).mean() > 0.99
    np.testing.assert_array_equal(take.wave[4800:], 0)


def test_paced_copies_keep_sound_and_motion_in_step(entry: Entry):
    for take, factor in zip(takes(entry, (0.9, 1.0, 0.75)), (0.9, 1.0, 0.75), strict=True):
        assert len(take.clip.euler) == int(factor * 40)
        assert abs(len(take.wave) / 16000 - len(take.clip.euler) / 60) < 1 / 60
        assert take.name == f"a_x_{factor}".replace(".", "_")


def test_the_order_of_copies_does_not_matter(entry: Entry):
    """In the release a copy after 1.0 is made from a clip that was changed in place."""
    one, other = list(takes(entry, (1.0, 0.9))), list(takes(entry, (0.9, 1.0)))
    np.testing.assert_array_equal(one[1].clip.euler, other[0].clip.euler)
    np.testing.assert_array_equal(one[0].clip.positions, other[1].clip.positions)


def test_centring_as_released_is_not_rigid(entry: Entry):
    (rigid,), (released,) = takes(entry), takes(entry, as_released=True)
    assert np.abs(rigid.clip.euler - released.clip.euler).max() > 1e-4
    np.testing.assert_array_equal(rigid.clip.euler[:, 1:], released.clip.euler[:, 1:])


def test_acting_after_the_end_is_refused(entry: Entry):
    late = entry._replace(sync=Sync((0.2, 0.5), (1.5, 1.8), ()))
    with pytest.raises(ValueError, match="'a' starts to act after"):
        list(takes(late))
