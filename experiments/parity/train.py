"""Golden case `train`: the optimiser alone, the learning rate, and whole training runs against the release's."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import optax

from zeggs_jax.data.windows import Batch
from zeggs_jax.motion.pose import Pose, to_vector
from zeggs_jax.training.optimiser import RAdamState, radam, step_table, stepped_rate
from zeggs_jax.zeroeggs.config import ZeroEggsConfig
from zeggs_jax.zeroeggs.losses import Terms
from zeggs_jax.zeroeggs.objective import Draws, Setting, batch_loss
from zeggs_jax.zeroeggs.settings import TrainConfig
from zeggs_jax.zeroeggs.torch_weights import from_torch, infer_config, read_scales, to_torch

from .golden import Row, allowed, compare, max_error, read_arrays, read_case, recipe
from .losses import RELATIVE, TERMS, gradient_rows, pose_of

STAGE = "train"
NETWORKS = {"SpeechEncoder": "speech_encoder", "StyleEncoder": "style_encoder", "Decoder": "decoder"}
SLACK = 8.0  # times the release's own float32 error, as in the set's suggested_atol

Arrays = dict[str, np.ndarray]
Case = dict[str, Any]


def check(golden: Path, reference: Path | None = None) -> Iterator[Row]:
    """Rows for every file that is there."""
    folder = golden / STAGE
    case = read_case(folder)
    runs = [name for name in case["configs"] if (folder / f"{name}.npz").exists()]
    if not runs and not (folder / "radam.npz").exists():
        raise ValueError(f"'{folder}' holds none of the files that its case.json describes.")
    yield from _schedule(case["lr_schedule"])
    if (folder / "radam.npz").exists():
        arrays = read_arrays(folder / "radam.npz")
        for name, options in case["radam"].items():
            yield from _optimiser(case, name, options, arrays)
    if runs:
        batches = read_arrays(folder / "batches.npz")
        for name in runs:
            yield from _run(case, name, read_arrays(folder / f"{name}.npz"), batches)


def _schedule(about: dict[str, Any]) -> Iterator[Row]:
    rate = stepped_rate(about["learning_rate"], about["learning_rate_decay"])
    for update, expected in about["rate_used_by_update"].items():
        ours = float(jax.jit(rate)(jnp.int32(update)))
        yield Row(STAGE, f"learning rate of update {update}, relative", abs(ours / expected - 1.0), RELATIVE)


def _optimiser(case: Case, name: str, options: dict[str, Any], arrays: Arrays) -> Iterator[Row]:
    """One variant of the optimiser on the stored quadratic."""
    beta1, beta2 = options.get("betas", (0.9, 0.999))
    rate = options["lr"]
    if "ExponentialLR_gamma" in options:
        rate = stepped_rate(rate, options["ExponentialLR_gamma"], options["scheduler_step_every"])
    momentum_start = options.get("degenerated_to_sgd", True)
    optimiser = radam(
        rate,
        beta1=beta1,
        beta2=beta2,
        eps=options.get("eps", 1e-8),
        weight_decay=options.get("weight_decay", 0.0),
        momentum_start=momentum_start,
    )
    a, c, start = (jnp.asarray(arrays[key]) for key in ("A", "c", "w0"))
    updates = len(arrays[f"{name}_g"])

    def body(carry: Any, _: Any) -> Any:
        w, state = carry
        gradient = a @ (w - c)
        change, state = optimiser.update(gradient, state, w)
        return (w + change, state), (w + change, gradient)

    (_, state), (path, gradients) = jax.lax.scan(body, (start, optimiser.init(start)), length=updates)
    state = cast(RAdamState, state)
    ours = {
        "w": np.concatenate([start[None], path]),
        "g": gradients,
        "exp_avg": state.first,
        "exp_avg_sq": state.second,
    }
    for key, value in ours.items():
        yield compare(STAGE, case, "radam.npz", f"{name}_{key}", value, arrays[f"{name}_{key}"])
    table = step_table(beta1, beta2)
    factor = np.where(table.rectified | momentum_start, table.factor, -1.0)[:updates]
    for key, value in (("n_sma", table.length[:updates]), ("step_size", factor)):
        error = max_error(value / arrays[f"{name}_{key}"], np.ones(updates))
        yield Row(STAGE, f"radam/{name}_{key}, relative", error, 1e-9)
    first = int(np.argmax(table.rectified)) + 1
    yield Row(STAGE, f"radam/{name} first rectified update", abs(first - options["first_rectified_update"]), 0.0)


def _run(case: Case, name: str, stored: Arrays, batches: Arrays) -> Iterator[Row]:
    """A training run on stored batches and draws: losses, first gradients, parameters after some updates."""
    file, about = f"{name}.npz", case["configs"][name]
    described = case["files"][file]["arrays"]
    config, start = _start(case, name, stored)
    before = to_torch(start, config)
    totals, terms_of = [], []
    for k, (loss, terms, grads, params) in enumerate(_updates(case, about, config, start, batches)):
        values = dict(zip(TERMS, (terms[field] for field in (*Terms._fields, "kl")), strict=True))
        totals.append(loss)
        terms_of.append([values[term.removeprefix("loss_")] for term in case["terms"]])
        if k == 0:
            for key, value in _named(grads, config, "g0.", described):
                yield from gradient_rows(STAGE, f"{name}/{key}", value, stored[key], allowed(case, file, key))
        for key, value in _named(params, config, f"w{k + 1}.", described):
            start_value = before[_our_name(key)].astype(np.float64)
            error = max_error(value - start_value, stored[key] - start_value)
            yield Row(STAGE, f"{name}/{key}, change", error, SLACK * about["max_parameter_f32_vs_f64"])
    first_error = abs(float(totals[0]) / stored["total"][0] - 1.0)
    yield Row(STAGE, f"{name}/loss of iteration 0, relative", first_error, RELATIVE)
    yield compare(STAGE, case, file, "total", totals, stored["total"])
    yield compare(STAGE, case, file, "terms", terms_of, stored["terms"])


def _updates(case: Case, about: Any, config: ZeroEggsConfig, params: Any, batches: Arrays) -> Iterator[Any]:
    """(loss, terms, gradients, parameters after it) of every update of a run."""
    options = about["optimizer"]["RAdam"]
    optimiser = radam(options["lr"], eps=options["eps"], beta1=options["betas"][0], beta2=options["betas"][1])
    scales = read_scales(_under(batches, "stats_"), config)
    setting = Setting(TrainConfig(model=config), scales, tuple(case["data_definition"]["parents"]))

    @jax.jit
    def update(params: Any, state: Any, batch: Batch, draws: Draws, step: Any) -> Any:
        gradient = jax.value_and_grad(partial(batch_loss, setting=setting), has_aux=True)
        (loss, terms), grads = gradient(params, batch, draws, step)
        changes, state = optimiser.update(grads, state, params)
        return optax.apply_updates(params, changes), state, loss, terms, grads

    offset = int((about["kl_iteration"] or "0 + iteration").split("+")[0])  # the annealing is caught as it rises
    params = jax.tree.map(jnp.asarray, params)
    state = optimiser.init(params)
    for k in range(about["iterations"]):
        batch, draws = _batch(batches, k % 5, k)
        params, state, loss, terms, grads = update(params, state, batch, draws, k + offset)
        yield loss, terms, grads, params


def _start(case: Case, name: str, stored: Arrays) -> tuple[ZeroEggsConfig, Any]:
    """Sizes and parameters before the first update, stored or made by the set's recipe."""
    seed = case["configs"][name]["recipe_seed"]
    arrays = {}
    for key, about in case["files"][f"{name}.npz"]["arrays"].items():
        if key.startswith("w0."):
            made = recipe(key.split(".", 2)[2], tuple(about["shape"]), seed)
            arrays[_our_name(key)] = stored.get(key, made)
    definition = case["data_definition"]
    labels = () if any(key.startswith("style_encoder/") for key in arrays) else tuple(definition["label_names"])
    config = infer_config(arrays, definition["dt"], labels)
    return config, from_torch(arrays, config)


