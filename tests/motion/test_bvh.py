"""BVH: what is written is read again, every dialect is understood, every fault is named in one sentence."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.motion import bvh
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.skeleton import Skeleton

ORDERS = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")


@st.composite
def bodies(draw):
    """Names, parents in depth first order, Euler orders; number of frames, frame time, seed."""
    joints = draw(st.integers(1, 7))
    parents, path = [-1], [0]
    for joint in range(1, joints):
        path = path[: draw(st.integers(1, len(path)))]  # climb back up some way, then add a child
        parents.append(path[-1])
        path.append(joint)
    kinds = st.sampled_from(["ns:Joint", "Left-Arm ", "b_", "Knochen ä"])
    names = tuple(f"{draw(kinds)}{joint}" for joint in range(joints))
    orders = tuple(draw(st.sampled_from(ORDERS)) for _ in range(joints))
    time = draw(st.sampled_from([0.016667, 0.033333, 0.0083333, 1 / 60]))
    return names, tuple(parents), orders, draw(st.integers(1, 5)), time, draw(st.integers(0, 1000))


def random_clip(names, parents, orders, frames, frame_time, seed) -> Clip:
    rng, joints = np.random.default_rng(seed), len(names)
    skeleton = Skeleton(names, parents, rng.normal(size=(joints, 3)) * 50)
    euler, positions = (
        rng.uniform(-3.14, 3.14, (frames, joints, 3)),
        rng.normal(size=(frames, joints, 3)) * 100,
    )
    return Clip(skeleton, orders, euler, positions, frame_time)


@settings(deadline=None)
@given(bodies())
def test_what_is_written_is_read(body):
    clip = random_clip(*body)
    back = bvh.parse(bvh.format(clip, translations=True))
    assert back.skeleton.names == clip.skeleton.names
    assert back.skeleton.parents == clip.skeleton.parents
    assert (back.orders, back.frame_time) == (clip.orders, clip.frame_time)
    np.testing.assert_allclose(back.skeleton.offsets, clip.skeleton.offsets, atol=1e-6)
    np.testing.assert_allclose(back.positions, clip.positions, atol=1e-6)
    np.testing.assert_allclose(back.euler, clip.euler, atol=1e-7)
    assert bvh.format(back, translations=True) == bvh.format(clip, translations=True)


@settings(deadline=None)
@given(bodies())
def test_without_translations_other_joints_have_their_offset(body):
    clip = random_clip(*body)
    back = bvh.parse(bvh.format(clip))
    np.testing.assert_allclose(back.positions[:, 0], clip.positions[:, 0], atol=1e-6)
    expected = np.broadcast_to(clip.skeleton.offsets[1:], back.positions[:, 1:].shape)
    np.testing.assert_allclose(back.positions[:, 1:], expected, atol=1e-6)


def test_files_are_written_and_read(clip, tmp_path):
    bvh.write(tmp_path / "a.bvh", clip)
    assert [path.name for path in tmp_path.iterdir()] == ["a.bvh"]  # no partial file is left
    np.testing.assert_allclose(bvh.read(str(tmp_path / "a.bvh")).euler, clip.euler, atol=1e-7)
    assert b"\r" not in (tmp_path / "a.bvh").read_bytes()


def test_end_sites_lose_their_offset():
    text = dialect("3 Zrotation Xrotation Yrotation", "1 2 3 4 5 6 7 8 9", "1 2 3 4 5 6 7 8 9")
    ends = re.findall(r"End Site\s*{\s*OFFSET (.*)", bvh.format(bvh.parse(text)))
    assert ends == ["0.000000 0.000000 0.000000"] * 2  # the arm's was 0 1 0, the leg had none


def test_where_nothing_can_be_written_nothing_is_left(clip, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"' is a folder; give the name of a \.bvh file\.$"):
        bvh.write(tmp_path, clip)
    with pytest.raises(FileNotFoundError, match=r"^There is no folder '.*gone' to write 'a\.bvh' in"):
        bvh.write(tmp_path / "gone" / "a.bvh", clip)

    def refuse(source, target):
        raise PermissionError(13, "Permission denied", str(source), None, str(target))

    monkeypatch.setattr(bvh.os, "replace", refuse)
    with pytest.raises(OSError, match=r"a\.bvh' cannot be written: Permission denied\.$"):
        bvh.write(tmp_path / "a.bvh", clip)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("frame_time", "text"),
    [(0.016667, "0.016667"), (0.04, "0.040000"), (0.0083333, "0.0083333"), (1 / 60, "0.016666666666666666")],
)
def test_frame_time_is_kept(clip, frame_time, text):
    written = bvh.format(clip._replace(frame_time=np.float64(frame_time)))
    assert f"\nFrame Time: {text}\n" in written
    assert bvh.parse(written).frame_time == frame_time


@pytest.mark.parametrize(
    ("frame_time", "rate"),
    [
        *((0.016667, 60), (0.0166666, 60), (0.016666, 60), (0.01667, 60), (1 / 60, 60)),
        *(
            (0.0333333, 30),
            (0.03333, 30),
            (0.008333, 120),
            (0.00833333, 120),
            (0.04, 25),
            (0.01, 100),
            (1.0, 1),
        ),
        *((0.0333667, 1 / 0.0333667), (0.0417083, 1 / 0.0417083), (2.5, 0.4)),  # 29.97 and 23.976 stay
    ],
)
def test_rates(frame_time, rate):
    assert bvh.rate_hz(frame_time) == rate


DIALECT = """HIERARCHY
ROOT Hips
{{
\tOFFSET 1 +2.5E+00 -.5
\tCHANNELS 6 Yrotation Xposition Xrotation Zposition Zrotation Yposition
\tJOINT mixamorig:Left-Arm 1 \t
\t{{
\t\tOFFSET 1e1 0 0
\t\tCHANNELS {channels}
\t\tEnd Site
\t\t{{
\t\t\tOFFSET 0 1 0
\t\t}}
\t}}
\tJOINT Leg
\t{{
\t\tOFFSET 0 -1.0E+1 0
\t\tCHANNELS 0
\t}}
}}
MOTION
Frames: 2
Frame Time: 0.0166666
"""


def dialect(channels: str, *rows: str) -> str:
    return DIALECT.format(channels=channels) + "\n".join(rows)


def test_any_channels_in_any_order():
    """Columns go where their names say; missing positions are the offset's, missing rotations zero."""
    clip = bvh.parse(dialect("3 Zrotation Xposition Yrotation", "1 2 3 4 5 6 7 8 9", "+1.0E+01 2 3 4 5 6 7 8 -9e0 "))
    assert clip.skeleton.names == ("Hips", "mixamorig:Left-Arm 1", "Leg")
    assert clip.skeleton.parents == (-1, 0, 0)
    assert clip.orders == ("yxz", "zyx", "yxz")
    np.testing.assert_allclose(clip.skeleton.offsets[0], [1, 2.5, -0.5])
    np.testing.assert_allclose(np.degrees(clip.euler[0]), [[1, 3, 5], [7, 9, 0], [0, 0, 0]])
    np.testing.assert_allclose(clip.positions[0], [[2, 6, 4], [8, 0, 0], [0, -10, 0]])
    np.testing.assert_allclose(np.degrees(clip.euler[1, :2, :2]), [[10, 3], [7, -9]])
    assert clip.frame_time == 0.0166666


