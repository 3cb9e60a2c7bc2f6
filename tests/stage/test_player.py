"""The player's page: whole in itself, true to the motion, sparing with bytes."""

import json
import re

import jax
import numpy as np
import pytest
import soundfile

from zeggs_jax.motion import bvh, features, kinematics
from zeggs_jax.stage import player
from zeggs_jax.stage.player import Figure


def scene_of(path):
    text = path.read_text("utf-8")
    return json.loads(re.search(r'<script type="application/json" id="scene">(.*?)</script>', text, re.S)[1])


def places_on_the_page(figure):
    """World places [T, J, 3] in metres that the page will show at its own frames."""
    joints, frames = len(figure["parents"]), figure["frames"]
    turns = player.unpack(figure["turns"], joints * 4).T.reshape(frames, joints, 4).astype(float)
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    local = np.tile(np.array(figure["offsets"]), (frames, 1, 1))
    moves = player.unpack(figure["moves"], len(figure["moving"]) * 3).T.reshape(frames, -1, 3)
    local[:, figure["moving"]] = np.array(figure["moveMiddle"]) + figure["moveStep"] * moves
    forward = jax.vmap(lambda p, q: kinematics.forward_positions(p, q, tuple(figure["parents"])))
    return np.asarray(forward(local.astype(np.float32), turns.astype(np.float32)))


@pytest.mark.parametrize("rows", [1, 3])
def test_packing_is_lossless(rows):
    values = np.random.default_rng(rows).integers(-32768, 32768, (rows, 257))
    np.testing.assert_array_equal(player.unpack(player.pack(values), rows), values)


def test_the_page_shows_the_motion(tmp_path, clip):
    player.write(tmp_path / "a.html", [Figure("a", clip)])
    (figure,) = scene_of(tmp_path / "a.html")["figures"]
    error = np.abs(places_on_the_page(figure) - 0.01 * features.world_positions(clip)).max()
    assert error < 5e-4  # half a millimetre at the fingertips
    assert figure["frameTime"] == clip.frame_time


def test_translated_joints_are_kept(tmp_path, clip):
    positions = clip.positions.copy()
    positions[:, 2, 1] += 3 * np.sin(np.arange(len(positions)))
    moved = clip._replace(positions=positions)
    player.write(tmp_path / "a.html", [Figure("a", moved)])
    (figure,) = scene_of(tmp_path / "a.html")["figures"]
    assert figure["moving"] == [0, 2]
    assert np.abs(places_on_the_page(figure) - 0.01 * features.world_positions(moved)).max() < 5e-4


@pytest.mark.parametrize(("unit", "metres"), [(1.0, 0.01), (0.01, 1.0), (10.0, 0.001), (1 / 2.54, 0.0254)])
def test_units_are_found_by_the_body_s_height(tmp_path, clip, unit, metres):
    skeleton = type(clip.skeleton)(clip.skeleton.names, clip.skeleton.parents, clip.skeleton.offsets * unit)
    player.write(tmp_path / "a.html", [Figure("a", clip._replace(skeleton=skeleton, positions=clip.positions * unit))])
    (figure,) = scene_of(tmp_path / "a.html")["figures"]
    assert 1.5 < figure["stature"] < 1.9
    np.testing.assert_allclose(figure["offsets"][1], metres * unit * clip.skeleton.offsets[1], atol=2e-5)


def test_frames_above_the_rate_are_left_out(tmp_path, clip):
    fast = clip._replace(frame_time=1 / 120)
    player.write(tmp_path / "a.html", [Figure("a", fast)], max_rate=60.0)
    (figure,) = scene_of(tmp_path / "a.html")["figures"]
    assert (figure["frames"], figure["frameTime"]) == (30, 1 / 60)
    sixty = clip._replace(frame_time=0.016666)  # 60.0024 Hz is 60
    player.write(tmp_path / "b.html", [Figure("b", sixty)])
    assert scene_of(tmp_path / "b.html")["figures"][0]["frames"] == 60


def test_nothing_is_fetched(tmp_path, clip, speech):
    player.write(tmp_path / "a.html", [Figure("a", clip, speech)])
    text = (tmp_path / "a.html").read_text("utf-8")
    assert "default-src 'none'" in text
    assert not re.search(r"https?://|\bsrc\s*=|@import|<link(?! rel=\"icon\" href=\"data:)|fetch\(|XMLHttp|\{\{", text)


