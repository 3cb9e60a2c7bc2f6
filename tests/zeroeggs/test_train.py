"""Training end to end on a tiny corpus: it learns, resumes to the same numbers, and refuses what does not fit."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data.prepared import load
from zeggs_jax.data.windows import Batch, WindowConfig, batch
from zeggs_jax.training import checkpoint, keep
from zeggs_jax.training.plain import to_dict
from zeggs_jax.training.record import TIMING, read_log
from zeggs_jax.training.step import make_step
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs import objective, run_folder
from zeggs_jax.zeroeggs import train as t
from zeggs_jax.zeroeggs.checkpoints import load_model, save_model

TINY = t.TrainConfig(
    model=m.ZeroEggsConfig(
        speech=m.SpeechEncoderConfig(hidden=6, size=5, kernel=5),
        style=m.StyleEncoderConfig(hidden=8, size=4),
        decoder=m.DecoderConfig(hidden=12, layers=1),
    ),
    windows=WindowConfig(batch=2, window=6, example=(8, 12)),
    steps=6,
    learning_rate=1e-2,
    log_every=1,
    checkpoint_every=3,
    validate_every=0,
    sample_every=0,
)
BY_LABEL = replace(TINY.model, style=m.StyleEncoderConfig(kind="label"), labels=("calm", "wild"))


@pytest.fixture(scope="session")
def run(corpus, tmp_path_factory) -> Path:
    """A finished run of six updates; not to be written to."""
    folder, steps = tmp_path_factory.mktemp("run"), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(t, "make_step", lambda *options: steps.append(make_step(*options)) or steps[-1])
        t.train(corpus, folder, TINY, progress=False)
    assert [step._cache_size() for step in steps] == [1]  # examples of all lengths: one compilation
    return folder


def log_of(run: Path) -> list[dict]:
    """The log without what depends on the clock."""
    return [{key: line[key] for key in line if key not in TIMING} for line in read_log(run / "log.jsonl")]


def test_a_run_leaves_its_log_and_checkpoints(run):
    log = log_of(run)
    assert [line["step"] for line in log] == list(range(6))
    assert len(log[0]) == 1 + 1 + 17 + 1 + 1  # step, loss, terms, kl, gradient
    total = sum(log[3][name] for name in (*objective.Terms._fields, "kl")) / 18
    assert log[3]["loss"] == pytest.approx(total, rel=1e-5)
    assert [path.name for path in keep.checkpoints(run)] == ["step_00000003", "step_00000006"]


def test_a_resumed_run_has_the_numbers_of_an_unbroken_one(run, corpus, tmp_path):
    """As after a kill: the log has lines of updates that no checkpoint holds."""
    killed = tmp_path / "killed"
    shutil.copytree(run, killed)
    checkpoint.remove(keep.checkpoints(killed)[-1])
    state = t.train(corpus, killed, TINY, progress=False)
    assert log_of(killed) == log_of(run)
    ours, theirs = (checkpoint.load(keep.checkpoints(folder)[-1])[0] for folder in (killed, run))
    jax.tree.map(np.testing.assert_array_equal, ours, theirs)
    jax.tree.map(np.testing.assert_array_equal, state.params, theirs["params"])


def test_a_corpus_on_the_device_gives_the_same_updates(run, corpus, tmp_path):
    config = replace(TINY, resident=True)
    t.train(corpus, tmp_path / "run", replace(config, steps=3), progress=False)
    for ours, theirs in zip(log_of(tmp_path / "run"), log_of(run), strict=False):
        assert ours == pytest.approx(theirs, rel=1e-5)
    t.train(corpus, tmp_path / "run", config, progress=False)
    assert len(log_of(tmp_path / "run")) == 6


def test_a_run_is_a_model(run, corpus):
    model, prepared = load_model(run), load(corpus)
    assert model.config == t.fit_config(TINY, prepared).model
    assert (model.config.joints, model.config.frame_time) == (3, 0.033333)
    assert model.skeleton.names == prepared.skeleton.names
    assert model.skeleton.roles == prepared.skeleton.roles
    np.testing.assert_array_equal(model.scales.pose_in.std, prepared.scales.pose_in.std)
    before = load_model(keep.checkpoints(run)[0])
    assert not np.array_equal(model.params["decoder"]["recurrent"]["dense_out"]["bias"],
                              before.params["decoder"]["recurrent"]["dense_out"]["bias"])  # fmt: skip


def test_models_are_saved_in_half_the_space(run, tmp_path):
    model = load_model(run)
    digest = save_model(tmp_path / "half", model, "float16")
    half = load_model(tmp_path / "half")
    assert checkpoint.digest(tmp_path / "half") == digest
    assert checkpoint.load(tmp_path / "half")[0]["params"]["speech"]["dense"]["weight"].dtype == np.float16
    assert {leaf.dtype for leaf in jax.tree.leaves(half.params)} == {np.dtype(np.float32)}
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-6), half.params, model.params)
    jax.tree.map(np.testing.assert_array_equal, half.scales, model.scales)


def test_models_of_another_config_are_refused(run, tmp_path):
    model = load_model(run)
    wider = replace(model.config, decoder=replace(model.config.decoder, hidden=13))
    save_model(tmp_path / "wrong", model._replace(config=wider))
    with pytest.raises(ValueError, match="wrong' is of another config: parameter 'decoder/"):
        load_model(tmp_path / "wrong")
    with pytest.raises(FileNotFoundError, match="nothing' does not exist"):
        load_model(tmp_path / "nothing")
    checkpoint.save(tmp_path / "other", {"a": np.ones(2)}, {})
    with pytest.raises(ValueError, match="other' is not a ZeroEGGS model"):
        load_model(tmp_path / "other")
    (tmp_path / "run" / "checkpoints").mkdir(parents=True)
    with pytest.raises(ValueError, match="no finished checkpoint yet"):
        load_model(tmp_path / "run")


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (replace(TINY, learning_rate=1e-3), r"started with learning_rate = 0.01, now it is 0.001"),
        (replace(TINY, windows=replace(TINY.windows, batch=3)), "windows.batch = 2, now it is 3"),
        (replace(TINY, model=BY_LABEL), "started with model.labels"),
    ],
)
def test_other_settings_do_not_resume(run, corpus, config, message):
    with pytest.raises(ValueError, match=message):
        t.train(corpus, run, config, progress=False)


def test_fewer_updates_than_are_done_are_refused(run, corpus):
    with pytest.raises(ValueError, match="has done 6 updates, 5 are asked for: ask for more, or choose another folder"):
        t.train(corpus, run, replace(TINY, steps=5), progress=False)


@pytest.mark.parametrize(
    "free", [{"resident": True}, {"remat": True, "accumulate": 2}, {"keep": 1, "explode": None, "log_every": 7}]
)
def test_settings_that_leave_the_update_alone_may_change(run, corpus, free):
    run_folder.check_same(keep.checkpoints(run)[-1], metadata_of(run, replace(TINY, **free), corpus), run)


@pytest.mark.parametrize("fixed", [{"ema": 0.9}, {"clip_norm": 1.0}, {"matmul": "bfloat16"}, {"seed": 1}])
def test_settings_that_change_the_update_may_not(run, corpus, fixed):
    with pytest.raises(ValueError, match=f"was started with {next(iter(fixed))} = "):
        run_folder.check_same(keep.checkpoints(run)[-1], metadata_of(run, replace(TINY, **fixed), corpus), run)


@pytest.mark.parametrize("now", [{"mirror": 0.0, "pace": 0.0}, {"mirror": 0.0}, {"pace": 0.0}, {}])
def test_runs_from_before_augmentation_go_on_without_it_only(run, corpus, tmp_path, now):
    """None in a run of today is the paper's mirror and pace; older runs had neither, and no names for them."""
    tree, metadata = checkpoint.load(keep.checkpoints(run)[-1])
    for name in ("mirror", "pace"):
        del metadata["training"]["windows"][name]
    checkpoint.save(tmp_path / "old", tree, metadata)
    given = metadata_of(run, replace(TINY, windows=replace(TINY.windows, **now)), corpus)
    if len(now) == 2:
        run_folder.check_same(tmp_path / "old", given, run)
        return
    with pytest.raises(ValueError, match=r"was started with windows\.(mirror|pace) = 0\.0, now it is None"):
        run_folder.check_same(tmp_path / "old", given, run)