@pytest.mark.parametrize("channels", ["0", "1 Xrotation", "3 Xrotation Yrotation Zrotation", "2 Xscale Zposition"])
def test_any_number_of_channels(channels):
    numbers = " ".join(str(x) for x in range(6 + int(channels[0])))
    assert bvh.parse(dialect(channels, numbers, numbers)).euler.shape == (2, 3, 3)


KEYWORDS = r"HIERARCHY|ROOT|JOINT|End Site|OFFSET|CHANNELS|[XYZ](rotation|position)|MOTION|Frames|Frame Time"


def test_line_ends_spaces_and_capitals_do_not_matter():
    text = dialect("3 Zrotation Xrotation Yrotation", "1 2 3 4 5 6 7 8 9", "1 2 3 4 5 6 7 8 9")
    expected = bvh.parse(text)
    variants = [
        text.replace("\n", "\r\n"),
        text.replace("\n", "\r"),
        text.replace("\t", "    "),
        text.replace(" ", "\t").replace("Left-Arm\t1", "Left-Arm 1").replace("End\tSite", "End Site"),
        text + "\n\n  \n",
        "\n" + text,
        text.replace("\n{", " {"),
        text.replace("Frames: 2", "Frames:\t2 "),
        *(re.sub(KEYWORDS, lambda found, to=to: to(found[0]), text) for to in (str.lower, str.upper, str.title)),
    ]
    for variant in variants:
        clip = bvh.parse(variant)
        assert clip.skeleton.names == expected.skeleton.names
        np.testing.assert_array_equal(clip.euler, expected.euler)


def test_byte_order_mark_and_latin_names(tmp_path):
    text = dialect("0", "1 2 3 4 5 6", "1 2 3 4 5 6").replace("Leg", "Knöchel")
    for name, encoding in (("bom.bvh", "utf-8-sig"), ("latin.bvh", "latin-1")):
        (tmp_path / name).write_bytes(text.encode(encoding))
        assert bvh.read(tmp_path / name).skeleton.names[2] == "Knöchel"


