"""Skeletons: the reference hierarchy, roles by name, mirrors, and errors that name the joint."""

import itertools
import re
from dataclasses import fields

import numpy as np
import pytest

from zeggs_jax.motion.skeleton import REFERENCE_NAMES, REFERENCE_PARENTS, Roles, Skeleton, infer_roles


def skeleton(names, parents=None, **more):
    parents = parents or (-1,) + (0,) * (len(names) - 1)
    return Skeleton(tuple(names), parents, np.zeros((len(names), 3)), **more)


def test_reference_hierarchy():
    body = skeleton(REFERENCE_NAMES, REFERENCE_PARENTS)
    assert len(body) == 75
    assert len(set(body.names)) == 75
    indices = [body.role(role) for role in ("hips", "spine", "head")]
    assert indices == [0, 3, 7]
    assert [len(level) for level in body.levels()][:3] == [1, 3, 3]
    for name, parent in (
        ("LeftHandPinky4", "LeftHandPinky3"),
        ("RightToeBaseEnd", "RightToeBase"),
        ("Neck", "Spine3"),
    ):
        assert body.names[body.parents[body.index(name)]] == parent


def test_levels_hold_every_joint_once_and_parents_one_level_up():
    body = skeleton(REFERENCE_NAMES, REFERENCE_PARENTS)
    levels = body.levels()
    assert sorted(sum(levels, ())) == list(range(75))
    for above, level in itertools.pairwise(levels):
        assert {body.parents[joint] for joint in level} <= set(above)