def test_names_cannot_break_the_page(tmp_path, clip):
    nasty = "</script><img src=x onerror=alert(1)>{{scene}} & \"'"
    player.write(tmp_path / "a.html", [Figure(nasty, clip)], title=nasty)
    text = (tmp_path / "a.html").read_text("utf-8")
    assert "<img" not in text
    assert text.count("</script>") == 2
    assert "&lt;/script&gt;&lt;img src=x onerror=alert(1)&gt;{{scene}} &amp;" in text
    assert scene_of(tmp_path / "a.html")["figures"][0]["label"] == nasty


def test_shared_speech_is_stored_once(tmp_path, clip, speech):
    soundfile.write(tmp_path / "s.wav", *speech)
    other = (speech[0][::-1].copy(), 16000)
    sounds = [tmp_path / "s.wav", str(tmp_path / "s.wav"), None, other]
    player.write(tmp_path / "a.html", [Figure(str(k), clip, sound) for k, sound in enumerate(sounds)])
    scene = scene_of(tmp_path / "a.html")
    assert [figure["track"] for figure in scene["figures"]] == [0, 0, None, 1]
    assert len(scene["tracks"]) == 2
    heard = player.unpack(scene["tracks"][0]["samples"], 1)[0] / 32767
    np.testing.assert_allclose(heard, speech[0], atol=1e-4)


def test_stereo_and_high_rates_become_a_small_mono(speech):
    stereo = np.repeat(np.stack([speech[0], -0.5 * speech[0]], axis=1), 3, axis=0)
    samples, rate = player.read_speech((stereo, 48000))
    assert rate == 24000
    assert samples.shape == (48000,)


def test_a_minute_of_four_bodies_is_a_few_megabytes(tmp_path, clip):
    t = np.arange(1800) / 30
    joint = np.arange(len(clip.skeleton))[:, None]
    rng = np.random.default_rng(0)
    euler = 0.3 * np.sin(t[:, None, None] * (1 + 0.1 * joint) + np.arange(3)) + 1e-4 * rng.standard_normal(
        (1800, len(joint), 3)
    )
    long = clip._replace(euler=euler, positions=np.tile(clip.positions[:1], (1800, 1, 1)))
    noise = (0.1 * rng.standard_normal(60 * 16000).astype(np.float32), 16000)
    player.write(tmp_path / "a.html", [Figure(str(k), long, noise) for k in range(4)])
    joints_share = 75 / len(clip.skeleton)
    size = (tmp_path / "a.html").stat().st_size
    sound = len(scene_of(tmp_path / "a.html")["tracks"][0]["samples"])
    assert sound < 2.7e6
    assert (size - sound) * joints_share < 6e6


def test_one_frame_is_enough(tmp_path, clip):
    player.write(tmp_path / "a.html", [Figure("a", clip._replace(euler=clip.euler[:1], positions=clip.positions[:1]))])
    assert scene_of(tmp_path / "a.html")["figures"][0]["frames"] == 1


def test_a_file_becomes_a_figure(tmp_path, clip):
    bvh.write(tmp_path / "old man.bvh", clip)
    assert player.read_figure(tmp_path / "old man.bvh").label == "old man"


def test_what_cannot_be_shown_is_said(tmp_path, clip):
    with pytest.raises(ValueError, match="no figures"):
        player.write(tmp_path / "a.html", [])
    with pytest.raises(ValueError, match=r"'x'.*not finite"):
        player.write(tmp_path / "a.html", [Figure("x", clip._replace(euler=clip.euler * np.nan))])
    with pytest.raises(ValueError, match="'x' has no frames"):
        player.write(
            tmp_path / "a.html",
            [Figure("x", clip._replace(euler=clip.euler[:0], positions=clip.positions[:0]))],
        )
    with pytest.raises(FileNotFoundError, match="no sound file"):
        player.write(tmp_path / "a.html", [Figure("x", clip, tmp_path / "none.wav")])
    (tmp_path / "text.wav").write_text("no sound at all")
    with pytest.raises(ValueError, match="not a sound file"):
        player.write(tmp_path / "a.html", [Figure("x", clip, tmp_path / "text.wav")])
    with pytest.raises(OSError, match="cannot be written"):
        player.write(tmp_path / "missing" / "a.html", [Figure("x", clip)])
    assert [p.name for p in tmp_path.iterdir()] == ["text.wav"]
