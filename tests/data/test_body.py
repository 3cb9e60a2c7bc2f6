"""Bodies: however a file is scaled and turned, the same motion in centimetres, y up, hips and head ahead."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.data import body
from zeggs_jax.data.body import AS_IS, BodyConfig, normalise, resolve
from zeggs_jax.geometry import quaternion
from zeggs_jax.motion import bvh, features
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.skeleton import Roles, Skeleton
from zeggs_jax.zeroeggs import examples

from .conftest import make_clip

AUTO = BodyConfig()
TURNS = [  # the 24 rotations that map axes to axes
    np.array(turn)
    for rows in itertools.permutations(np.eye(3))
    for signs in itertools.product((1, -1), repeat=3)
    if np.linalg.det(turn := np.array(rows) * np.array(signs)[:, None]) > 0
]
UNITS = {"cm": 1.0, "m": 100.0, "mm": 0.1, "inches": 2.54, "feet": 30.48, "CMU units": 2.54 / 0.45}


@pytest.fixture(scope="module")
def clip() -> Clip:
    return make_clip(40)


def rewritten(clip: Clip, world: np.ndarray, frames: list[np.ndarray], unit: float = 1.0) -> Clip:
    """The clip as a program would write it that turns the world and every joint's frame, in another unit."""
    above = [world if parent < 0 else frames[parent] for parent in clip.skeleton.parents]
    q = features.local_quaternions(clip)
    with features.jax.enable_x64(True):
        left, right = (quaternion.from_matrix(np.stack(m)) for m in (above, frames))
        q = np.array(quaternion.multiply(quaternion.multiply(left[None], q), quaternion.inverse(right)[None]))
    offsets = np.stack([m @ v for m, v in zip(above, clip.skeleton.offsets, strict=True)]) / unit
    positions = np.einsum("jab,tjb->tja", np.stack(above), clip.positions) / unit
    skeleton = Skeleton(clip.skeleton.names, clip.skeleton.parents, offsets, clip.skeleton.roles)
    return features.with_quaternions(clip._replace(skeleton=skeleton), q, positions)


@settings(deadline=None, max_examples=8)
@given(st.sampled_from(TURNS), st.sampled_from(sorted(UNITS)))
def test_a_turned_and_scaled_copy_comes_back(turn, unit):
    clip = make_clip(40)
    copy = rewritten(clip, turn, [turn] * 8, UNITS[unit])
    seen = features.world_positions(copy)
    np.testing.assert_allclose(seen, features.world_positions(clip) @ turn.T / UNITS[unit], atol=1e-6)
    back = normalise(copy, AUTO, "copy.bvh")
    np.testing.assert_allclose(features.world_positions(back), features.world_positions(clip), atol=1e-4)
    np.testing.assert_allclose(back.skeleton.offsets, clip.skeleton.offsets, atol=1e-4)
    assert normalise(back, AUTO, "copy.bvh") is back


def test_a_world_with_z_up_and_a_rest_pose_with_y_up(clip):
    z_up = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    copy = rewritten(clip, z_up, [np.eye(3)] * 8)
    config = resolve(copy, AUTO, "copy.bvh")
    assert (config.up, config.facing, config.axes) == ("z", "z", ())
    back = normalise(copy, AUTO, "copy.bvh")
    np.testing.assert_allclose(features.world_positions(back), features.world_positions(clip), atol=1e-4)


@pytest.mark.parametrize("seed", range(2))
def test_joints_with_frames_of_their_own(clip, seed):
    """As in files whose bones lie along one axis: where the body stands and looks must not depend on them."""
    draw = np.random.default_rng(seed)
    frames = [TURNS[i] for i in draw.integers(24, size=8)]
    back = normalise(rewritten(clip, np.eye(3), frames, 100.0), AUTO, "copy.bvh")
    expected, found = features.encode(clip), features.encode(centred_like(clip, back))
    np.testing.assert_allclose(found.pose.root.rot, expected.pose.root.rot, atol=1e-5)
    np.testing.assert_allclose(found.pose.root.pos, expected.pose.root.pos, atol=1e-3)
    np.testing.assert_allclose(found.gaze, expected.gaze, atol=1e-3)


