"""Motion capture from elsewhere, where it is at hand: it reads, encodes and comes back."""

from pathlib import Path

import jax
import numpy as np
import pytest

from zeggs_jax.motion import bvh, edit, features


@pytest.fixture(scope="module")
def files(shared) -> list[Path]:
    """Licensed files, never in the repository."""
    found = sorted((shared / "data").rglob("*.bvh"))
    if not found:
        pytest.skip("no motion capture at hand")
    return found


def test_all_read_and_write(files):
    for path in files:
        clip = bvh.read(path)
        assert bvh.rate_hz(clip.frame_time) in (30, 60, 120), path
        back = bvh.parse(bvh.format(clip, translations=True))
        np.testing.assert_allclose(back.euler, clip.euler, atol=1e-7, err_msg=path.name)
        assert back.skeleton.names == clip.skeleton.names, path


def test_one_of_each_kind_encodes_and_comes_back(files):
    for path in files:
        if "dataset" not in path.name or "bye_active" in path.name:
            encodes_and_comes_back(path)


def encodes_and_comes_back(path: Path) -> None:
    clip = edit.trim(bvh.read(path), 0, 150)
    motion = features.encode(clip)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(motion))
    back = features.decode(motion.pose, clip.skeleton, clip.frame_time, rebase=False, offsets="per_frame")
    size = np.abs(clip.positions).max()
    np.testing.assert_allclose(features.world_positions(back), features.world_positions(clip), atol=1e-5 * size)


def test_the_zeggs_body_is_the_reference(files):
    from zeggs_jax.motion.skeleton import REFERENCE_NAMES, REFERENCE_PARENTS

    found = [path for path in files if path.name.startswith("067_Speech")]
    if not found:
        pytest.skip("the ZEGGS clip is not at hand")
    skeleton = bvh.read(found[0]).skeleton
    assert (skeleton.names, skeleton.parents) == (REFERENCE_NAMES, REFERENCE_PARENTS)
