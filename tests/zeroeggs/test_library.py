"""Style libraries: what is saved is what is read, names lead to styles, and files of all kinds are refused."""

import shutil

import jax
import numpy as np
import pytest

from zeggs_jax.speech import wav
from zeggs_jax.zeroeggs import embedding, examples, generate, style_clip
from zeggs_jax.zeroeggs import library as libraries
from zeggs_jax.zeroeggs.library import Entry, Library
from zeggs_jax.zeroeggs.model import StyleDistribution, ZeroEggsConfig, init


@pytest.fixture(scope="module")
def library(clips, gesturer):
    """Three entries of two labels: old in two halves, and happy."""
    old = str(clips / "old.bvh")
    cuts = ((0, 30), (30, 60), (0, 60))
    return libraries.embed([old, old, clips / "happy.bvh"], gesturer, cuts, ("old", "old", "happy"))


def same(one, other):
    """Equal to the bit, arrays and all."""
    return jax.tree.all(jax.tree.map(lambda a, b: np.array_equal(a, b), one, other))


def test_a_library_saved_is_the_library_read(library, gesturer, tmp_path):
    mixed = Library(library.model, (*library.entries, library.entries[0]._replace(name="x", start=None, frames=None)))
    libraries.save(tmp_path / "a.npz", mixed)
    again = libraries.load(tmp_path / "a.npz", gesturer)
    assert same(again, mixed)
    assert again.entries[-1].start is None
    libraries.save(tmp_path / "b.npz", again)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npz", "b.npz"]


def test_styles_that_are_no_distributions_are_kept_so(library, gesturer, tmp_path):
    plain = [e._replace(distribution=StyleDistribution(e.distribution.mean, None)) for e in library.entries]
    libraries.save(tmp_path / "a.npz", Library(library.model, tuple(plain)))
    again = libraries.load(tmp_path / "a.npz", gesturer)
    assert all(entry.distribution.log_var is None for entry in again.entries)
    assert libraries.centroid(again, "old").distribution.log_var is None


def test_a_point_of_ones_own_stands_beside_the_clips(library, gesturer, tmp_path):
    """A blend has no variance: the file keeps it so, and in a label's mixture it counts as a point."""
    blend = library.entries[0]._replace(name="blend", distribution=StyleDistribution(np.ones(8, np.float32), None))
    libraries.save(tmp_path / "a.npz", Library(library.model, (blend, *library.entries)))
    again = libraries.load(tmp_path / "a.npz", gesturer)
    assert same(again, Library(library.model, (blend, *library.entries)))
    assert again.entries[0].distribution.log_var is None
    of = (blend, library.entries[0])
    mixed = libraries.centroid(Library("", of), "old").distribution
    second = np.exp(of[1].distribution.log_var) / 2
    means = np.array([entry.distribution.mean for entry in of])
    np.testing.assert_allclose(np.exp(mixed.log_var), second + means.var(0), rtol=1e-3)


def test_entries_are_called_after_their_clips(library):
    assert [entry.name for entry in library.entries] == ["old_0-30", "old_30-60", "happy"]
    assert libraries.labels(library) == ("old", "happy")
    assert libraries.names(library) == ("old_0-30", "old_30-60", "happy", "old")
    assert libraries.points(library).shape == (3, 8)


def test_a_label_is_the_mixture_of_its_clips(library):
    first, second, _ = (entry.distribution for entry in library.entries)
    middle = libraries.find(library, "old")
    assert middle.source == "the centroid of 2 clips"
    means, variances = (np.array([first.mean, second.mean]), np.exp([first.log_var, second.log_var]))
    np.testing.assert_allclose(middle.distribution.mean, means.mean(0), atol=1e-6)
    second_moment = (variances + means**2).mean(0)
    np.testing.assert_allclose(np.exp(middle.distribution.log_var), second_moment - means.mean(0) ** 2, rtol=1e-3)
    alone = libraries.centroid(library, "happy").distribution
    np.testing.assert_allclose(alone.mean, library.entries[2].distribution.mean, rtol=1e-6)
    np.testing.assert_allclose(alone.log_var, library.entries[2].distribution.log_var, rtol=1e-4, atol=1e-5)


def test_a_style_without_a_pose_starts_like_its_nearest(library):
    bare = library.entries[0]._replace(name="bare", start=None)
    found = libraries.find(Library("", (bare, *library.entries)), "bare")
    assert same(found.start, library.entries[0].start)
    assert libraries.find(Library("", (bare,)), "bare").start is None


