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
from zeggs_jax.zeroeggs.torch_weights import from_torch, infer_config, read_scales, to_torch
from zeggs_jax.zeroeggs.train import Draws, Setting, TrainConfig, batch_loss

from .golden import Row, allowed, compare, max_error, read_arrays, read_case
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
    about, file = case["configs"][name], f"{name}.npz"
    config = _config(case, stored)
    start = from_torch(_renamed(stored, "w0."), config)
    options = dict(about["optimizer"]["RAdam"])
    optimiser = radam(options["lr"], eps=options["eps"], beta1=options["betas"][0], beta2=options["betas"][1])
    scales = read_scales(_under(batches, "stats_"), config)
    setting = Setting(TrainConfig(model=config), scales, tuple(case["data_definition"]["parents"]))

    @jax.jit
    def update(params: Any, state: Any, batch: Batch, draws: Draws, step: Any) -> Any:
        gradient = jax.value_and_grad(partial(batch_loss, setting=setting), has_aux=True)
        (loss, terms), grads = gradient(params, batch, draws, step)
        changes, state = optimiser.update(grads, state, params)
        return optax.apply_updates(params, changes), state, loss, terms, grads

    offset = 7200 if about["kl_iteration"] else 0  # "7200 + iteration": the annealing is caught as it rises
    params, state = jax.tree.map(jnp.asarray, start), optimiser.init(start)
    counts = sorted({int(key[1:].split(".")[0]) for key in stored if key[0] == "w"} - {0})
    totals, terms_of, kept = [], [], {}
    for k in range(about["iterations"]):
        batch, draws = _batch(batches, k % 5, k)
        params, state, loss, terms, grads = update(params, state, batch, draws, k + offset)
        values = dict(zip(TERMS, (terms[field] for field in (*Terms._fields, "kl")), strict=True))
        totals.append(loss)
        terms_of.append([values[term.removeprefix("loss_")] for term in case["terms"]])
        if k + 1 in counts:
            kept[k + 1] = to_torch(params, config)
        if k == 0:
            for key, value in to_torch(grads, config).items():
                ours = _their_name(key, "g0.")
                yield from gradient_rows(STAGE, f"{name}/{ours}", value, stored[ours], allowed(case, file, ours))
    first_error = abs(float(totals[0]) / stored["total"][0] - 1.0)
    yield Row(STAGE, f"{name}/loss of iteration 0, relative", first_error, RELATIVE)
    yield compare(STAGE, case, file, "total", totals, stored["total"])
    yield compare(STAGE, case, file, "terms", terms_of, stored["terms"])
    before, atol = to_torch(start, config), SLACK * about["max_parameter_f32_vs_f64"]
    for n, arrays in kept.items():
        for key, value in arrays.items():
            theirs = stored[_their_name(key, f"w{n}.")].astype(np.float64) - before[key]
            error = max_error(value.astype(np.float64) - before[key], theirs)
            yield Row(STAGE, f"{name}/change after {n} of {_their_name(key, '')}", error, atol)


def _config(case: Case, stored: Arrays) -> ZeroEggsConfig:
    definition = case["data_definition"]
    labels = () if any("StyleEncoder" in key for key in stored) else tuple(definition["label_names"])
    return infer_config(_renamed(stored, "w0."), definition["dt"], labels)


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


def _renamed(stored: Arrays, prefix: str) -> Arrays:
    """'w0.Decoder.x.y' -> 'decoder/x.y'."""
    split = {key: key.split(".", 1) for key in _under(stored, prefix)}
    return {f"{NETWORKS[network]}/{rest}": stored[f"{prefix}{key}"] for key, (network, rest) in split.items()}


def _their_name(key: str, prefix: str) -> str:
    """'decoder/x.y' -> '<prefix>Decoder.x.y'."""
    network, rest = key.split("/", 1)
    return f"{prefix}{ {ours: theirs for theirs, ours in NETWORKS.items()}[network] }.{rest}"