def metadata_of(run: Path, config: t.TrainConfig, corpus: Path) -> dict:
    """What `train` would compare the run's checkpoint with."""
    stored = checkpoint.metadata(keep.checkpoints(run)[-1])
    return stored | {"training": to_dict(t.fit_config(config, load(corpus)))}


def test_a_new_run_begins_with_the_model_it_is_given(run, corpus, tmp_path):
    model, config = load_model(run), t.fit_config(TINY, load(corpus))
    transform = t.optimiser(config)
    begun = t._start(tmp_path, config, transform, model.scales, {}, t._params(model, config, load(corpus)))
    assert int(begun.step) == 0
    jax.tree.map(np.testing.assert_array_equal, begun.params, model.params)
    wider = replace(TINY, model=replace(TINY.model, decoder=m.DecoderConfig(hidden=13, layers=1)))
    with pytest.raises(ValueError, match="decoder"):
        t.train(corpus, tmp_path, wider, progress=False, initial=model)
    moved = model._replace(scales=jax.tree.map(lambda a: a + 1.0, model.scales))
    with pytest.raises(ValueError, match="scales its inputs otherwise"):
        t.train(corpus, tmp_path, TINY, progress=False, initial=moved)


def test_a_run_with_an_average_is_the_averaged_model(run, tmp_path):
    tree, metadata = checkpoint.load(keep.checkpoints(run)[-1])
    tree["average"] = jax.tree.map(lambda a: a + 1.0, tree["params"])
    checkpoint.save(tmp_path / "averaged", tree, metadata)
    ours, theirs = load_model(tmp_path / "averaged").params, load_model(run).params
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a, b + np.float32(1.0)), ours, theirs)


