"""`zeggs diffuclip` and its demo on a tiny model: what they write, and one sentence for each wrong input."""

import dataclasses
import json
from itertools import pairwise

import jax
import numpy as np
import pytest
import soundfile

from zeggs_jax.cli import prompted
from zeggs_jax.diffuclip import generate as g
from zeggs_jax.diffuclip import model as models
from zeggs_jax.diffuclip import request
from zeggs_jax.diffuclip.checkpoints import save_model
from zeggs_jax.motion import bvh
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.zeroeggs import generate as zeroeggs

pytestmark = pytest.mark.slow  # networks compile for a minute

WORDS = [("A", 0.1, 0.2), ("big", 0.3, 0.6), ("dog.", 0.6, 0.9), ("It", 1.1, 1.2), ("runs.", 1.3, 1.6)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, tiny_model, clip, draw):
    """A model, a speech of 2 s with its words, prompts of each kind, and everything that can be wrong with them."""
    where = tmp_path_factory.mktemp("diffuclip")
    save_model(where / "model", tiny_model)
    config, body = dataclasses.replace(tiny_model.config, parts=()), tiny_model.skeleton
    whole = tiny_model._replace(config=config, params=draw(lambda key: models.init(key, config, body), body))
    half = jax.tree.map(lambda leaf: leaf[: config.latent_size], whole.latent_scale)
    whole.params["prompts"]["known"] = tiny_model.params["prompts"]["known"]
    save_model(where / "whole", whole._replace(latent_scale=half))
    noise = np.random.default_rng(0).normal(size=32000)
    soundfile.write(where / "speech.wav", 0.1 * noise * np.sin(np.arange(32000) / 4000), 16000)
    (where / "text.wav").write_text("this is no sound")
    words = [dict(zip(("text", "start", "end"), word, strict=True)) for word in WORDS]
    (where / "words.json").write_text(json.dumps({"words": words}))
    (where / "later.json").write_text(json.dumps({"words": [{"text": "late", "start": 8, "end": 9}]}))
    (where / "words.txt").write_text("A big dog. It runs.")
    (where / "long.txt").write_text("monologues " * 60)
    (where / "words.doc").write_text("a big dog")
    bvh.write(where / "clip.bvh", clip)
    names = (*clip.skeleton.names[:-1], "Tail")
    other = Skeleton(names, clip.skeleton.parents, clip.skeleton.offsets)
    bvh.write(where / "other.bvh", clip._replace(skeleton=other))
    (where / "broken.mp4").write_bytes(b"no video at all" * 50)
    timelines = {
        "cues": {"cues": [{"time": 0, "prompt": "sad"}, {"time": 1, "prompt": "happy"}]},
        "sentences": {"sentences": ["sad", "happy"]},
        "late": {"cues": [{"time": 0, "prompt": "sad"}, {"time": 5, "prompt": "happy"}]},
        "begins": {"cues": [{"time": 1, "prompt": "sad"}]},
        "empty": {"cues": [{"time": 0, "prompt": " "}]},
        "form": {"styles": ["old"]},
    }
    for name, content in timelines.items():
        (where / f"{name}.timeline").write_text(json.dumps(content))
    (where / "text.timeline").write_text("sad, then happy")
    (where / "unfinished").mkdir()
    (where / "unfinished" / "config.json").write_text("{}")
    (where / "nothing").mkdir()
    return where


def made(zeggs, folder, out, *words):
    """The clip of a command line, which must succeed, and what was noted."""
    start = ("diffuclip", "generate", folder / "speech.wav", "--checkpoint", folder / "model", "--steps", "2")
    status, _, noted = zeggs(*start, "-o", out, *words)
    assert status == 0, noted
    return bvh.read(out), noted


def test_generate_writes_motion_provenance_and_a_page_with_its_words(zeggs, folder, tmp_path):
    out, page = tmp_path / "new" / "out.bvh", tmp_path / "page.html"
    words = ("--prompt", "an old person", "--transcript", folder / "words.json", "--html", page)
    clip, _ = made(zeggs, folder, out, *words)
    assert clip.euler.shape == (60, 13, 3)
    assert np.isfinite(clip.euler).all()
    told = json.loads(out.with_suffix(".provenance.json").read_text())["arguments"]
    assert (told["prompt"], told["steps"], told["transcript"]) == ("an old person", 2, str(folder / "words.json"))
    assert '["big",0.3,0.6]' in page.read_text()
    assert "an old person" in page.read_text()
    assert {path.name for path in tmp_path.rglob("*")} == {"new", "out.bvh", "out.provenance.json", "page.html"}