def _named(params: Any, config: ZeroEggsConfig, prefix: str, described: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Those arrays of `params` that the set describes under `prefix`, by its names."""
    if any(key.startswith(prefix) for key in described):
        ours = to_torch(params, config)
        yield from ((key, ours[_our_name(key)]) for key in described if key.startswith(prefix))


def _our_name(key: str) -> str:
    """'w0.Decoder.x.y' -> 'decoder/x.y'."""
    _, network, rest = key.split(".", 2)
    return f"{NETWORKS[network]}/{rest}"


def _batch(batches: Arrays, number: int, k: int) -> tuple[Batch, Draws]:
    """Batch `number` in our form, examples padded to one length, and the draws of iteration `k`; no dropout."""
    arrays = _under(batches, f"b{number}_")
    poses: Pose = pose_of(arrays, "")
    longest = max(array.shape[1] for key, array in batches.items() if key.endswith("_style"))
    size, length, _ = arrays["style"].shape
    width = to_vector(poses).shape[-1]  # the columns behind it are the gaze's, zeros
    example = np.pad(arrays["style"][..., :width], ((0, 0), (0, longest - length), (0, 0)))
    batch = Batch(
        speech=arrays["audio_features"],
        poses=poses,
        gaze=arrays["gaze_pos"][:, 0],  # constant over a clip
        example=example,
        example_length=np.full(size, length, np.int32),
        label=np.argmax(batches["onehot"][number], axis=-1).astype(np.int32),
    )
    return batch, Draws(jnp.asarray(batches["eps"][k, :size]), None, None)


def _under(arrays: Arrays, prefix: str) -> Arrays:
    return {key.removeprefix(prefix): value for key, value in arrays.items() if key.startswith(prefix)}
