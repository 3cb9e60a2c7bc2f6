"""What 15 and 16 make of their rows: shares, deviations over samplings, ranks the right way round; one change each."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[1] / "experiments"
sys.path.insert(0, str(FOLDER))

import findings  # noqa: E402
import guided  # noqa: E402
from zeggs_jax.diffuclip.config import SMALL  # noqa: E402
from zeggs_jax.synthetic import styles  # noqa: E402


def sra(sampling: int, seen: list[str]) -> dict:
    return {"kind": "sra", "prompt": "motion", "sampling": sampling, "made": ["old", "sad"], "seen": seen}


JUDGES = {"kind": "judges", "head": "words", "judges": {"whole": {"own": 0.9, "clips": 9, "styles": ["old", "sad"]}}}


def test_sra_is_a_mean_over_samplings_with_its_deviation_and_tells_what_is_mistaken():
    rows = [JUDGES, sra(0, ["old", "sad"]), sra(1, ["old", "old"]), sra(2, ["old", "old"])]
    found = findings.summary(rows)["sra"]
    of = found["kinds"]["motion"]
    assert of["mean"] == pytest.approx(2 / 3)
    assert of["sd"] == pytest.approx(np.std([1.0, 0.5, 0.5]))
    assert of["styles"] == pytest.approx({"old": 1.0, "sad": 1 / 3})
    assert of["taken"] == ["sad for old (2)"]
    assert found["chance"] == 0.5
    assert "66.7% ± 23.6%" in findings.tables({"sra": found})


def test_guidance_counts_the_way_that_the_style_goes():
    down = [-0.1 * s for s in guided.SCALES]
    row = {"kind": "guidance", "style": "sad", "factor": "hand_height", "sampling": 0, "read": down}
    for sign in (-1.0, 1.0):
        found = findings.summary([row | {"sign": sign}])["guidance"]["sad"]
        assert found["rank"] == pytest.approx(-sign)


@pytest.mark.parametrize("style", styles.TRAINING)
def test_the_factor_of_a_style_is_one_in_which_it_is_far_from_the_mean(style):
    name, sign = guided.factor_of(style)
    rest = [getattr(styles.STYLES[other], name) for other in styles.TRAINING if other != style]
    assert sign * (getattr(styles.STYLES[style], name) - np.mean(rest)) > 0


def test_halves_are_counted_each_by_its_own_prompt_and_by_the_others():
    rows = [
        {"asked": ["happy", "old"], "seen": ["happy", "happy"]},
        {"asked": ["old", "happy"], "seen": ["old", "happy"]},
    ]
    of = findings.summary([{"kind": "halves", "seam": "own", "sampling": 0, "rows": rows}])["halves"]["own"]
    assert [of[name]["mean"] for name in ("upper", "lower", "both")] == [1.0, 0.5, 0.5]
    assert [of[f"{a} as {b}'s"]["mean"] for a, b in (("upper", "lower"), ("lower", "upper"))] == [0.0, 0.5]


def test_changes_are_within_where_no_peak_is_above_the_truths_percentile():
    truth = {"kind": "true peaks", "clips": 1, "peaks": {"any joint": list(range(101))}}
    made = {
        "kind": "changes",
        "sampling": 0,
        "peaks": {"any joint": [50.0, 96.0]},
        "steady": {"any joint": [10.0, 95.0]},
    }
    of = findings.summary([truth, made])["changes"]["any joint"]
    assert (of["p95"], of["changes"]) == (95.0, 2)
    assert (of["peaks"]["within"], of["steady"]["within"]) == (0.5, 1.0)


def test_parts_without_what_they_are_judged_by_are_left_out():
    assert findings.summary([sra(0, ["old", "sad"])]) == {}


def test_every_ablation_changes_one_setting_and_trains_as_long():
    module = importlib.import_module("16_ablations_diffuclip")
    every = module.variants(SMALL, 500)
    full = every.pop("full")
    assert full.learn_denoiser.steps == 500 >= full.learn_denoiser.warmup
    assert len(every) == 3
    for config in every.values():
        changed = [
            f"{room}.{key}"
            for room in vars(full)
            if hasattr(getattr(full, room), "__dict__")
            for key, value in vars(getattr(full, room)).items()
            if vars(getattr(config, room))[key] != value
        ]
        assert len(changed) == 1