@pytest.mark.parametrize("prompt", [*("happy", "clip.bvh"), pytest.param("clip.mp4", marks=pytest.mark.slow)])
def test_every_kind_of_prompt_is_followed_and_the_seed_decides(zeggs, folder, tmp_path, prompt):
    if prompt.endswith(".mp4"):
        pytest.importorskip("av")
        from zeggs_jax.diffuclip import video

        pictures = np.linspace(0, 1, 12)[:, None, None, None] * np.ones((16, 16, 3))
        video.write(folder / prompt, pictures.astype(np.float32), 8.0)
    asked = str(folder / prompt) if "." in prompt else prompt
    first, again, other, without = (
        made(zeggs, folder, tmp_path / f"{k}.bvh", *words)[0].euler
        for k, words in enumerate([("--prompt", asked), ("--prompt", asked), ("--prompt", asked, "--seed", "2"), ()])
    )
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3
    assert np.abs(first - without).max() > 1e-3


def test_a_page_names_the_file_of_a_prompt_and_not_its_folder(zeggs, folder, tmp_path):
    given = ("--upper", folder / "clip.bvh", "--prompt", "sad", "--html", tmp_path / "a.html")
    made(zeggs, folder, tmp_path / "a.bvh", *given)
    page = (tmp_path / "a.html").read_text()
    assert "clip.bvh" in page
    assert str(folder) not in page


@pytest.mark.slow
def test_parts_and_timelines_are_the_requests(zeggs, folder, tmp_path, tiny_model):
    words = folder / "words.json"
    flags = {
        ("--upper", "happy", "--lower", "sad"): g.Request(parts=(("upper", "happy"), ("lower", "sad")), steps=2),
        ("--timeline", folder / "cues.timeline"): g.Request(timeline=(g.Cue(0.0, "sad"), g.Cue(1.0, "happy")), steps=2),
        ("--timeline", folder / "sentences.timeline", "--transcript", words): g.Request(
            timeline=(g.Cue(0.0, "sad"), g.Cue(1.1, "happy")), transcript=str(words), steps=2
        ),
        ("--solver", "ddim", "--chunk", "2", "--scale", "0.5", "--prompt", "sad"): g.Request(
            "sad", solver="ddim", chunk=2, scale=0.5, steps=2
        ),
    }
    for given, asked in flags.items():
        found, _ = made(zeggs, folder, tmp_path / "found.bvh", *given)
        g.save(tmp_path / "wanted.bvh", g.generate(folder / "speech.wav", asked, model=tiny_model))
        assert (tmp_path / "wanted.bvh").read_bytes() == (tmp_path / "found.bvh").read_bytes(), given
        assert len(found.euler) == 60


def test_a_text_without_times_is_noted_and_parts_prompts(zeggs, folder, tmp_path):
    given = ("--transcript", folder / "words.txt", "--timeline", folder / "sentences.timeline")
    _, noted = made(zeggs, folder, tmp_path / "a.bvh", *given)
    assert "words.txt' has no times" in noted