def test_a_corpus_is_embedded_as_its_clips_are(clips, gesturer, tmp_path, capsys):
    for name in ("old", "happy"):
        shutil.copy(clips / f"{name}.bvh", tmp_path / f"{name}_1.bvh")
        wav.write(tmp_path / f"{name}_1.wav", np.random.default_rng(3).normal(size=32_000).astype(np.float32))
    (tmp_path / "corpus.csv").write_text("name,style\nold_1,aged\nhappy_1,glad\n")
    made = libraries.embed([tmp_path], gesturer)
    assert [entry[:4] for entry in made.entries] == [
        ("old_1", "aged", "old_1.bvh", None),
        ("happy_1", "glad", "happy_1.bvh", None),
    ]
    assert same(made.entries[0].distribution, style_clip.read_clip(clips / "old.bvh", gesturer).distribution)
    assert "embedding: 100%" in capsys.readouterr().err


def test_long_clips_of_a_corpus_come_in_pieces(clips, gesturer, tmp_path, monkeypatch):
    shutil.copy(clips / "old.bvh", tmp_path / "long.bvh")
    wav.write(tmp_path / "long.wav", np.random.default_rng(3).normal(size=32_000).astype(np.float32))
    monkeypatch.setattr(embedding, "PIECE", 25)
    made = libraries.embed_corpus(tmp_path, gesturer)
    assert [(entry.name, entry.frames) for entry in made.entries] == [
        ("long_0-20", (0, 20)),
        ("long_20-40", (20, 40)),
        ("long_40-60", (40, 60)),
    ]
    cut = style_clip.read_clip(clips / "old.bvh", gesturer, (20, 40))
    assert same(made.entries[1].distribution, cut.distribution)


def test_libraries_join(library, clips, gesturer, tmp_path):
    libraries.save(tmp_path / "a.npz", library)
    joined = libraries.embed([tmp_path / "a.npz", clips / "old.bvh"], gesturer)
    assert [entry.name for entry in joined.entries] == ["old_0-30", "old_30-60", "happy", "old"]
    assert same(joined.entries[:3], library.entries)


def test_padding_changes_no_embedding(clips, gesturer, monkeypatch):
    motion = style_clip.read_motion(clips / "old.bvh", gesturer)
    padded = style_clip.encode(gesturer, motion)
    monkeypatch.setattr(style_clip, "PADDING", 1)
    np.testing.assert_allclose(style_clip.encode(gesturer, motion).mean, padded.mean, atol=2e-6)


def test_a_style_is_found_by_every_name(library, clips, gesturer, tmp_path):
    libraries.save(tmp_path / "many.npz", library)
    libraries.save(tmp_path / "one.npz", Library(library.model, library.entries[:1]))
    libraries.save(tmp_path / "old.npz", Library(library.model, library.entries[:2]))
    read = lambda name, **more: examples.read(name, gesturer, **more).distribution.mean  # noqa: E731
    first, middle = library.entries[0].distribution.mean, libraries.find(library, "old").distribution.mean
    assert same(read(tmp_path / "one.npz"), first)
    assert same(read(f"{tmp_path / 'many.npz'}:old_0-30"), first)
    assert same(read(f"{tmp_path / 'many.npz'}:old"), middle)
    assert same(read(tmp_path / "old.npz"), middle)
    assert same(read("old", library=library), middle)
    assert same(read("old"), style_clip.read_clip(examples.bundled()["old"], gesturer).distribution.mean)


@pytest.mark.parametrize(
    ("sources", "settings", "sentence"),
    [
        ((), {}, "the library is empty"),
        (("old.bvh", "old.bvh"), {}, "has 2 entries called 'old'"),
        (("old.bvh",), {"frames": ((0, 9), (9, 20))}, "got 2 frame ranges for 1 sources"),
        (("old.bvh",), {"labels": ("a", "b")}, "got 2 labels for 1 sources"),
        (("odl.bvh",), {}, "odl.bvh"),
        (("hapy",), {}, "unknown style '.*hapy'.*nearest: happy"),
        ((".",), {"frames": ((0, 9),)}, "is no clip and has no frames"),
        ((".",), {}, "holds no pairs"),
    ],
)
def test_what_cannot_be_embedded(clips, gesturer, tmp_path, sources, settings, sentence):
    places = [str(clips / name) if name.endswith("bvh") else str(tmp_path / name) for name in sources]
    places = [name.replace(f"{tmp_path}/", "") if name.endswith("hapy") else name for name in places]
    with pytest.raises((ValueError, OSError), match=sentence):
        libraries.embed(places, gesturer, **settings)