GOOD = dialect("0", "1 2 3 4 5 6", "7 8 9 10 11 12")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "'x.bvh' is empty"),
        (" \n", "is empty"),
        ("RIFF and the rest", "is not a BVH file: it begins with 'RIFF', not HIERARCHY"),
        ("HIERARCHYX\n", "is not a BVH file"),
        (GOOD.split("MOTION")[0], "has a HIERARCHY but no MOTION"),
        (GOOD.replace("12", ""), r"is cut off in frame 1 \(counted from 0\): 5 of 6 numbers"),
        (GOOD.replace("5 6\n", "5\n"), r"has 5 numbers in frame 0 \(counted from 0\), its channels need 6"),
        (GOOD.replace("5 6\n", "5 6 6\n"), "has 7 numbers in frame 0"),
        (GOOD.replace("7 8 9 10 11 12", ""), "announces 2 frames and holds 1"),
        (GOOD + "\n1 2 3 4 5 6\n", "announces 2 frames and holds 3"),
        (GOOD.replace("8", "nan"), r"has nan in channel Xposition of joint 'Hips' in frame 1"),
        (GOOD.replace("9", "-inf"), r"has -inf in channel Xrotation of joint 'Hips' in frame 1"),
        (GOOD.replace("10", "ten"), "has 'ten' where a number belongs, in frame 1"),
        (GOOD.replace("10", "1,0"), "has '1,0' where a number belongs, in frame 1"),
        (GOOD.replace("Frame Time: 0.0166666\n", ""), "has no line 'Frame Time: seconds'"),
        (GOOD.replace("Frames: 2\n", ""), "has no line 'Frames: N'"),
        (GOOD.replace("Frames: 2", "Frames: 0"), "holds no motion: 0 frames of 6 channels"),
        (GOOD.replace("0.0166666", "0"), "has frame time '0'; it must be"),
        (GOOD.replace("0.0166666", "1e-310"), "has frame time '1e-310'; it must be .* from 1e-6 to 1000"),
        (GOOD.replace("0.0166666", "1001"), "has frame time '1001'"),
        (GOOD.replace("0.0166666", "nan"), "has frame time 'nan'"),
        (GOOD.replace("0.0166666", "fast"), "has frame time 'fast'"),
        (
            GOOD.replace("Xrotation", "Wrotation"),
            "broken hierarchy after joint 'Hips': CHANNELS 6 is followed by",
        ),
        (GOOD.replace("Xrotation", "Yrotation"), "broken hierarchy after joint 'Hips'"),
        (GOOD.replace("CHANNELS 6", "CHANNELS six"), "broken hierarchy after joint 'Hips'"),
        (GOOD.replace("CHANNELS 6", "CHANNELS 7"), "broken hierarchy after joint 'Hips'"),
        (
            GOOD.replace("OFFSET 1e1 0 0", "OFFSET 1e1 0"),
            "broken hierarchy after joint 'mixamorig:Left-Arm 1'",
        ),
        (GOOD.replace("OFFSET 1e1 0 0", ""), "a brace or an OFFSET is missing"),
        (GOOD.replace("OFFSET 1e1 0 0", "OFFSET nan 0 0"), "an OFFSET is not finite"),
        (GOOD.replace("}\nMOTION", "MOTION"), "a brace or an OFFSET is missing"),
        (GOOD.replace("JOINT Leg", "JOINT"), "a joint has no name"),
        (GOOD.replace("JOINT Leg", "LEG"), "unexpected 'LEG'"),
        (GOOD.replace("Leg", "Hips"), "Two joints are called 'Hips'"),
        (GOOD.replace("ROOT Hips", ""), "broken hierarchy at its beginning"),
        ("HIERARCHY\nMOTION\nFrames: 1\nFrame Time: 1\n", "broken hierarchy at its beginning"),
    ],
)
def test_faults_are_named(text, match):
    with pytest.raises(ValueError, match=match) as caught:
        bvh.parse(text, "x.bvh")
    assert str(caught.value).startswith("'x.bvh' ")
    assert str(caught.value).count("\n") == 0


def test_missing_files_folders_and_binary_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"There is no BVH file '.*gone\.bvh'"):
        bvh.read(tmp_path / "gone.bvh")
    with pytest.raises(ValueError, match="' is a folder, not a BVH file"):
        bvh.read(tmp_path)
    (tmp_path / "picture.bvh").write_bytes(b"\x89PNG\0\0\xff")
    with pytest.raises(ValueError, match=r"'picture\.bvh' is not a BVH file: it holds binary data"):
        bvh.read(tmp_path / "picture.bvh")


@settings(deadline=None, max_examples=100)
@given(st.integers(0, len(GOOD) - 2))
def test_every_cut_is_a_clear_error(length):
    """However early the file stops: ValueError in one sentence, never another exception."""
    with pytest.raises(ValueError, match=r"^'x\.bvh' .*"):
        bvh.parse(GOOD[:length], "x.bvh")