def test_a_prompt_over_the_limit_is_cut_with_a_note(zeggs, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("zeggs_jax.diffuclip.wording.installed", lambda: False)
    long = " ".join(["slowly"] * 60)
    _, noted = made(zeggs, folder, tmp_path / "a.bvh", "--prompt", long)
    assert "zeggs: note:" in noted
    assert "60 words" in noted


WRONG = [
    (("--prompt", ""), "the prompt is empty"),
    (("--prompt", "  "), "the prompt is empty"),
    (("--prompt", "?!"), "has no words"),
    (("--upper", ""), "the prompt is empty"),
    (("--prompt", "{f}/none.bvh"), "none.bvh"),
    (("--prompt", "{f}/other.bvh"), "other.bvh"),
    (("--prompt", "old", "--timeline", "{f}/cues.timeline"), "a prompt and a timeline"),
    (("--upper", "old", "--timeline", "{f}/cues.timeline"), "a timeline and prompts for parts"),
    (("--timeline", "{f}/none.timeline"), "none.timeline"),
    (("--timeline", "{f}/text.timeline"), "is not JSON"),
    (("--timeline", "{f}/form.timeline"), "no prompts in a known form"),
    (("--timeline", "{f}/empty.timeline"), "is empty; say how the body moves"),
    (("--timeline", "{f}/begins.timeline"), "let it begin at 0"),
    (("--timeline", "{f}/late.timeline"), "a prompt at 5 s, but the speech lasts 2.0 s"),
    (("--timeline", "{f}/sentences.timeline"), "give the --transcript"),
    (("--transcript", "{f}/none.json"), "none.json' does not exist"),
    (("--transcript", "{f}/words.doc"), "no transcript that can be read"),
    (("--transcript", "{f}/later.json"), "'late' at 9.0 s, but the speech lasts 2.0 s"),
    (("--transcript", "{f}/cues.timeline"), "no transcript that can be read"),
    (("--scale=-1", "--prompt", "old"), "guidance scale is -1"),
    (("--scale", "nan"), "guidance scale is nan"),
    (("--steps", "0"), "0 steps"),
    (("--chunk", "0"), "chunks of 0"),
    (("--chunk", "10000"), "learnt from windows of 112; give at most so many"),
    (("--seed", "99999999999999999999"), "the seed is 9999"),
    (("--seed", "-1"), "the seed is -1"),
    (("--steps", "-3"), "-3 steps were asked for"),
    (("--steps", "41"), "this model's process has 40"),
    (("--upper", "old", "--seam", "nan"), "the seam's weight is nan"),
    (("--upper", "old", "--seam=-1"), "the seam's weight is -1"),
    (("--transcript", "{f}/long.txt"), "60 words for"),
    (("--checkpoint", "{f}/none"), "holds no model"),
    (("--checkpoint", "{f}/unfinished"), "not finished"),
    (("--checkpoint", str(zeroeggs.BUNDLE / "model")), "is not a GestureDiffuCLIP model"),
    (("--checkpoint", "{f}/whole", "--upper", "old"), "has no such part of the body"),
]


@pytest.mark.parametrize(("words", "sentence"), WRONG)
def test_bad_input_is_one_sentence(zeggs, folder, tmp_path, words, sentence):
    given = [word.replace("{f}", str(folder)) for word in words]
    given += [] if "--checkpoint" in given else ["--checkpoint", folder / "model"]
    complains(
        zeggs, tmp_path, sentence, "diffuclip", "generate", folder / "speech.wav", "-o", tmp_path / "o.bvh", *given
    )


def complains(zeggs, tmp_path, sentence, *words):
    """Exit status 2, one line with this sentence, and no file."""
    status, told, complained = zeggs(*words)
    assert status == 2
    assert not told
    assert len([line for line in complained.splitlines() if line.startswith("zeggs: ")]) == 1, complained
    assert "Traceback" not in complained
    assert sentence in complained
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.parametrize("name", ["broken.mp4", "none.mp4"])
def test_a_video_that_does_not_decode_is_one_sentence(zeggs, folder, tmp_path, name):
    pytest.importorskip("av")
    given = ("--checkpoint", folder / "model", "-o", tmp_path / "o.bvh", "--prompt", folder / name)
    complains(zeggs, tmp_path, name, "diffuclip", "generate", folder / "speech.wav", *given)


@pytest.mark.parametrize(
    ("speech", "out", "sentence"),
    [
        ("none.wav", "o.bvh", "none.wav"),
        ("text.wav", "o.bvh", "text.wav"),
        ("speech.wav", "o.txt", "give one that ends in .bvh"),
        ("speech.wav", "{f}/clip.bvh", "would be written over"),
        ("speech.wav", "{f}", "is a folder"),
    ],
)
def test_names_that_cannot_be_are_one_sentence(zeggs, folder, tmp_path, speech, out, sentence):
    target = out.replace("{f}", str(folder)) if "{f}" in out else tmp_path / out
    given = ("--checkpoint", folder / "model", "--prompt", folder / "clip.bvh", "-o", target)
    complains(zeggs, tmp_path, sentence, "diffuclip", "generate", folder / speech, *given)
    assert len(bvh.read(folder / "clip.bvh").euler) == 90


@pytest.mark.parametrize("flag", ["--html", "--transcript"])
def test_what_tells_of_the_making_is_written_over_nothing_else(zeggs, folder, tmp_path, flag):
    place = tmp_path / "o.provenance.json"
    given = ("--checkpoint", folder / "model", "-o", tmp_path / "o.bvh", flag, place)
    complains(zeggs, tmp_path, "would be written over", "diffuclip", "generate", folder / "speech.wav", *given)


def hugging_face(where, **told):
    where.mkdir(exist_ok=True)
    (where / "config.json").write_text(json.dumps(told))
    (where / "model.safetensors").write_bytes((2).to_bytes(8, "little") + b"{}")
    return where


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("{f}",), "train needs a corpus and --out"),
        (("{f}/none", "-o", "{t}/run", "--small"), "none"),
        (("{f}/nothing", "-o", "{t}/run", "--small"), "nothing"),
        (("{f}", "-o", "{t}/run"), "read T5 but name no folder with it; give --t5 FOLDER"),
        (("{f}", "-o", "{t}/run", "--t5", "{f}/none"), "none' has no config.json"),
        (("{f}", "-o", "{t}/run", "--t5", "{f}/bert"), "of type 'bert', expected 't5'"),
        (("{f}", "-o", "{t}/run", "--t5", "{f}/t5"), "vectors of 512 numbers, the settings expect joint.width = 768"),
        (("{f}", "-o", "{t}/run", "--small", "--clip", "{f}/bert"), "of type 'bert', expected 'clip'"),
        (("{f}", "-o", "{t}/run", "--small", "--clip", "{f}/clip"), "the settings expect prompts.size = 64"),
        (("{f}", "-o", "{t}/run", "--small", "--config", "{f}/words.json"), "--small and --config were given"),
        (("{f}", "-o", "{t}/run", "--config", "{f}/text.timeline"), "are not JSON"),
        (("{f}", "-o", "{t}/run", "--config", "{f}/words.json"), "words"),
        (("{f}", "-o", "{t}/run", "--config", "{f}/none.json"), "none.json"),
        (("{f}", "-o", "{t}/run", "--small", "--scale-steps", "0"), "--scale-steps is 0"),
    ],
)
def test_training_that_cannot_be_is_one_sentence(zeggs, folder, tmp_path, words, sentence):
    hugging_face(folder / "bert", model_type="bert")
    hugging_face(folder / "t5", model_type="t5", d_model=512)
    hugging_face(folder / "clip", model_type="clip", projection_dim=512)
    given = [word.replace("{f}", str(folder)).replace("{t}", str(tmp_path)) for word in words]
    complains(zeggs, tmp_path, sentence, "diffuclip", "train", *given)


