"""What 12_control.py is built of: monotone walks are told from others, planted jumps are found, tables are renewed."""

import jax.numpy as jnp
import numpy as np
import pytest

import control
import instrument
import ledger
import promises
import sweeps
import transitions
import truth
from zeggs_jax.motion import bvh, edit
from zeggs_jax.synthetic import styles
from zeggs_jax.zeroeggs import generate as g
from zeggs_jax.zeroeggs import library, style_space
from zeggs_jax.zeroeggs.style_clip import bundled_clips

LINE = np.linspace(0.0, 1.0, 9)


def walked(a: str, b: str, noise: float = 0.0) -> list[dict[str, float]]:
    """What a perfect model shows on the way between two styles, and what a noisy one does."""
    start, end = np.array(styles.STYLES[a]), np.array(styles.STYLES[b])
    shaken = noise * truth.SPAN * np.random.default_rng(0).normal(size=(len(LINE), len(start)))
    values = start + LINE[:, None] * (end - start) + shaken
    known = [dict(zip((sweeps.FACTOR + name for name in truth.NAMES), row, strict=True)) for row in values.tolist()]
    return [{**row, "lean": float(-k), "hand speed": 1.0} for k, row in enumerate(known)]


def test_a_perfect_walk_is_steady_in_every_factor_in_which_the_styles_differ():
    row = control.interpolation({"a": "old", "b": "happy", "shown": walked("old", "happy")})
    assert sorted(row["steady"]) == sorted(row["differ"])
    assert "tempo" in row["steady"]
    assert row["moving"] == ["lean"]  # what does not move at all is not steady


def test_a_walk_the_wrong_way_or_of_noise_is_not_steady():
    back = control.interpolation({"a": "old", "b": "happy", "shown": walked("happy", "old")})
    assert back["steady"] == []
    noisy = control.interpolation({"a": "old", "b": "happy", "shown": walked("old", "happy", noise=3.0)})
    assert len(noisy["steady"]) < promises.FACTORS


def test_intensity_goes_from_what_the_centre_shows_to_the_style():
    shown = walked("neutral", "old")
    row = control.intensity({"style": "old", "shown": shown})
    assert set(row["steady"]) == set(sweeps.towards(styles.STYLES["neutral"], styles.STYLES["old"]))


@pytest.mark.parametrize(
    ("hands", "met"), [([0.0, 1.0, 2.0], True), ([0.1, 1.0, 2.0], False), ([0.0, 2.0, 1.0], False)]
)
def test_samples_must_differ_more_with_temperature_and_not_at_all_without(hands, met):
    rows = [
        {"style": style, "temperature": t, "hands_cm": h, "diversity": h}
        for style in "ab"
        for t, h in zip((0.0, 1.0, 2.0), hands, strict=True)
    ]
    assert promises._samples(control.samples(rows))["met"] is met


def test_recognition_counts_clips_and_pairs():
    draw = np.random.default_rng(0)
    centres = {"a": np.zeros(4), "b": np.full(4, 9.0), "c": np.full(4, -9.0)}
    real = [{"style": s, "row": (c + draw.normal(size=4)).tolist()} for s, c in centres.items() for _ in range(4)]
    made = {"speech": "x", "rows": {s: c.tolist() for s, c in centres.items()} | {"c": [9.0] * 4}}
    found = control.recognised([made], real)
    assert found["accuracy"] == pytest.approx(2 / 3)
    assert found["pairs"] == pytest.approx(1 / 3)  # a and b; not a and c, b and c
    assert found["taken"] == ["c for b"]


@pytest.fixture(scope="module")
def still():
    """Ten seconds of a body that stands as it is."""
    stand = edit.trim(bvh.read(bundled_clips()["still"]), 0, 1)
    return stand._replace(euler=np.tile(stand.euler, (300, 1, 1)), positions=np.tile(stand.positions, (300, 1, 1)))


@pytest.mark.parametrize("at", [60, 61, 119])
def test_a_planted_jump_is_found_in_its_window_alone(still, at, monkeypatch):
    """A step of 3 cm at 30 Hz is 3 x 30^2 cm/s^2 in two differences; local positions stand for those in world."""
    monkeypatch.setattr(transitions.kinematic, "world_positions", lambda clip: clip.positions)
    positions = still.positions.copy()
    positions[at:, :, 0] += 3.0
    found = transitions.peaks(still._replace(positions=positions), [0.0, 2.0, 4.0])
    for part in found.values():
        assert part[1] == pytest.approx(2700.0, rel=1e-3)
        assert max(part[0], part[2]) < 1.0 or at in (60, 119)
    assert len(transitions.all_peaks(still)["any joint"]) == 5


def test_minutes_play_five_styles_in_orders_of_their_own():
    drawn = transitions.orders(list(styles.STYLES), 6)
    assert all(len(set(order)) == transitions.STYLES for order in drawn)
    assert len({tuple(order) for order in drawn}) == 6
    assert drawn[:2] == transitions.orders(list(styles.STYLES), 2)
    for kind in transitions.KINDS:
        transitions.of_styles(drawn[0], kind)


@pytest.mark.slow
def test_all_at_once_is_the_same_as_one_after_the_other():
    model = g.bundled_model()
    known = library.bundled(model)
    chosen = [library.find(known, name) for name in ("old", "happy")]
    spectrum = g.read_speech(np.random.default_rng(0).normal(size=16000).astype(np.float32) * 0.1, model)
    points = jnp.stack([entry.distribution.mean for entry in chosen])
    clips = sweeps.perform(model, spectrum, points, [entry.start for entry in chosen])
    for entry, clip in zip(chosen, clips, strict=True):
        assert entry.start is not None
        held = style_space.hold(entry.distribution.mean, len(spectrum))
        alone = g.synthesize(model, spectrum, held, entry.start)
        np.testing.assert_allclose(clip.positions[:, 0], np.asarray(alone.root.pos), atol=1e-3)
    with pytest.raises(ValueError, match="no first pose"):
        sweeps.perform(model, spectrum, points, [None, None])


def test_rank_correlations_see_order_alone():
    rows = [{"up": float(k**3), "down": -float(np.sqrt(k)), "flat": 1.0} for k in range(9)]
    assert instrument.rank_correlations(range(9), rows) == pytest.approx({"up": 1.0, "down": -1.0, "flat": 0.0})


def test_tables_are_renewed_between_their_marks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- x -->\nold\n<!-- x -->\nafter\n")
    ledger.renew(page, "x", "new")
    assert page.read_text() == "before\n<!-- x -->\nnew\n<!-- x -->\nafter\n"
    with pytest.raises(ValueError, match="has 0 lines '<!-- y -->'; put two"):
        ledger.renew(page, "y", "new")
