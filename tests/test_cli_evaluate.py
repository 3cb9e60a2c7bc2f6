"""`zeggs evaluate` from folders to report: what it says of damaged truth, and one sentence for each bad input."""

import hashlib
import json
import re

import numpy as np
import pytest

from zeggs_jax.metrics import feature_net, net_file
from zeggs_jax.motion import bvh, edit
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.speech import wav

RATE, FRAMES = 30, 120
BONES = {
    "Hips": ("", (0, 92, 0)), "Spine": ("Hips", (0, 34, -1)), "Head": ("Spine", (0, 34, 1)),
    **{
        side + name: (parent if parent in ("Spine", "Hips") else side + parent, (sign * x, y, z))
        for side, sign in (("Left", 1), ("Right", -1))
        for name, parent, (x, y, z) in (
            ("Arm", "Spine", (16, 17, 0)), ("ForeArm", "Arm", (28, 0, 0)), ("Hand", "ForeArm", (25, 0, 0)),
            ("UpLeg", "Hips", (10, -3, 0)), ("Leg", "UpLeg", (0, -40, 0)), ("Foot", "Leg", (0, -41, -1)),
            ("ToeBase", "Foot", (0, -5, 14)),
        )
    },
}  # fmt: skip
NAMES = tuple(BONES)
PARENTS = tuple(NAMES.index(parent) if parent else -1 for parent, _ in BONES.values())
SKELETON = Skeleton(NAMES, PARENTS, np.array([place for _, place in BONES.values()], float))
MOVING = np.array([[float("Arm" in name or "Hand" in name)] for name in NAMES])