def test_settings_are_printed_whole_and_read_back(zeggs, tmp_path):
    status, told, _ = zeggs("diffuclip", "train", "--small", "--scale-steps", "0.01", "--print-config")
    assert status == 0
    assert json.loads(told)["learn_codes"]["steps"] == 40
    (tmp_path / "config.json").write_text(told)
    assert zeggs("diffuclip", "train", "--config", tmp_path / "config.json", "--print-config")[1] == told
    assert json.loads(zeggs("diffuclip", "train", "--print-config")[1])["denoiser"]["width"] == 768


@pytest.mark.slow
def test_the_demo_shows_one_speech_under_many_prompts(zeggs, folder, tmp_path, monkeypatch):
    monkeypatch.setattr(prompted, "PROMPTS", {name: name for name in ("old", "happy", "angry", "sneaky")})
    given = ("--speech", folder / "speech.wav", "--transcript", folder / "words.json", "--checkpoint", folder / "model")
    status, told, complained = zeggs("demo", "--diffuclip", *given, "-o", tmp_path)
    assert status == 0, complained
    assert "index.html" in told
    bodies = sorted(path.stem for path in tmp_path.glob("*.bvh"))
    assert len(bodies) == 12
    assert {"old", "happy", "guidance_0", "guidance_3", "sentences", "angry_over_sneaky"} <= set(bodies)
    page = (tmp_path / "index.html").read_text()
    for tab in ("Four prompts", "Guidance", "By the sentence", "Upper and lower body"):
        assert f'"group":"{tab}"' in page
    motion = {name: bvh.read(tmp_path / f"{name}.bvh").euler for name in bodies}
    assert np.abs(motion["old"] - motion["happy"]).max() > 1e-3
    np.testing.assert_array_equal(motion["guidance_2"], motion["happy"])


def test_the_demo_changes_its_prompt_with_the_sentence_but_not_too_often(folder, tmp_path):
    spoken = [(0.2, 2.0), (2.2, 3.0), (3.2, 6.0), (7.0, 9.5), (9.6, 10.0)]
    words = [{"text": "word.", "start": start, "end": end} for start, end in spoken]
    (tmp_path / "words.json").write_text(json.dumps({"words": words}))
    for transcript, starts in ((tmp_path / "words.json", [0.0, 3.2, 7.0]), (None, [0.0, 5.0])):
        shot = next(
            shot for shot in prompted.shots(folder / "speech.wav", transcript, 11.0, 0) if shot.name == "sentences"
        )
        assert [cue.time for cue in shot.asked.timeline] == starts
        assert all(a.prompt != b.prompt for a, b in pairwise(shot.asked.timeline))
        request.check_cues(shot.asked.timeline)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--diffuclip", "--styles", "old"), "--styles belong to ZeroEGGS"),
        (("--diffuclip", "--transcript", "{f}/words.json"), "--transcript was given without --speech"),
        (("--transcript", "{f}/words.json"), "belong to --diffuclip"),
        (("--diffuclip", "--speech", "{f}/none.wav"), "none.wav"),
        (("--diffuclip", "--speech", "{f}/speech.wav", "--transcript", "{f}/words.doc"), "no transcript"),
    ],
)
def test_a_demo_that_cannot_be_is_one_sentence(zeggs, folder, tmp_path, words, sentence):
    given = [word.replace("{f}", str(folder)) for word in words]
    complains(zeggs, tmp_path, sentence, "demo", "-o", tmp_path / "demo", *given)