def centred_like(clip: Clip, back: Clip) -> Clip:
    """`back` turned about y by the quarter turns that the hips' frame left open."""
    hips, there = features.world_positions(clip)[:, 0], features.world_positions(back)[:, 0]
    for turn in TURNS:
        if turn[1, 1] == 1 and np.abs(there @ turn.T - hips).max() < 1e-3:
            return rewritten(back, turn, [np.eye(3)] * len(back.skeleton))
    raise AssertionError("the hips went elsewhere")


def test_the_packages_own_clips_stay_untouched():
    clip = bvh.read(examples.bundled()["neutral"])
    assert normalise(clip, AUTO, "neutral.bvh") is clip
    assert normalise(clip, AS_IS, "neutral.bvh") is clip


def test_given_wins_over_found(clip):
    turn = TURNS[7]
    copy = rewritten(clip, turn, [turn] * 8, 0.2)
    with pytest.raises(ValueError, match=r"'copy\.bvh' has a body .* no human height .* give its scale"):
        normalise(copy, AUTO, "copy.bvh")
    back = normalise(copy, BodyConfig(scale=0.2), "copy.bvh")
    np.testing.assert_allclose(features.world_positions(back), features.world_positions(clip), atol=1e-4)
    found = resolve(copy, BodyConfig(scale=0.2), "copy.bvh")
    given = BodyConfig(scale=0.2, up=found.up, facing=found.facing)
    assert resolve(copy, given, "copy.bvh") == found == resolve(copy, found, "copy.bvh")


def test_a_body_that_lies_down_is_told_apart_only_by_who_says_so(clip):
    tilted = clip._replace(euler=clip.euler.copy())
    tilted.euler[:, 0] = [0.0, 0.0, np.radians(45)]  # yzx: about x
    tilted.euler[:, 1:] = 0
    with pytest.raises(ValueError, match=r"'b\.bvh' does not stand along an axis; say which one points up"):
        normalise(tilted, AUTO, "b.bvh")
    assert normalise(tilted, BodyConfig(up="y"), "b.bvh") is tilted


def under_a_still_root(clip: Clip) -> Clip:
    """The clip below a joint that stays at the origin, which also carries a prop."""
    names, parents = ("Origin", *clip.skeleton.names, "Prop"), (-1, *(p + 1 for p in clip.skeleton.parents), 0)
    offsets = np.concatenate([np.zeros((1, 3)), clip.skeleton.offsets, [[50.0, 0, 0]]])
    frames = len(clip.euler)
    still = np.zeros((frames, 1, 3))
    euler = np.concatenate([still, clip.euler, still], axis=1)
    positions = np.concatenate([still, clip.positions, np.tile(offsets[-1], (frames, 1, 1))], axis=1)
    return Clip(Skeleton(names, parents, offsets), ("yzx",) * len(names), euler, positions, clip.frame_time)


def test_hips_that_move_below_a_still_root_take_it_along(clip):
    """Only joint 0 keeps its translation in a BVH file, and the networks' motion is written as one."""
    copy = under_a_still_root(clip)
    config = resolve(copy, AUTO, "copy.bvh")
    assert config.lead
    led = normalise(copy, AUTO, "copy.bvh")
    np.testing.assert_allclose(features.world_positions(led)[:, 1:], features.world_positions(copy)[:, 1:], atol=1e-9)
    written = features.world_positions(bvh.parse(bvh.format(led)))
    np.testing.assert_allclose(written[:, 1:-1], features.world_positions(copy)[:, 1:-1], atol=1e-4)
    assert normalise(led, config, "copy.bvh").positions == pytest.approx(led.positions)
    assert not resolve(led, AUTO, "copy.bvh").lead
    first = led._replace(euler=led.euler[:1], positions=led.positions[:1])  # a first pose does not move
    np.testing.assert_allclose(normalise(first, config, "first.bvh").positions, first.positions, atol=1e-9)