def clip_of(seed):
    """Four seconds of arms; the second style moves twice as far."""
    time = np.arange(FRAMES)[:, None, None] / RATE
    phase = np.random.default_rng(seed).uniform(0.0, 6.0, (1, len(NAMES), 3))
    euler = (0.12 + 0.12 * (seed % 2)) * np.sin(3.0 * time + phase) * MOVING
    positions = np.repeat(SKELETON.offsets[None], FRAMES, axis=0)
    return bvh.Clip(SKELETON, ("zyx",) * len(NAMES), euler, positions, 1 / RATE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Six recorded clips of two styles, four with speech; a group as it is, one frozen, one trembling."""
    place = tmp_path_factory.mktemp("evaluate")
    draw = np.random.default_rng(0)
    for name in ("truth", "same", "frozen", "trembling"):
        (place / name).mkdir()
    for k in range(6):
        clip = clip_of(k)
        bvh.write(place / "truth" / f"c{k}.bvh", clip)
        if k < 4:
            beat = (np.arange(64000) % 6400 < 1600) * draw.normal(scale=0.2, size=64000)
            wav.write(place / "truth" / f"c{k}.wav", beat)
        (place / "truth" / f"c{k}.json").write_text(json.dumps({"style": "ab"[k % 2], "stresses": [0.5, 1.7, 3.0]}))
        still = clip._replace(euler=np.repeat(clip.euler[:1], FRAMES, axis=0))
        shaken = clip._replace(euler=clip.euler + draw.normal(scale=0.02, size=clip.euler.shape))
        bvh.write(place / "same" / f"c{k}.bvh", clip)
        bvh.write(place / "frozen" / f"c{k}__{'ab'[k % 2]}.bvh", still)
        bvh.write(place / "trembling" / f"c{k}.bvh", shaken)
    bvh.write(place / "frozen" / "c5__b.bvh", edit.trim(still, 0, 90))
    notes = {
        "speech": {"name": "speech/c0.wav"}, "arguments": {"styles": ["c2.bvh"]}, "seed": 7, "model_sha256": "abc",
        "inputs_sha256": {"truth/c2.bvh": hashlib.sha256((place / "truth" / "c2.bvh").read_bytes()).hexdigest()},
    }  # fmt: skip
    (place / "trembling" / "c0.provenance.json").write_text(json.dumps(notes))
    return place


@pytest.fixture(scope="module")
def report(folder):
    """The report of the three groups, with a small feature net given."""
    from zeggs_jax.cli import judge
    from zeggs_jax.metrics import movement

    config = feature_net.FeatureNetConfig(features=3, channels=8, steps=30, batch=8)
    motions = [movement.of(bvh.read(path)) for path in sorted((folder / "truth").glob("*.bvh"))]
    np.savez(folder / "net.npz", **net_file.pack(feature_net.train(motions, config)))
    groups = ("same", "frozen", "trembling")
    judge.evaluate(
        tuple(str(folder / group) for group in groups), truth=folder / "truth", out=folder / "report",
        feature_net=folder / "net.npz", players=2, draws=20,
    )  # fmt: skip
    return json.loads((folder / "report" / "report.json").read_text())


def value(report, group, measure):
    return report["groups"][group]["values"][measure]["value"]


def test_it_finds_the_truth_and_its_damage(report):
    assert list(report["groups"]) == ["truth", "same", "frozen", "trembling"]
    assert value(report, "same", "ape") == pytest.approx(0.0, abs=1e-6)
    assert value(report, "same", "fgd") == pytest.approx(0.0, abs=1e-6)
    assert value(report, "frozen", "jerk") == pytest.approx(0.0, abs=1e-3)
    assert value(report, "trembling", "jerk") > 3.0 * value(report, "truth", "jerk")
    assert value(report, "trembling", "hellinger_jerk") > 0.3
    assert value(report, "same", "recognised") == 1.0
    for measure in ("ape", "fgd", "jerk", "hellinger_speed", "frechet_postures"):
        assert report["best"][measure] == ["same"], measure


def test_speech_counts_where_there_is_some(report):
    assert report["groups"]["trembling"]["values"]["energy"]["clips"] == 4
    assert report["groups"]["trembling"]["values"]["stress"]["clips"] == 4
    assert report["groups"]["truth"]["values"]["jerk"]["clips"] == 6


def test_it_says_where_all_comes_from(report):
    origin = report["provenance"]
    assert "net.npz" in origin["feature_net"]
    assert len(origin["recorded_sha256"]) == 6
    assert len(origin["generated_sha256"]) == 18
    assert origin["models"]["same"] == "no provenance beside its clips"
    assert "abc" in origin["models"]["trembling"]


def test_it_tells_what_flatters_or_hampers(report):
    assert "'same' holds a file that is a recorded clip itself." in report["notes"]
    assert any("made with 'c2' as its style example" in note for note in report["notes"])
    assert "'c5__b' of 'frozen' lasts 3.0 s and its recorded clip 4.0 s." in report["notes"]
    few = [note for note in report["notes"] if "intervals of so few" in note]
    assert len(few) == 3
    assert len(report["notes"]) == 3 + len(few)


def test_the_page_plays_truth_beside_every_group(folder, report):
    page = (folder / "report" / "report.html").read_text()
    assert re.findall(r'id="(scene\d+)"', page) == ["scene0", "scene1"]
    scene = json.loads(page.split('id="scene0">')[1].split("</script>")[0])
    assert [figure["label"] for figure in scene["figures"]] == ["truth", "same", "frozen", "trembling"]
    assert len(scene["tracks"]) == 1
    assert not list((folder / "report").glob("*.tmp*")) + list((folder / "report").glob(".*"))


def test_the_net_of_a_report_can_be_used_again(folder, report):
    with np.load(folder / "report" / "feature_net.npz") as arrays:
        assert net_file.unpack(dict(arrays)).fingerprint == report["settings"]["feature_net"]["fingerprint"]


def test_bad_input_is_one_sentence(folder, report, zeggs, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    bvh.write(other / "c9.bvh", clip_of(9))
    (tmp_path / "empty").mkdir()
    (tmp_path / "net.npz").write_bytes(b"no")
    with np.load(folder / "net.npz") as arrays:
        net = net_file.unpack(dict(arrays))
    np.savez(tmp_path / "tailed.npz", **net_file.pack(net._replace(joints=(*net.joints, "Tail"))))
    (tmp_path / "short").mkdir()
    bvh.write(tmp_path / "short" / "c1.bvh", edit.trim(clip_of(1), 0, 3))
    truth, same, out = folder / "truth", folder / "same", tmp_path / "out"
    for words, told in (
        ((other, "--truth", truth), "none of the generated clips goes with a recorded one"),
        ((tmp_path / "empty", "--truth", truth), "holds no clips"),
        ((tmp_path / "short", "--truth", truth), "'c1' of 'short' has 3 frames"),
        ((same, "--truth", tmp_path / "empty"), "holds no clips; put the recorded"),
        ((same, "--truth", tmp_path / "none"), "is no folder"),
        ((f"truth={same}", "--truth", truth), "called 'truth'"),
        ((same, "--truth", truth, "--speech", tmp_path / "none"), "is no folder; give one with the recordings"),
        ((same, "--truth", truth, "--feature-net", tmp_path / "net.npz"), "is no feature net"),
        ((same, "--truth", truth, "--feature-net", tmp_path / "tailed.npz"), "and the motion has"),
        ((same, "--truth", truth, "--feature-net", tmp_path / "none.npz"), "does not exist"),
        ((same, "--truth", truth, "--rate", "0"), "--rate is 0"),
        ((same, "--truth", truth, "--rate", "1e9"), "up to 1000"),
        ((same, "--truth", truth, "--level", "1"), "level 1"),
        ((same, "--truth", truth, "--players", "-1"), "--players is -1"),
        ((same, "--truth", truth, "--seed", "-1"), "--seed is -1"),
        ((f"={same}", "--truth", truth), "a group without a name"),
    ):
        status, _, error = zeggs("evaluate", *words, "-o", out)
        assert status == 2, told
        assert told in error
        assert error.strip().count("\n") == 0, told
        assert "Traceback" not in error
        assert not out.exists(), told


def test_a_single_clip_without_speech_still_makes_a_report(folder, zeggs, tmp_path):
    (tmp_path / "truth").mkdir()
    bvh.write(tmp_path / "truth" / "c1.bvh", clip_of(1))
    bvh.write(tmp_path / "c1__a.bvh", clip_of(3))
    status, _, error = zeggs("evaluate", tmp_path / "c1__a.bvh", "--truth", tmp_path / "truth", "-o", tmp_path / "r")
    assert status == 0, error
    found = json.loads((tmp_path / "r" / "report.json").read_text())
    assert found["groups"]["generated"]["values"]["ape"]["low"] is None
    reasons = {(item["group"], item["measure"]): item["reason"] for item in found["left_out"]}
    assert "too few" in reasons["truth", "fgd"]
    assert {("generated", "recognised"), ("generated", "canonical"), ("truth", "frechet_postures")} <= set(reasons)
    assert all(reason.rstrip().endswith(".") and "\n" not in reason for reason in reasons.values())
