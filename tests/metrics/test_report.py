"""The report: every measure in one table of plain data, truth first, damage where it belongs, reasons for gaps."""

import json

import numpy as np
import pytest

from zeggs_jax.metrics import feature_net, report, scores
from zeggs_jax.metrics.feature_net import FeatureNetConfig
from zeggs_jax.metrics.report import ReportConfig
from zeggs_jax.metrics.scores import Sample

QUICK = ReportConfig(draws=20)
NET = FeatureNetConfig(features=4, channels=8, steps=60, batch=8)


@pytest.fixture(scope="module")
def truth(gesture):
    """Two styles: large and small gestures, six clips of 8 s, with onsets and stresses."""
    draw = np.random.default_rng(0)
    return [
        Sample(
            f"clip{k}",
            gesture(k, size=16.0 if k % 2 else 6.0),
            f"clip{k}",
            "large" if k % 2 else "small",
            np.sort(draw.uniform(0.0, 8.0, 12)),
            np.sort(draw.uniform(0.0, 8.0, 6)),
            draw.uniform(size=240),
        )
        for k in range(6)
    ]


@pytest.fixture(scope="module")
def net(truth):
    return feature_net.train([sample.motion for sample in truth], NET)


@pytest.fixture(scope="module")
def found(truth, net, damage):
    groups = {name: [s._replace(motion=hurt(s.motion)) for s in truth] for name, hurt in {
        "itself": lambda m: m, "frozen": damage["frozen"], "trembling": lambda m: damage["trembling"](m, 1.0),
    }.items()}  # fmt: skip
    groups["two samples"] = [s._replace(name=f"{s.name}_{k}") for s in truth for k in range(2)]
    return report.report(groups, truth, net, QUICK)


def value(found, group, measure):
    return found["groups"][group]["values"][measure]["value"]


def test_it_is_plain_data_with_all_measures(found):
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert list(found["groups"]) == ["truth", "itself", "frozen", "trembling", "two samples"]
    assert set(found["groups"]["two samples"]["values"]) == set(scores.MEASURES) == set(found["measures"])
    assert found["groups"]["truth"]["clips"] == 6
    assert found["groups"]["truth"]["seconds"] == 48.0


def test_it_says_how_it_was_made(found, net):
    assert found["settings"]["draws"] == 20
    assert found["settings"]["rate_hz"] == 30.0
    assert found["settings"]["feature_net"]["fingerprint"] == net.fingerprint
    assert found["settings"]["feature_net"]["seed"] == NET.seed


def test_the_truth_is_without_fault_and_its_own_values_stand_beside(found):
    for measure, best in {"fgd": 0.0, "hellinger_jerk": 0.0, "ape": 0.0, "ave": 0.0, "pck": 1.0, "coverage_dice": 1.0,
                          "canonical": 1.0, "skate": 0.0, "floating": 0.0}.items():  # fmt: skip
        assert value(found, "itself", measure) == pytest.approx(best, abs=1e-6), measure
    for measure in ("jerk", "l1", "energy", "stress", "diversity"):
        assert value(found, "itself", measure) == value(found, "truth", measure), measure
    assert value(found, "truth", "recognised") == 1.0
    assert value(found, "truth", "fgd") > 0.0
    assert "ape" not in found["groups"]["truth"]["values"]


def test_damage_shows_where_it_belongs(found):
    for measure in ("fgd", "frechet_postures", "hellinger_speed", "ave"):
        assert value(found, "frozen", measure) > value(found, "itself", measure) + 0.01, measure
    for measure in ("jerk", "l1", "stress"):
        assert value(found, "frozen", measure) == pytest.approx(0.0, abs=1e-9), measure
    assert value(found, "trembling", "jerk") > 5.0 * value(found, "truth", "jerk")
    assert value(found, "trembling", "skate") > 5.0
    assert value(found, "two samples", "multimodality") == 0.0


def test_values_lie_in_their_intervals(found):
    for group in found["groups"].values():
        for measure, entry in group["values"].items():
            if entry["low"] is not None:
                slack = 1e-9 * abs(entry["value"]) + 1e-9
                assert entry["low"] - slack <= entry["value"] <= entry["high"] + slack, measure
    jerk = found["groups"]["trembling"]["values"]["jerk"]
    assert jerk["low"] < jerk["value"] < jerk["high"]


def test_the_same_seed_is_the_same_report(truth):
    groups = {"g": truth[:3]}
    assert report.report(groups, truth, None, QUICK) == report.report(groups, truth, None, QUICK)


def test_what_cannot_be_measured_is_left_out_with_its_reason(truth):
    bare = [Sample("other", truth[0].motion, "unknown")]
    found = report.report({"g": bare}, truth[:2], None, QUICK)
    reasons = {(r["group"], r["measure"]): r["reason"] for r in found["left_out"]}
    assert "no recorded clip 'unknown'" in reasons["g", "ape"]
    assert "only one recorded clip shows the style" in reasons["truth", "recognised"]
    assert found["settings"]["feature_net"] is None
    values = found["groups"]["g"]["values"]
    assert not {"fgd", "ape", "energy", "stress", "recognised"} & set(values)
    assert values["jerk"]["low"] is None
    json.dumps(found, allow_nan=False)


