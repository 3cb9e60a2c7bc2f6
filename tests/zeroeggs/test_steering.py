"""From a request to the style of every frame: what each wish does, what does not go together, when to warn."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs import library as libraries
from zeggs_jax.zeroeggs import steering, style_space
from zeggs_jax.zeroeggs.library import Entry, Library
from zeggs_jax.zeroeggs.model import StyleDistribution, StyleEncoderConfig
from zeggs_jax.zeroeggs.steering import Request, Space
from zeggs_jax.zeroeggs.timeline import Cue, Timeline

N, Z = 12, 8
ONLY_OLD = Timeline((Cue(0.0, (("old", 1.0),)),))


@pytest.fixture(scope="module")
def space():
    """Twelve styles without poses."""
    means = np.random.default_rng(0).normal(size=(N, Z)).astype(np.float32) * np.linspace(2.0, 0.2, Z, dtype=np.float32)
    spread = np.zeros(Z, np.float32)
    entries = [Entry(f"s{k}", "s", "", None, StyleDistribution(mean, spread), None) for k, mean in enumerate(means)]
    return Space(Library("", tuple(entries)), jnp.asarray(means))


def lay_out(space, *names, frames=4, **wishes):
    """The sequence of a request at temperature 0 for entries of the library."""
    chosen = [libraries.find(space.library, name) for name in names]
    wishes.setdefault("temperature", 0.0)
    if "timeline" not in wishes:
        wishes["styles"] = names
    return np.asarray(g.style_sequence(Request(**wishes), chosen, frames, 30.0, space))


def close(a, b):
    np.testing.assert_allclose(a, b, atol=1e-5, rtol=1e-5)


def test_intensity_goes_from_the_mean_through_the_style(space):
    mean, style = space.points.mean(0), space.points[3]
    np.testing.assert_array_equal(lay_out(space, "s3", intensity=1.0), np.tile(style, (4, 1)))
    close(lay_out(space, "s3", intensity=0.0)[0], mean)
    close(lay_out(space, "s3", intensity=2.0)[0] - style, style - mean)


def test_intensity_of_a_blend_is_the_blend_of_intensities(space):
    both = lay_out(space, "s1", "s2", weights=(0.3, 0.7), intensity=1.6)[0]
    blend = lay_out(space, "s1", "s2", weights=(0.3, 0.7))[0]
    close(both, style_space.intensify(blend, space.points.mean(0), 1.6))


def test_components_move_a_style_in_standard_deviations(space):
    components = style_space.principal(space.points)
    moved, still = lay_out(space, "s3", pca=((1, 2.0), (4, -1.0)))[0], lay_out(space, "s3")[0]
    change = style_space.coordinates(components, moved) - style_space.coordinates(components, still)
    close(change, [2, 0, 0, -1, 0, 0, 0, 0])


def test_components_move_every_frame_alike(space):
    """Of styles in turn or over time, whatever the intensity of a cue."""
    cues = Timeline((Cue(0.0, (("s1", 1.0),)), Cue(1.0, (("s2", 1.0),), intensity=0.0)))
    for wishes in ({"timeline": cues}, {"spans": (0.5, 0.5)}):
        still, moved = (lay_out(space, "s1", "s2", frames=90, pca=pca, **wishes) for pca in ((), ((1, 2.0),)))
        close(moved - still, np.tile(moved[0] - still[0], (90, 1)))
        assert np.abs(moved - still).max() > 0.1


def test_what_a_request_names():
    assert steering.named(Request()) == ("neutral",)
    assert steering.named(Request(pca=((1, 1.0),))) == ()
    assert steering.named(Request(timeline=Timeline((Cue(0.0, (("a", 0.5), ("b", 0.5))),)))) == ("a", "b")


def test_a_timeline_goes_from_style_to_style(space):
    cues = Timeline((Cue(0.0, (("s1", 1.0),)), Cue(1.0, (("s2", 0.5), ("s3", 0.5)), intensity=2.0)))
    sequence = lay_out(space, "s1", "s2", "s3", frames=90, timeline=cues)
    mixed = 0.5 * (space.points[2] + space.points[3])
    close(sequence[0], space.points[1])
    close(sequence[-1], style_space.intensify(mixed, space.points.mean(0), 2.0))
    assert np.abs(np.diff(sequence, axis=0)).max() < 0.15 * np.abs(sequence[-1] - sequence[0]).max()


def test_a_sample_varies_and_is_steered_like_its_mean(space):
    request = {"temperature": 1.0, "seed": 5}
    plain, strong = lay_out(space, "s3", **request)[0], lay_out(space, "s3", intensity=1.5, **request)[0]
    assert np.abs(plain - space.points[3]).max() > 0.1
    close(strong, style_space.intensify(plain, space.points.mean(0), 1.5))


def notes(space, *names, **wishes):
    """What is told of a request for entries of the library."""
    chosen = [libraries.find(space.library, name) for name in names]
    styles = () if "timeline" in wishes else names
    return steering.notes(Request(styles=styles, **wishes), chosen, 90, 30.0, space)


def test_what_lies_outside_the_cloud_is_told(space):
    for name in ("s0", "s5", "s11"):
        assert notes(space, name) == ()  # all of the library lie inside
    far = style_space.outlying(style_space.cloud(space.points), space.points[3])
    (told,) = notes(space, "s3", intensity=4.0, pca=((2, 0.0),))
    assert told == (
        f"intensity 4 of 's3' with component 2 +0 lies {4 * far:.2f} times as far out as the farthest clip "
        "of the style library."
    )
    strong = Timeline((Cue(0.0, (("s1", 1.0),)), Cue(1.0, (("s2", 1.0),), curve="hard", intensity=9.0)))
    (told,) = notes(space, "s1", "s2", timeline=strong)
    assert told.startswith("the timeline at 1.0 s lies")


def test_a_library_too_small_to_tell_says_so(space):
    two = Space(Library("", space.library.entries[:2]), space.points[:2])
    assert notes(two, "s1") == ()
    (told,) = notes(two, "s1", intensity=3.0)
    assert told == "a library of 2 embeddings is too small to tell how far out the style lies."


def test_samples_do_not_set_off_the_guard(space):
    assert notes(space, "s3", temperature=3.0) == ()


@pytest.mark.parametrize(
    ("wishes", "sentence"),
    [
        ({"pca": ((9, 1.0),)}, "component 9 was asked for, but the library has components 1 to 8"),
        ({"pca": ((0, 1.0),)}, "component 0 was asked for"),
        ({"pca": ((1, 1.0), (1, 2.0))}, "name one twice"),
        ({"pca": ((1, float("nan")),)}, "not finite"),
        ({"intensity": float("inf")}, "not finite"),
        ({"timeline": Timeline((Cue(0.0, (("s1", 1.0),)), Cue(9.0, (("s1", 1.0),))))}, "speech ends at"),
    ],
)
def test_wishes_out_of_range(space, wishes, sentence):
    with pytest.raises(ValueError, match=sentence):
        lay_out(space, "s1", **wishes)


@pytest.fixture(scope="module")
def library(clips, gesturer, tmp_path_factory):
    """The path of a library of three clips of the small model: old in two halves, and happy."""
    old = str(clips / "old.bvh")
    made = libraries.embed(
        [old, old, clips / "happy.bvh"], gesturer, ((0, 30), (30, 60), (0, 60)), ("old", "old", "happy")
    )
    return str(libraries.save(tmp_path_factory.mktemp("library") / "three.npz", made))


@pytest.fixture(scope="module")
def labelled(gesturer):
    """The small model, as if it were steered by labels."""
    config = replace(gesturer.config, labels=("calm", "odd", "wild"), style=StyleEncoderConfig(kind="label"))
    return gesturer._replace(config=config)


def test_a_motion_is_steered_from_file_to_file(clips, gesturer, library, tmp_path):
    cues = Timeline((Cue(0.0, (("happy", 1.0),)), Cue(0.4, (("old", 0.5), (f"{library}:happy", 0.5)), 0.5)))
    request = Request(timeline=cues, library=library, intensity=5.0)
    gesture = g.generate(clips / "speech.wav", request, model=gesturer)
    assert "the timeline at" in gesture.notes[0]
    g.save(tmp_path / "a.bvh", gesture)
    told = json.loads((tmp_path / "a.provenance.json").read_text())
    assert told["notes"] == list(gesture.notes)
    assert told["arguments"]["timeline"][1]["mix"][0] == ["old", 0.5]
    assert {library, f"{library}:happy"} <= set(told["inputs_sha256"])
    assert "happy" not in told["inputs_sha256"]  # the library's, not the bundled clip


def test_a_timeline_starts_in_the_pose_of_its_heaviest_first_style(gesturer, library):
    cues = Timeline((Cue(0.0, (("old_0-30", 0.6), ("happy", 0.4))), Cue(1.0, (("old_30-60", 1.0),))))
    request = Request(timeline=cues, library=library)
    chosen = g.read_styles(request, gesturer)
    start = g.starting_pose(request, chosen, gesturer)
    np.testing.assert_array_equal(start.pose.joint_pos, chosen[0].start.pose.joint_pos)


def test_the_mean_starts_like_the_style_nearest_to_it(gesturer, library):
    request = Request(pca=((1, 1.0),), library=library)
    (middle,) = g.read_styles(request, gesturer)
    known = libraries.load(library, gesturer)
    close(middle.distribution.mean, libraries.points(known).mean(0))
    near, _ = style_space.nearest(libraries.points(known), middle.distribution.mean, 1)
    np.testing.assert_array_equal(middle.start.pose.joint_pos, known.entries[int(near[0])].start.pose.joint_pos)


@pytest.mark.parametrize(
    ("wishes", "sentence"),
    [
        ({"intensity": 1.5}, "this model comes with none; make one of its corpus with 'zeggs embed'"),
        ({"pca": ((1, 1.0),)}, "this model comes with none"),
        ({"timeline": Timeline((Cue(0.0, (("old", 1.0),), intensity=2.0),))}, "this model comes with none"),
        ({"library": "gone.npz"}, "'gone.npz' does not exist"),
        (
            {"library": "LIBRARY", "pca": ((3, 1.0),)},
            "component 3 was asked for, .* 1 to 2",
        ),
        ({"library": "LIBRARY", "pca": ((1, 1.0),), "frames": ((0, 9),)}, "leave frames and spans out"),
        ({"library": "LIBRARY", "styles": ("odl",)}, "unknown style 'odl'.*nearest: old"),
        ({"timeline": Timeline((Cue(0.0, (("odl", 1.0),)),))}, "the timeline: unknown style 'odl'.*nearest: old"),
        ({"library": "ONE", "pca": ((1, 1.0),)}, "a library of 1 embedding has no mean and no directions"),
        ({"library": "ONE", "intensity": 2.0}, "a library of 1 embedding has no mean"),
        (
            {"timeline": Timeline((Cue(0.0, (("old", 1.0),)),)), "styles": ("old",)},
            "a timeline names its styles itself",
        ),
        ({"styles": ("old", "happy"), "frames": ((0, 9),) * 3}, "got 3 frame ranges for 2 styles"),
    ],
)
def test_requests_that_a_model_cannot_meet(clips, gesturer, library, tmp_path, wishes, sentence):
    known = libraries.load(library, gesturer)
    one = libraries.save(tmp_path / "one.npz", known._replace(entries=known.entries[:1]))
    if wishes.get("library") in ("LIBRARY", "ONE"):
        wishes = {**wishes, "library": {"LIBRARY": library, "ONE": str(one)}[wishes["library"]]}
    with pytest.raises((ValueError, OSError), match=sentence):
        g.generate(clips / "speech.wav", Request(**wishes), model=gesturer)


def test_a_style_can_be_used_without_any_library(clips, gesturer):
    space = steering.read_space(Request(), gesturer)
    assert space == Space(None, None)
    (old,) = g.read_styles(Request(styles=(str(clips / "old.bvh"),)), gesturer)
    assert steering.notes(Request(), [old], 9, 30.0, space) == ()
    with pytest.raises(ValueError, match="this model comes with none"):
        g.style_sequence(Request(intensity=2.0), [old], 9)


def test_labels_are_a_space_of_their_own(labelled):
    request = Request(styles=("calm",), intensity=1.5)
    space = steering.read_space(request, labelled)
    chosen = g.read_styles(request, labelled, space)
    close(g.style_sequence(request, chosen, 2, 30.0, space)[0], [4 / 3, -1 / 6, -1 / 6])
    (told,) = steering.notes(request, chosen, 2, 30.0, space)
    assert told == "intensity 1.5 of 'calm' lies 1.50 times as far out as the farthest label."
    mixed = Request(timeline=Timeline((Cue(0.0, (("calm", 0.5), ("wild", 0.5))),)))
    close(g.style_sequence(mixed, g.read_styles(mixed, labelled), 2, 30.0, space)[0], [0.5, 0.0, 0.5])
    for wishes in ({"library": "a.npz"}, {"pca": ((1, 1.0),)}):
        with pytest.raises(ValueError, match="steered by labels and has no components"):
            steering.read_space(Request(**wishes), labelled)
    with pytest.raises(ValueError, match=r"no pose to start from; give a .bvh with --first-pose"):
        g.starting_pose(request, chosen, labelled)