MIXAMO = ("Hips", "Spine", "Spine1", "Spine2", "Head", "LeftHand", "RightHand", "LeftFoot", "RightFoot")
DIALECTS = {
    "ZEGGS": " ".join(REFERENCE_NAMES),
    "CMU": "Hips LHipJoint LeftFoot RHipJoint RightFoot LowerBack Spine Spine1 Neck Head LeftHand RightHand",
    "CMU by others": "Hips LeftAnkle RightAnkle lowerback Chest Chest2 Head LeftWrist lhand RightWrist rhand",
    "DAZ": "hip abdomen chest neck head leftEye rightEye rCollar rHand lCollar lHand rFoot lFoot",
    "Bandai-Namco": "joint_Root Hips Spine Chest Neck Head Hand_L Hand_R Foot_L Foot_R",
    "Mixamo": " ".join(f"mixamorig:{name}" for name in MIXAMO),
    "Unreal": "root pelvis spine_01 spine_02 spine_03 neck_01 head hand_l hand_r foot_l foot_r",
    "GENEA": "body_world b_root b_spine0 b_spine1 b_spine2 b_head b_l_wrist b_r_wrist b_l_foot b_r_foot",
}
EXPECTED = {  # hips, spine, head, left hand, right hand, left foot, right foot
    "ZEGGS": "Hips Spine2 Head LeftHand RightHand LeftFoot RightFoot",
    "CMU": "Hips Spine1 Head LeftHand RightHand LeftFoot RightFoot",
    "CMU by others": "Hips Chest2 Head lhand rhand LeftAnkle RightAnkle",
    "DAZ": "hip chest head lHand rHand lFoot rFoot",
    "Bandai-Namco": "Hips Chest Head Hand_L Hand_R Foot_L Foot_R",
    "Mixamo": " ".join(f"mixamorig:{name}" for name in MIXAMO[:1] + MIXAMO[3:]),
    "Unreal": "pelvis spine_03 head hand_l hand_r foot_l foot_r",
    "GENEA": "b_root b_spine2 b_head b_l_wrist b_r_wrist b_l_foot b_r_foot",
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_roles_are_found_by_name(dialect):
    names = tuple(DIALECTS[dialect].split())
    assert infer_roles(names) == Roles(*EXPECTED[dialect].split())


@pytest.mark.parametrize("dialect", DIALECTS)
def test_mirror_map_is_an_involution_that_swaps_sides(dialect):
    names = tuple(DIALECTS[dialect].split())
    body = skeleton(names)
    across = body.mirror_map()
    assert [across[joint] for joint in across] == list(range(len(names)))
    assert body.names[across[body.role("left_hand")]] == body.names[body.role("right_hand")]
    assert across[body.role("head")] == body.role("head")


def test_a_joint_without_counterpart_is_named():
    with pytest.raises(ValueError, match="'LeftTail' has no right counterpart"):
        skeleton(("Hips", "LeftTail")).mirror_map()


def test_a_body_whose_sides_have_no_names_has_no_mirror():
    """Else every joint would stand for itself, and a mirrored arm be its own bent the wrong way."""
    with pytest.raises(ValueError, match="No two joints"):
        skeleton(("Hips", "LA", "RA"), (-1, 0, 0)).mirror_map()


def test_joints_that_differ_only_in_a_word_for_joint_keep_their_counterparts():
    names = ("Hips", "LHipJoint", "LeftHip", "RHipJoint", "RightHip")
    assert skeleton(names).mirror_map() == (0, 3, 4, 1, 2)


def test_a_helper_on_one_side_stands_for_itself():
    """A marker that only one shoulder has does not unmake the mirror; a hand that is lost does."""
    names, parents = ("Hips", "LeftArm", "RightArm", "p_l_delt"), (-1, 0, 0, 1)
    body = skeleton(names, parents)
    assert body.alone() == [3]
    assert body.mirror_map() == (0, 2, 1, 3)
    with pytest.raises(ValueError, match="'LeftHand' has no right counterpart"):
        skeleton((*names[:3], "LeftHand"), parents).mirror_map()
    with pytest.raises(ValueError, match="'p_l_delt' has no right counterpart"):
        skeleton((*names, "Tip"), (*parents, 3)).mirror_map()


def test_asymmetry_tells_alike_sides_from_turned_ones():
    names, parents = ("Hips", "LeftArm", "RightArm", "LeftHand", "RightHand"), (-1, 0, 0, 1, 2)
    alike = np.array([[0, 90, 0], [10, 40, 0], [-10, 40, 0], [28, 1, 0], [-26, 0, 1]], float)
    turned = alike.copy()
    turned[2], turned[4] = turned[1], turned[3]  # both arms along their own +x
    assert Skeleton(names, parents, alike).asymmetry() < 0.05
    assert Skeleton(names, parents, turned).asymmetry() > 0.5
    assert skeleton(("Hips", "Tail")).asymmetry() == 0


@pytest.mark.parametrize("role", [field.name for field in fields(Roles)])
def test_a_body_of_unknown_names_is_told_good_ones(role):
    """The sentence stays short, and each name that it suggests does play the role."""
    with pytest.raises(ValueError, match=r"joints are Bone0, .*, Bone7, \.\.\. \(75 in all\)\.$") as caught:
        skeleton(tuple(f"Bone{joint}" for joint in range(75))).role(role)
    for name in re.search("such as (.*) is understood", str(caught.value))[1].split(" or "):
        assert skeleton(("Bone", name)).role(role) == 1


def test_a_missing_role_or_joint_is_named():
    body = skeleton(("Hips", "Tail"))
    with pytest.raises(ValueError, match="looks like the left hand"):
        body.role("left_hand")
    with pytest.raises(ValueError, match=r"LeftWrist is understood, its joints are Hips, Tail\.$"):
        body.role("left_hand")
    with pytest.raises(ValueError, match="no joint 'Head'; it has Hips, Tail"):
        body.index("Head")
    with pytest.raises(ValueError, match="'nose' is no role"):
        body.role("nose")
    assert skeleton(("Hips", "Tail"), roles=Roles(head="Tail")).role("head") == 1


@pytest.mark.parametrize(
    ("names", "parents", "match"),
    [
        (("A", "A"), (-1, 0), "Two joints are called 'A'"),
        (("A", "B"), (-1, 1), "'B' must come after its parent"),
        (("A", "B"), (-1, -1), "only the first joint has none"),
        (("A", "B"), (-1, 0, 1), "one parent and one offset per joint"),
    ],
)
def test_impossible_hierarchies_are_refused(names, parents, match):
    with pytest.raises(ValueError, match=match):
        skeleton(names, parents)
