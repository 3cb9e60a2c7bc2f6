"""The demo as a new user runs it, shortened to two styles: files, page, and what the bundle holds."""

import sys

import numpy as np

from zeggs_jax import cli
from zeggs_jax.metrics import kinematic, rhythm
from zeggs_jax.motion import bvh
from zeggs_jax.speech import features, wav
from zeggs_jax.synthetic import ranges
from zeggs_jax.zeroeggs import examples
from zeggs_jax.zeroeggs import generate as g


def test_demo_writes_motion_speech_and_one_page(monkeypatch, tmp_path):
    out = tmp_path / "demo"
    monkeypatch.setattr(sys, "argv", ["zeggs", "demo", "-o", str(out), "--styles", "old", "happy"])
    cli.main()
    names = {path.name for path in out.iterdir()}
    assert {"old.bvh", "happy.bvh", "old.provenance.json", "happy.provenance.json", "speech.wav", "index.html"} == names
    old, happy = (bvh.read(out / f"{style}.bvh") for style in ("old", "happy"))
    assert len(old.euler) == len(happy.euler) == features.frame_count(len(wav.read(out / "speech.wav")), 30.0)
    assert kinematic.hand_speed(happy).mean() > 1.5 * kinematic.hand_speed(old).mean()


def test_the_bundle_is_whole_and_small():
    assert {"neutral", "happy", "sad", "angry", "old", "tired", "relaxed", "still", "scared", "sneaky", "agreement",
            "oration"} <= set(examples.bundled())  # fmt: skip
    assert g.bundled_speech()
    size = sum(path.stat().st_size for path in g.BUNDLE.rglob("*") if path.is_file())
    assert size < 16e6


def test_the_bundled_body_moves_with_the_voice_and_stays_human():
    speech = next(iter(g.bundled_speech().values()))
    clip = g.generate(speech, "angry").clip
    energy = features.frame_energy(wav.read(speech), len(clip.euler), 30.0)
    agreement = rhythm.agreement(kinematic.hand_speed(clip), np.asarray(energy, np.float64), 30.0)
    assert agreement.matched > 0.4
    assert agreement.matched > agreement.shifted + 0.3
    assert ranges.share_outside_range(clip) < 0.01
    assert kinematic.root_drift(clip) < 50.0