def test_what_a_model_makes_is_read_as_it_is(clip):
    copy = rewritten(clip, np.eye(3), [TURNS[3]] * 8, 100.0)
    config = resolve(copy, AUTO, "copy.bvh")
    made = normalise(copy, config, "copy.bvh")
    assert body.normalise_like(made, config, made.skeleton, "made.bvh") is made
    again = body.normalise_like(copy, config, made.skeleton, "copy.bvh")
    np.testing.assert_allclose(again.skeleton.offsets, made.skeleton.offsets)


def renamed(clip: Clip, **names: str) -> Clip:
    found = tuple(names.get(name, name) for name in clip.skeleton.names)
    return clip._replace(skeleton=Skeleton(found, clip.skeleton.parents, clip.skeleton.offsets))


def test_roles_that_names_do_not_tell_are_given(clip):
    german = renamed(clip, Head="Kopf", Hips="Becken")
    with pytest.raises(ValueError, match=r"'k\.bvh': No joint .* looks like the hips.*\[roles\] of a body file"):
        normalise(german, AUTO, "k.bvh")
    config = BodyConfig(roles=Roles(hips="Becken", head="Kopf"))
    roles = normalise(german, config, "k.bvh").skeleton.roles
    assert (roles.hips, roles.head, roles.spine) == ("Becken", "Kopf", "Spine2")
    with pytest.raises(ValueError, match=r"'k\.bvh' has no joint 'Kop', which is given as its head.*'Kopf'"):
        normalise(german, BodyConfig(roles=Roles(hips="Becken", head="Kop")), "k.bvh")
    with pytest.raises(ValueError, match="not below its hips 'LeftHand'"):
        normalise(german, BodyConfig(roles=Roles(hips="LeftHand", head="Kopf")), "k.bvh")


def test_a_body_without_sides_must_be_told_where_it_faces(clip):
    one = renamed(clip, LeftHand="A", RightHand="B", LeftFoot="C", RightFoot="D")
    with pytest.raises(ValueError, match=r"'o\.bvh' has no left and right joints .* say which axis its hips face"):
        normalise(one, BodyConfig(scale=1.0), "o.bvh")
    assert normalise(one, BodyConfig(scale=1.0, facing="z"), "o.bvh").euler is one.euler


def test_what_was_decided_is_said(clip):
    text = body.describe(resolve(rewritten(clip, np.eye(3), [np.eye(3)] * 8, 100.0), AUTO, "copy.bvh"))
    assert text.startswith("m, y up, facing z; hips Hips, spine Spine2, head Head, left_hand LeftHand")


def test_a_body_file(tmp_path):
    path = tmp_path / "body.toml"
    path.write_text('scale = 100\nup = "z"\nfacing = "-y"\n[roles]\nhips = "Becken"\n')
    assert body.read_body(path) == BodyConfig(100.0, "z", "-y", roles=Roles(hips="Becken"))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("scal = 1", "unknown key 'scal'; the nearest known one is 'scale'"),
        ("scale = -1", "scale of a body is -1"),
        ('scale = "m"', "give the cm of one unit as a number"),
        ('up = "w"', "has up = 'w'; give one of auto, x"),
        ("scale = ", "is not TOML"),
        ('[roles]\nhip = "a"', "unknown key 'hip'; the nearest known one is 'hips'"),
        ("[roles]\nhips = 1", "joint's name in quotes"),
        ('roles = "a"', "write a table"),
    ],
)
def test_a_body_file_that_does_not_read(tmp_path, text, match):
    path = tmp_path / "body.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=match) as caught:
        body.read_body(path)
    assert "body.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("wrong", [{"axes": ("y y",)}, {"axes": ("y",)}, {"scale": 0.0}])
def test_a_config_that_cannot_be(wrong):
    with pytest.raises(ValueError, match="give"):
        BodyConfig(**wrong)
