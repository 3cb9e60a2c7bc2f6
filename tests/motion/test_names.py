"""Names of joints: sides, parts and roles in the dialects of many programs."""

import pytest

from zeggs_jax.motion.names import Roles, infer_roles, side_and_part

SMPL = "pelvis left_hip right_hip spine1 spine2 spine3 neck head left_wrist right_wrist left_ankle right_ankle"
XSENS = "Pelvis L5 L3 T12 T8 Neck Head RightShoulder RightHand LeftHand RightUpperLeg RightFoot LeftFoot"
BIPED = "Bip01 Bip01_Pelvis Bip01_Spine Bip01_Spine1 Bip01_Head Bip01_L_Hand Bip01_R_Hand Bip01_L_Foot Bip01_R_Foot"
VRM = "Hips Spine Chest UpperChest Head"
DIALECTS = {
    "SMPL": (SMPL, "pelvis spine3 head left_wrist right_wrist left_ankle right_ankle"),
    "SMPL as FBX": (
        "m_avg_root m_avg_Pelvis m_avg_L_Hip m_avg_Spine1 m_avg_Spine2 m_avg_Spine3 m_avg_Head m_avg_L_Hand "
        "m_avg_R_Hand m_avg_L_Foot m_avg_R_Foot",
        "m_avg_Pelvis m_avg_Spine3 m_avg_Head m_avg_L_Hand m_avg_R_Hand m_avg_L_Foot m_avg_R_Foot",
    ),
    "Xsens": (XSENS, "Pelvis T8 Head LeftHand RightHand LeftFoot RightFoot"),
    "Biped": (BIPED, "Bip01_Pelvis Bip01_Spine1 Bip01_Head Bip01_L_Hand Bip01_R_Hand Bip01_L_Foot Bip01_R_Foot"),
    "MotionBuilder": (
        "Reference Character1_Hips Character1_Spine Character1_Spine1 Character1_Spine2 Character1_Head "
        "Character1_LeftHand Character1_RightHand Character1_LeftFoot Character1_RightFoot",
        "Character1_Hips Character1_Spine2 Character1_Head Character1_LeftHand Character1_RightHand "
        "Character1_LeftFoot Character1_RightFoot",
    ),
    "VRM": (
        " ".join(f"J_Bip_C_{n}" for n in VRM.split()) + " J_Bip_L_Hand J_Bip_R_Hand J_Bip_L_Foot J_Bip_R_Foot",
        "J_Bip_C_Hips J_Bip_C_UpperChest J_Bip_C_Head J_Bip_L_Hand J_Bip_R_Hand J_Bip_L_Foot J_Bip_R_Foot",
    ),
    "Kinect": (
        "SpineBase SpineMid Neck Head WristLeft HandLeft HandRight HipLeft FootLeft FootRight SpineShoulder",
        "SpineBase SpineMid Head HandLeft HandRight FootLeft FootRight",
    ),
    "OptiTrack": ("Hip Ab Chest Neck Head LHand RHand LFoot RFoot", "Hip Chest Head LHand RHand LFoot RFoot"),
    "small letters": (
        "hips chest head lwrist rwrist lankle rankle lknee rknee",
        "hips chest head lwrist rwrist lankle rankle",
    ),
    "Maya": (
        "Root_M Spine1_M Chest_M Head_M Wrist_L Wrist_R Ankle_L Ankle_R",
        "Root_M Chest_M Head_M Wrist_L Wrist_R Ankle_L Ankle_R",
    ),
    "rigger's": (
        "hips_jnt chest_jnt head_jnt l_hand_jnt r_hand_jnt l_foot_jnt r_foot_jnt",
        "hips_jnt chest_jnt head_jnt l_hand_jnt r_hand_jnt l_foot_jnt r_foot_jnt",
    ),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_roles_of_a_dialect(dialect):
    names, expected = DIALECTS[dialect]
    assert infer_roles(tuple(names.split())) == Roles(*expected.split())


@pytest.mark.parametrize(
    ("name", "side", "part"),
    [
        ("mixamorig:LeftHand", "left", "hand"),
        ("hand.R", "right", "hand"),
        ("rfoot", "right", "foot"),
        ("lfingers", "left", "fingers"),
        ("LShldr", "left", "shldr"),
        ("spine_03", "", "spine 3"),
        ("L5", "", "vl 5"),  # a vertebra, nothing left
        ("ribs", "", "ribs"),
        ("lowerback", "", "lowerback"),
    ],
)
def test_sides(name, side, part):
    assert side_and_part(name) == (side, part)


def test_what_is_not_known_plays_no_role():
    assert infer_roles(("Kopf", "Becken", "Fuss")) == Roles()