def test_the_best_and_the_newest_are_both_models(run, tmp_path):
    shutil.copytree(run, tmp_path / "run")
    shutil.copytree(keep.checkpoints(run)[0], keep.best(tmp_path / "run"))
    newest, best = load_model(tmp_path / "run"), load_model(keep.best(tmp_path / "run"))
    bias = [model.params["decoder"]["recurrent"]["dense_out"]["bias"] for model in (newest, best, load_model(run))]
    np.testing.assert_array_equal(bias[0], bias[2])
    assert not np.array_equal(bias[0], bias[1])


def test_another_corpus_does_not_resume(run, corpus, tmp_path):
    shutil.copytree(corpus, tmp_path / "arrays")
    manifest = json.loads((corpus / "manifest.json").read_text())
    (tmp_path / "arrays" / "manifest.json").write_text(json.dumps(manifest | {"source": "elsewhere"}))
    with pytest.raises(ValueError, match="started on another corpus"):
        t.train(tmp_path / "arrays", run, TINY, progress=False)


def test_a_damaged_checkpoint_does_not_resume(run, corpus, tmp_path):
    shutil.copytree(run, tmp_path / "run")
    newest = keep.checkpoints(tmp_path / "run")[-1]
    shutil.rmtree(newest / "arrays")
    with pytest.raises(ValueError, match="is damaged"):
        t.train(corpus, tmp_path / "run", replace(TINY, steps=8), progress=False)


@pytest.mark.slow
def test_bad_numbers_in_the_corpus_stop_the_run(corpus, tmp_path):
    """The term and the update are named, the last good checkpoint stays."""
    shutil.copytree(corpus, tmp_path / "arrays")
    poses = np.load(tmp_path / "arrays" / "pose.npy")
    poses[:, 6] = np.nan  # x of the hips
    np.save(tmp_path / "arrays" / "pose.npy", poses)
    with pytest.raises(ValueError, match=r"update 0 \(batch 0\): '\w+' is not finite; there is no checkpoint"):
        t.train(tmp_path / "arrays", tmp_path / "run", replace(TINY, model=BY_LABEL), progress=False)
    assert keep.checkpoints(tmp_path / "run") == []


def test_labels_must_be_the_corpus_styles(corpus, tmp_path):
    wrong = replace(TINY, model=replace(BY_LABEL, labels=("wild", "calm")))
    with pytest.raises(ValueError, match="labels wild, calm; the corpus has styles calm, wild"):
        t.train(corpus, tmp_path / "run", wrong, progress=False)


