"""The encoder of parts: which joint is in which part on any body, and that a slice knows of its part alone."""

import jax
import numpy as np
import pytest

from zeggs_jax.motion.names import Roles
from zeggs_jax.motion.skeleton import REFERENCE_NAMES, REFERENCE_PARENTS, Skeleton
from zeggs_jax.zeroeggs import encoders
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs import parts_encoder as parts

REFERENCE = Skeleton(REFERENCE_NAMES, REFERENCE_PARENTS, np.zeros((75, 3)))
CMU_LIKE = Skeleton(  # the arms leave below the neck, the legs from a joint below the hips
    ("Hips", "Pelvis", "LeftUpLeg", "LeftFoot", "RightUpLeg", "RightFoot", "Spine", "Spine1", "Spine2", "Neck", "Head",
     "LeftArm", "LeftHand", "LeftThumb", "RightArm", "RightHand", "Tail"),
    (-1, 0, 1, 2, 1, 4, 0, 6, 7, 8, 9, 7, 11, 12, 7, 14, 0), np.zeros((17, 3)),
)  # fmt: skip

THREE = Skeleton(("Hips", "Spine", "Head", "LeftHand"), (-1, 0, 1, 1), np.zeros((4, 3)))  # trunk, head, left arm


def joints_of(skeleton, part):
    return {name for name, of in zip(skeleton.names, parts.of_joints(skeleton), strict=True) if of == part}


def test_parts_of_the_zeggs_body():
    assert joints_of(REFERENCE, "trunk") == {"Hips", "Spine", "Spine1", "Spine2", "Spine3"}
    assert joints_of(REFERENCE, "head") == {"Neck", "Neck1", "Head", "HeadEnd"}
    for side in ("left", "right"):
        arm = joints_of(REFERENCE, f"{side}_arm")
        assert len(arm) == 26
        assert all(name.startswith(side.title()) for name in arm)
        assert {f"{side.title()}Shoulder", f"{side.title()}HandPinky4"} <= arm
    assert len(joints_of(REFERENCE, "legs")) == 14


def test_parts_of_another_body():
    assert joints_of(CMU_LIKE, "trunk") == {"Hips", "Pelvis", "Spine", "Spine1", "Spine2", "Tail"}
    assert joints_of(CMU_LIKE, "head") == {"Neck", "Head"}
    assert joints_of(CMU_LIKE, "left_arm") == {"LeftArm", "LeftHand", "LeftThumb"}
    assert joints_of(CMU_LIKE, "right_arm") == {"RightArm", "RightHand"}
    assert joints_of(CMU_LIKE, "legs") == {"LeftUpLeg", "LeftFoot", "RightUpLeg", "RightFoot"}


def test_an_upper_body_has_no_legs_and_roles_can_be_given():
    names, parents = ("a", "b", "c", "d", "e"), (-1, 0, 1, 1, 1)
    roles = Roles(hips="a", spine="b", head="c", left_hand="d", right_hand="e")
    bust = Skeleton(names, parents, np.zeros((5, 3)), roles)
    assert parts.of_joints(bust) == ("trunk", "trunk", "head", "left_arm", "right_arm")
    config = fit(bust, size=6)
    assert parts.slices(config) == {"trunk": (0, 2), "head": (2, 4), "left_arm": (4, 5), "right_arm": (5, 6)}


@pytest.mark.parametrize("skeleton", [REFERENCE, CMU_LIKE], ids=["zeggs", "other"])
def test_every_column_of_the_pose_belongs_to_one_part(skeleton):
    of = parts.of_joints(skeleton)
    found = np.concatenate([parts.columns(of, part) for part in parts.PARTS])
    np.testing.assert_array_equal(np.sort(found), np.arange(6 + 15 * len(skeleton)))
    assert set(range(6)) <= set(parts.columns(of, "trunk").tolist())


def fit(skeleton, **sizes):
    return parts.PARTS_ENCODER.fit(m.StyleEncoderConfig("parts", hidden=6, **sizes), skeleton)


def test_a_slice_is_made_of_its_part_alone():
    """Every other column changed: not a bit of the slice is. Its own columns changed: all of it is."""
    config = fit(THREE, size=7)
    inputs = 6 + 15 * len(THREE) + 3
    shapes = jax.eval_shape(lambda: parts.PARTS_ENCODER.init(jax.random.key(0), config, inputs))
    rng = np.random.default_rng(0)
    params = jax.tree.map(lambda a: (rng.normal(size=a.shape) / a.shape[-1] ** 0.5).astype(np.float32), shapes)
    run = jax.jit(lambda x: parts.PARTS_ENCODER.apply(params, config, x, 6, None, "float32"))
    one, other = rng.normal(size=(2, 6, inputs)).astype(np.float32)
    for part, (start, stop) in parts.slices(config).items():
        own = np.isin(np.arange(inputs), parts.columns(config.parts, part))
        others = run(np.where(own, one, other)), run(np.where(own, other, one))
        for ours, kept, changed in zip(run(one), *others, strict=True):
            np.testing.assert_array_equal(kept[start:stop], ours[start:stop])
            assert (changed[start:stop] != ours[start:stop]).all()
            assert (np.delete(kept, range(start, stop)) != np.delete(ours, range(start, stop))).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda: fit(REFERENCE, size=4), "4 numbers for 5 parts"),
        (lambda: fit(Skeleton(("x", "y"), (-1, 0), np.zeros((2, 3))), size=4), "all 2 joints .* are in one; name its"),
        (lambda: init(()), "parts of 0 joints .* training fills them in"),
        (lambda: init(("trunk",) * 4), "parts of 4 joints"),
        (lambda: init(("trunk", "head", "tail", "legs", "legs")), "'tail'; parts are trunk, head"),
    ],
)
def test_what_does_not_fit_is_one_sentence(change, says):
    with pytest.raises(ValueError, match=says):
        change()


def init(of):
    return parts.PARTS_ENCODER.init(jax.random.key(0), m.StyleEncoderConfig("parts", hidden=4, size=8, parts=of), 84)


def test_models_of_the_parts_count_their_parameters():
    config = m.ZeroEggsConfig(style=fit(REFERENCE, size=64))
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))["style"]
    assert set(shapes) == {*parts.PARTS, *(f"{part}_slice" for part in parts.PARTS)}
    assert shapes["head"]["encoder"]["conv0"]["weight"].shape == (3, 60, 3)


@pytest.mark.parametrize("size", [5, 7, 64])
def test_any_number_of_numbers_is_shared_out(size):
    edges = [edge for cut in parts.slices(fit(REFERENCE, size=size)).values() for edge in cut]
    assert (edges[0], edges[-1]) == (0, size)
    assert edges[1:-1:2] == edges[2::2]


def test_without_sampling_the_slices_are_the_style():
    config = fit(THREE, size=7, variational=False)
    jax.eval_shape(lambda: encoders.init(jax.random.key(0), config, 69))  # looks at what comes out