def test_groups_that_make_no_report_are_refused(truth, gesture):
    with pytest.raises(ValueError, match="called 'truth'"):
        report.report({"truth": truth}, truth)
    with pytest.raises(ValueError, match="'g' has no clips"):
        report.report({"g": []}, truth)
    with pytest.raises(ValueError, match="two clips of the group 'g' are called 'clip0'"):
        report.report({"g": [truth[0], truth[0]]}, truth)
    with pytest.raises(ValueError, match="'clip0' of 'truth' runs at 30 Hz and 'x' of 'g' at 60 Hz"):
        report.report({"g": [Sample("x", gesture(rate_hz=60.0), "clip0")]}, truth)


def test_the_best_group_is_nearest_to_what_is_wanted():
    def row(**values):
        return {name: {"value": value} for name, value in values.items()}

    truth = row(jerk=10.0, stress=0.7, stress_chance=0.5, recognised=0.9)
    calm = row(jerk=8.0, stress=0.6, stress_chance=0.4, ape=3.0, coverage_area=0.7, recognised=0.8, multimodality=1.0)
    wild = row(jerk=90.0, stress=0.9, stress_chance=0.85, ape=3.0, coverage_area=1.1, recognised=0.7, multimodality=2.0)
    best = report.best({"truth": truth, "calm": calm, "wild": wild})
    assert best["jerk"] == best["recognised"] == ["calm"]
    assert best["stress"] == ["calm"], "what is above chance counts, or trembling wins"
    assert best["ape"] == ["calm", "wild"]
    assert best["coverage_area"] == ["wild"]
    assert "multimodality" not in best
    assert report.best({"truth": truth, "calm": calm}) == {}
    lively = {"jerk": {"value": 90.0, "recorded": 95.0}}
    assert report.best({"truth": truth, "calm": calm, "lively": lively})["jerk"] == ["calm"], "2 away beats 5 away"
    calm["jerk"]["recorded"] = 1.0
    assert report.best({"truth": truth, "calm": calm, "lively": lively})["jerk"] == ["lively"], "its own clips count"


def test_each_clip_is_told_and_pictures_hold_all_clips(truth, damage):
    frozen = [sample._replace(motion=damage["frozen"](sample.motion)) for sample in truth]
    found = report.report({"frozen": frozen}, truth, None, QUICK, pictures=True)
    each = found["groups"]["frozen"]["each"]
    assert [clip["name"] for clip in each] == [sample.name for sample in truth]
    assert np.mean([clip["values"]["ape"] for clip in each]) == pytest.approx(value(found, "frozen", "ape"))
    assert {clip["recognised_as"] for clip in each} <= {"large", "small"}
    for name, item in found["histograms"].items():
        shares = {group: np.array(values) for group, values in item["shares"].items()}
        assert shares["truth"].sum() == pytest.approx(1.0, abs=1e-4)
        assert shares["frozen"][0] == 1.0
        apart = np.sqrt(1.0 - np.sqrt(shares["truth"] * shares["frozen"]).sum())
        assert apart == pytest.approx(value(found, "frozen", f"hellinger_{name}"), abs=1e-3)
    rows = {group: np.array([list(map(int, row)) for row in rows]) for group, rows in found["maps"]["rows"].items()}
    assert rows["truth"].max() == 9
    assert rows["frozen"].sum() < rows["truth"].sum()


def test_where_a_body_looks_does_not_count(truth):
    """Its first pose is given to it."""
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    turned = [
        s._replace(motion=s.motion._replace(positions=s.motion.positions @ turn + [50.0, 0.0, -30.0])) for s in truth
    ]
    found = report.report({"turned": turned}, truth, None, QUICK)
    for measure, wanted in {"ape": 0.0, "ave": 0.0, "pck": 1.0, "frechet_postures": 0.0}.items():
        assert value(found, "turned", measure) == pytest.approx(wanted, abs=1e-6), measure
    assert value(found, "turned", "coverage_dice") > 0.98  # rounding moves what lies on the edge of a cell


def test_styles_of_one_recorded_clip_are_told_and_the_others_recognised(truth):
    lone = [*truth, truth[0]._replace(name="lone", speech="lone", style="rare")]
    found = report.report({"g": lone}, lone, None, QUICK)
    assert found["groups"]["g"]["values"]["recognised"]["clips"] == 6
    assert any("only one recorded clip shows the style 'rare'" in item["reason"] for item in found["left_out"])
    lone += [truth[0]._replace(name=name, speech=name, style=name) for name in ("rarer", "rarest")]
    told = [x["reason"] for x in report.report({"g": lone}, lone, None, QUICK)["left_out"] if x["group"] == "g"]
    assert [reason for reason in told if "'rare' (likewise 2 others)" in reason] == told, "one sentence for all"


def test_two_styles_for_one_speech_are_no_two_samples(truth):
    made = [s._replace(name=f"{s.name}_{style}", style=style) for s in truth for style in ("large", "small")]
    found = report.report({"styles": made}, truth, None, QUICK)
    assert "multimodality" not in found["groups"]["styles"]["values"]


def test_a_body_in_the_air_does_not_win_at_skating(truth):
    lift = np.array([0.0, 50.0, 0.0])
    up = [s._replace(motion=s.motion._replace(positions=s.motion.positions + lift)) for s in truth]
    found = report.report({"up": up, "down": truth}, truth, None, QUICK)
    assert "skate" not in found["groups"]["up"]["values"]
    assert value(found, "up", "floating") == 1.0
    assert any(item["group"] == "up" and item["measure"] == "skate" for item in found["left_out"])


def test_one_recorded_clip_says_nothing_of_variety(truth):
    found = report.report({"g": truth}, truth[:1], None, QUICK)
    assert "diversity" not in found["groups"]["g"]["values"]
    assert any("all alike" in item["reason"] for item in found["left_out"])
