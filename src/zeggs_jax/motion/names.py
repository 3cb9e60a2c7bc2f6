"""What names of joints say: the side, the part of the body, and so which joint plays which role."""

import re
from collections import Counter
from dataclasses import dataclass


@dataclass(frozen=True)
class Roles:
    """Names of the joints that the features need by meaning; None where a skeleton has no such joint."""

    hips: str | None = None
    spine: str | None = None  # where the root's ground position is taken: the release's Spine2
    head: str | None = None
    left_hand: str | None = None
    right_hand: str | None = None
    left_foot: str | None = None
    right_foot: str | None = None


# Parts to look for, best first, as `side_and_part` writes them.
_CANDIDATES: dict[str, tuple[str, ...]] = {
    "hips": ("hips", "hip", "pelvis", "spine base", "lower torso", "root", "bip pelvis"),
    "spine": (
        *("spine 2", "chest 2", "upper chest", "spine mid", "chest", "thorax", "t 8", "upper torso", "spine 1"),
        *("spine", "spine shoulder", "torso", "t 12", "ab", "abdomen"),
    ),
    "head": ("head", "head 1", "skull", "head base"),
    "hand": ("hand", "wrist", "palm"),
    "foot": ("foot", "ankle"),
}

# Names to suggest where nobody plays a role.
EXAMPLES: dict[str, str] = {
    "hips": "Hips or Pelvis",
    "spine": "Spine2 or Chest",
    "head": "Head",
    "left_hand": "LeftHand or LeftWrist",
    "right_hand": "RightHand or RightWrist",
    "left_foot": "LeftFoot or LeftAnkle",
    "right_foot": "RightFoot or RightAnkle",
}

_SIDES = {"left": "left", "right": "right", "l": "left", "r": "right"}
_GLUED = (  # lhand, rfoot: a letter for the side is taken off these only
    "hand|foot|wrist|ankle|elbow|shoulder|collar|clavicle|thigh|shin|knee|toe|toes|forearm|upperarm|uparm|upleg|"
    "finger|fingers|thumb|index|middle|ring|pinky"
)
_MIDDLE = ("c", "m", "center", "centre")  # Head_M, J_Bip_C_Head
_KINDS = ("jnt", "joint", "bone", "bn")  # l_hand_jnt
_SHARED = 0.6  # a beginning that this share of the joints has says nothing about any of them: b_, Bip01, Character1_


def side_and_part(name: str) -> tuple[str, str]:
    """Side ("left", "right", "") and the other words: "mixamorig:LeftHand" -> ("left", "hand")."""
    return _side_and_part(_words(name))


def infer_roles(names: tuple[str, ...]) -> Roles:
    """Roles by the usual names; unknown ones stay None.

    Understood are those of ZEGGS, CMU, DAZ, Mixamo, Bandai-Namco, Unreal, GENEA, SMPL, Xsens, Biped, VRM, Kinect,
    OptiTrack and others like them, also behind a prefix that most joints have.
    """
    known: dict[tuple[str, str], str] = {}
    shared = _shared_beginning([_words(name) for name in names])
    for name in names:
        words = _words(name)
        if words[: len(shared)] == shared and len(words) > len(shared):
            words = words[len(shared) :]
        side, part = _side_and_part(words)
        known.setdefault((side, _bare(part)), name)

    def find(part: str, side: str = "") -> str | None:
        return next((known[side, words] for words in _CANDIDATES[part] if (side, words) in known), None)

    return Roles(
        hips=find("hips"),
        spine=_spine(known) or find("spine"),
        head=find("head"),
        left_hand=find("hand", "left"),
        right_hand=find("hand", "right"),
        left_foot=find("foot", "left"),
        right_foot=find("foot", "right"),
    )


def _words(name: str) -> list[str]:
    """ "mixamorig:LeftHand" -> ["left", "hand"], "Spine_01" -> ["spine", "1"]; a vertebra such as L5 is ["vl", "5"]."""
    name = name.rsplit(":", 1)[-1]
    if vertebra := re.fullmatch(r"([LTC])(\d+)", name):
        return [f"v{vertebra[1].lower()}" if vertebra[1] == "L" else vertebra[1].lower(), vertebra[2]]
    words = [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)]
    return [str(int(word)) if word.isdigit() else word for word in words]


def _side_and_part(words: list[str]) -> tuple[str, str]:
    words = list(words)
    if words and (glued := re.fullmatch(rf"(left|right|[lr](?=(?:{_GLUED})$))(.+)", words[0])):
        words[:1] = glued.groups()
    side = ""
    for spelling, meaning in _SIDES.items():
        if not side and spelling in words:
            side = meaning
            words.remove(spelling)
    return side, " ".join(words)


def _bare(part: str) -> str:
    """A part without what says nothing about it: "head m" -> "head", "hip joint" -> "hip"."""
    words = part.split()
    while len(words) > 1 and words[-1] in (*_MIDDLE, *_KINDS):
        words.pop()
    while len(words) > 1 and words[0] in (*_MIDDLE, "b", "joint"):
        words.pop(0)
    return " ".join(words)


def _shared_beginning(names: list[list[str]]) -> list[str]:
    """The longest beginning, not a side, that most names have."""
    shared: list[str] = []
    while True:
        following = [
            words[len(shared)] for words in names if words[: len(shared)] == shared and len(words) > len(shared)
        ]
        word, count = Counter(following).most_common(1)[0] if following else ("", 0)
        if count < max(4, _SHARED * len(names)) or word in _SIDES:
            return shared
        shared.append(word)


def _spine(known: dict[tuple[str, str], str]) -> str | None:
    """Unreal counts its spine from 1, so its third joint is spine_03; everyone else's is Spine2."""
    return known.get(("", "spine 3")) if ("", "spine") not in known and ("", "spine 0") not in known else None