class Example(NamedTuple):
    """A batch of the corpus, its draws and the jitted loss of both."""

    params: m.Params
    clips: Batch
    draws: objective.Draws
    setting: objective.Setting
    loss: Callable[..., Any]  # of draws -> total, metrics


@pytest.fixture(scope="session")
def example(corpus) -> Example:
    prepared = load(corpus)
    config = t.fit_config(TINY, prepared)
    setting = objective.Setting(config, prepared.scales, prepared.skeleton.parents)
    as_recorded = replace(config.windows, mirror=0.0, pace=0.0)
    params, clips = m.init(jax.random.key(0), config.model), batch(prepared, 0, 0, as_recorded)
    loss = jax.jit(lambda draws: objective.batch_loss(params, clips, draws, 20_000, setting))
    return Example(params, clips, draws_of(0, config), setting, loss)


def draws_of(seed: int, config: t.TrainConfig) -> objective.Draws:
    keys = jax.random.split(jax.random.key(seed), config.windows.batch)
    return jax.vmap(lambda key: objective.draw(key, config.model))(keys)


def test_the_loss_of_a_batch_is_the_mean_of_its_clips(example):
    total, metrics = example.loss(example.draws)

    @jax.jit
    def single(clip, draw):
        some = jax.tree.map(lambda a: a[None], (clip, draw))
        predicted, style = jax.tree.map(lambda a: a[0], objective.unroll(example.params, *some, example.setting))
        return objective.compare(predicted, clip.poses, clip.gaze, example.setting), objective.losses.kl(style)

    pairs = [jax.tree.map(lambda a, i=i: a[i], (example.clips, example.draws)) for i in range(2)]
    alone = [single(*pair) for pair in pairs]
    for name in objective.Terms._fields:
        mean = np.mean([getattr(terms, name) for terms, _ in alone])
        assert float(metrics[name]) == pytest.approx(float(mean), rel=1e-4)
    assert float(metrics["kl"]) == pytest.approx(0.2 * np.mean([kl for _, kl in alone]), rel=1e-4)
    assert float(total) == pytest.approx(sum(float(v) for v in metrics.values()) / 18, rel=1e-5)


def test_style_and_both_dropouts_are_drawn(example):
    other = draws_of(1, example.setting.config)
    drawn = [example.draws, *(example.draws._replace(**{f: getattr(other, f)}) for f in other._fields)]
    assert len({float(example.loss(draws)[0]) for draws in drawn}) == 4
    assert float(example.loss(other)[0]) == float(example.loss(other)[0])


@pytest.mark.slow
def test_label_models_train(corpus, tmp_path):
    t.train(corpus, tmp_path, replace(TINY, model=BY_LABEL, steps=30), progress=False)
    log = log_of(tmp_path)
    assert all(line["kl"] == 0.0 for line in log)
    assert np.mean([line["loss"] for line in log[-5:]]) < np.mean([line["loss"] for line in log[:5]])
    assert "style" not in load_model(tmp_path).params


def test_settings_are_read_strictly(tmp_path):
    path = tmp_path / "config.json"
    path.write_text(json.dumps({"steps": 5, "windows": {"window": 30, "example": [30, 40]}, "kl_limit": 1}))
    config = t.read_config(path)
    assert (config.steps, config.windows.window, config.windows.example, config.kl_limit) == (5, 30, (30, 40), 1.0)
    assert config.model == m.ZeroEggsConfig()
    path.write_text('{"learning_rates": 1}')
    with pytest.raises(ValueError, match=r"unknown key 'learning_rates'; .*'learning_rate'"):
        t.read_config(path)
    path.write_text('{"steps": ')
    with pytest.raises(ValueError, match="is not JSON"):
        t.read_config(path)


def test_the_written_settings_can_be_used_again(run, corpus):
    assert t.read_config(run / "config.json") == t.fit_config(TINY, load(corpus))


def test_defaults_are_the_papers():
    config = t.TrainConfig()
    assert (config.windows.batch, config.windows.window, config.windows.example) == (32, 256, (256, 512))
    assert (config.steps, config.learning_rate, config.decay, config.eps) == (160_000, 1e-4, 0.995, 1e-5)
    assert jnp.isclose(
        objective.losses.kl_weight(7000, config.kl_limit, config.kl_middle, config.kl_slope), 0.0759, rtol=1e-3
    )
