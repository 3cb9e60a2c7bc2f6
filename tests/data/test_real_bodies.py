"""Motion capture from elsewhere, where it is at hand: human size, upright, hips and head ahead."""

from pathlib import Path

import numpy as np
import pytest

from zeggs_jax.data.body import BodyConfig, normalise, resolve
from zeggs_jax.motion import bvh, edit, features

CMU = 2.54 / 0.45
FILES = {  # name in data/: scale, whether the frames of joints change, height of the head joint (cm)
    "motion_CMU_clean/cmu_131_01.bvh": (CMU, False, (120, 140)),
    "motion_CMU_clean/cmu_indian_13.bvh": (1.0, False, (125, 145)),
    "motion_NC/dataset-1_bye_old_001.bvh": (1.0, True, (110, 150)),
    "motion_NC/genea2023_sample1.bvh": (1.0, False, (125, 155)),
    "zeggs_NC-ND/067_Speech_2_x_1_0.30fps.tposeframes.bvh": (1.0, False, (140, 165)),
}


@pytest.mark.parametrize("name", FILES)
def test_it_stands_as_the_features_expect(shared, name):
    path: Path = shared / "data" / name
    if not path.exists():
        pytest.skip(f"{name} is not at hand")
    clip = bvh.read(path)
    clip = edit.trim(clip, 0, min(200, len(clip.euler)))
    scale, turned, (low, high) = FILES[name]
    config = resolve(clip, BodyConfig(), name)
    assert (config.scale, config.up, bool(config.axes)) == (pytest.approx(scale), "y", turned)
    clip = normalise(clip, BodyConfig(), name)
    places, axes = features.world_frames(clip)
    role = clip.skeleton.role
    assert low < np.median(places[:, role("head"), 1]) < high
    across = (places[:, role("left_foot")] - places[:, role("right_foot")]).mean(axis=0)
    ahead = np.cross(across, [0.0, 1.0, 0.0])
    for joint in ("hips", "head"):
        looks = axes[:, role(joint), :, 2].mean(axis=0)
        assert looks @ ahead > 0.5 * np.linalg.norm(looks) * np.linalg.norm(ahead), joint
    assert clip.skeleton.asymmetry() < 0.2
    assert len(clip.skeleton.mirror_map()) == len(clip.skeleton)
    written = features.world_positions(bvh.parse(bvh.format(clip)))  # only joint 0 keeps its translation
    hips = role("hips")
    np.testing.assert_allclose(written[:, hips], places[:, hips], atol=1e-3)