def test_files_that_are_no_library(library, gesturer, tmp_path):
    whole = libraries.save(tmp_path / "whole.npz", library).read_bytes()
    (tmp_path / "text.npz").write_text("no library")
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    with (tmp_path / "other.npz").open("wb") as file:
        np.savez(file, mean=np.zeros(3))
    np.savez(tmp_path / "array.npz", format="zeggs style library 2")
    with np.load(tmp_path / "whole.npz") as stored:
        columns = {key: stored[key] for key in stored.files}
    for name, damage in {
        "short.npz": {"styles": columns["styles"][:1]},
        "nan.npz": {"mean": columns["mean"] * np.nan},
        "log_var.npz": {"log_var": columns["log_var"][:1]},
    }.items():
        np.savez(tmp_path / name, **{**columns, **damage})
    for path in sorted(tmp_path.glob("*.npz")):
        if path.name != "whole.npz":
            with pytest.raises(ValueError, match=rf"'.*{path.name}' is not a style library, or damaged; make one with"):
                libraries.load(path, gesturer)
    with pytest.raises(FileNotFoundError, match=r"style library '.*gone.npz' does not exist"):
        libraries.load(tmp_path / "gone.npz", gesturer)


def test_a_library_of_another_checkpoint_or_with_two_of_a_name(library, gesturer, tmp_path):
    libraries.save(tmp_path / "a.npz", library)
    other = gesturer._replace(params=init(jax.random.key(9), gesturer.config))
    with pytest.raises(ValueError, match=r"'a.npz' was made with another checkpoint; embed its clips again"):
        libraries.load(tmp_path / "a.npz", other)
    with pytest.raises(ValueError, match=r"library.npz' was made with another checkpoint"):
        libraries.bundled(gesturer)
    twice = Library(library.model, library.entries[:1] * 2)
    with pytest.raises(ValueError, match=r"'b.npz' has 2 entries called 'old_0-30'"):
        libraries.save(tmp_path / "b.npz", twice)
    with pytest.raises(ValueError, match=r"give one that ends in .npz"):
        libraries.save(tmp_path / "b.bvh", library)
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_names_that_lead_nowhere(library, clips, gesturer, tmp_path):
    libraries.save(tmp_path / "a.npz", library)
    place = str(tmp_path / "a.npz")
    for name, sentence in {
        place: r"a.npz' holds 2 styles; name one as '.*a.npz:NAME', such as old_0-30",
        f"{place}:hapy": r"unknown style 'hapy'.*nearest: happy",
    }.items():
        with pytest.raises(ValueError, match=sentence):
            examples.read(name, gesturer)
    with pytest.raises(ValueError, match=r"a saved embedding and has no frames"):
        examples.read(f"{place}:old", gesturer, frames=(0, 9))


def test_a_model_of_labels_has_its_labels(gesturer, clips):
    config = ZeroEggsConfig(labels=("calm", "wild"), style=type(gesturer.config.style)(kind="label"))
    model = gesturer._replace(config=config)
    entry = examples.read("wild", model)
    assert entry == Entry("wild", "wild", "a label", None, entry.distribution, None)
    np.testing.assert_array_equal(entry.distribution.mean, [0.0, 1.0])
    with pytest.raises(ValueError, match=r"steered by labels, which have no embeddings"):
        libraries.embed([clips / "old.bvh"], model)
    with pytest.raises(ValueError, match=r"unknown style 'wlid'.*nearest: wild"):
        examples.read("wlid", model)


def test_the_bundled_library_is_of_the_bundled_model():
    from zeggs_jax.zeroeggs import generate as g

    model = g.bundled_model()
    assert libraries.is_bundled(model)
    found = libraries.bundled(model)
    assert {entry.name for entry in found.entries if entry.start is not None} == set(examples.bundled())
    assert len(found.entries) > 100
    assert libraries.BUNDLED.stat().st_size < 300_000
    assert not any(entry.source.startswith("/") for entry in found.entries)
    happy = style_clip.read_clip(examples.bundled()["happy"], model)
    np.testing.assert_allclose(libraries.find(found, "happy").distribution.mean, happy.distribution.mean, atol=1e-4)


def test_a_bundled_style_comes_from_the_library_as_its_clip_would(monkeypatch):
    model = generate.bundled_model()
    clip = style_clip.read_clip(examples.bundled()["happy"], model)
    monkeypatch.setattr(embedding, "read_clip", None)  # not read again
    found = examples.read("happy", model)
    for stored, read in zip(
        jax.tree.leaves((found.distribution, found.start)),
        jax.tree.leaves((clip.distribution, clip.start)),
        strict=True,
    ):
        np.testing.assert_allclose(stored, read, atol=1e-5)
