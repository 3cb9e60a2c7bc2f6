"""Motion capture from elsewhere, where it is at hand: it reads, encodes and comes back."""

from pathlib import Path

import jax
import numpy as np
import pytest

from zeggs_jax.motion import bvh, edit, features

DATA = Path(__file__).parents[3] / "shared" / "data"  # licensed files, never in the repository
FILES = sorted(DATA.rglob("*.bvh"))
ONE_OF_EACH = [path for path in FILES if "dataset" not in path.name or "bye_active" in path.name]

if not FILES:
    pytest.skip("no motion capture at hand", allow_module_level=True)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_reads_and_writes(path):
    clip = bvh.read(path)
    assert bvh.rate_hz(clip.frame_time) in (30, 60, 120)
    back = bvh.parse(bvh.format(clip, translations=True))
    np.testing.assert_allclose(back.euler, clip.euler, atol=1e-7)
    assert back.skeleton.names == clip.skeleton.names


@pytest.mark.parametrize("path", ONE_OF_EACH, ids=lambda path: path.name)
def test_encodes_and_comes_back(path):
    clip = edit.trim(bvh.read(path), 0, 150)
    motion = features.encode(clip)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(motion))
    back = features.decode(motion.pose, clip.skeleton, clip.frame_time, rebase=False, offsets="per_frame")
    size = np.abs(clip.positions).max()
    np.testing.assert_allclose(
        features.world_positions(back), features.world_positions(clip), atol=1e-5 * size
    )


def test_the_zeggs_body_is_the_reference():
    from zeggs_jax.motion.skeleton import REFERENCE_NAMES, REFERENCE_PARENTS

    found = [path for path in FILES if path.name.startswith("067_Speech")]
    if not found:
        pytest.skip("the ZEGGS clip is not at hand")
    skeleton = bvh.read(found[0]).skeleton
    assert (skeleton.names, skeleton.parents) == (REFERENCE_NAMES, REFERENCE_PARENTS)
