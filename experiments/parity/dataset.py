"""Golden case `dataset`: the data pipeline as released (arrays, statistics, trimmed files), and windows."""

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from zeggs_jax.data import corpus
from zeggs_jax.data.prepare import PrepareConfig, Prepared, prepare, save_trimmed
from zeggs_jax.data.rows import released_example_rows, window_count
from zeggs_jax.data.takes import takes
from zeggs_jax.speech import wav

from .golden import Row, compare, max_error, read_arrays, read_case
from .left_out import leave_out

STAGE = "dataset"
PACE = (0.9, 1.0)
TEXT_ATOL = 2e-4  # degrees and cm with six decimals
SAMPLE_ATOL = 1.01 / 32768  # truncation to 16 bit turns rounding errors into one step


def check(golden: Path, reference: Path | None) -> Iterator[Row]:
    """What the folder allows: arrays need all of input/, trimmed files their own clip, windows the ranges."""
    folder = golden / STAGE
    case = read_case(folder)
    present = {file for file in case["files"] if (folder / file).exists()}
    if not present - {file for file in present if file.startswith("input/")}:
        raise ValueError(f"'{folder}' holds no results that its case.json describes.")
    with tempfile.TemporaryDirectory() as scratch:
        if all((folder / file).exists() for file in case["files"] if file.startswith("input/")):
            for file, centre in (("processed_data.npz", True), ("not_trimmed.npz", False)):
                if file in present:
                    config = PrepareConfig(as_released=True, pace=PACE, centre=centre)
                    prepared = prepare(folder / "input", Path(scratch) / file, config)
                    yield from _arrays(case, file, prepared, read_arrays(folder / file))
        else:
            leave_out(STAGE, "processed_data.npz, not_trimmed.npz", "need all of input/")
        trimmed = list(_trimmed(folder, present, Path(scratch)))
        yield from trimmed
        for file in sorted(present):
            if file.startswith("trimmed_") and not any(row.name.startswith(file) for row in trimmed):
                leave_out(STAGE, file, "its clip is not in input/")
    if present >= {"windows.npz", "processed_data.npz"}:
        yield from _windows(case, read_arrays(folder / "windows.npz"), read_arrays(folder / "processed_data.npz"))
    else:
        leave_out(STAGE, "windows.npz", "needs processed_data.npz and itself")


def _arrays(case: dict[str, Any], file: str, p: Prepared, expected: dict[str, np.ndarray]) -> Iterator[Row]:
    poses = p.poses(slice(None))
    per_frame = np.repeat(p.gaze, np.diff(p.ranges, axis=1)[:, 0], axis=0)
    ours = {
        "X_audio_features": p.speech,
        "Y_root_pos": poses.root.pos,
        "Y_root_rot": poses.root.rot,
        "Y_root_vel": poses.root_vel,
        "Y_root_vrt": poses.root_ang,
        "Y_lpos": poses.joint_pos,
        "Y_ltxy": poses.joint_axes,
        "Y_lvel": poses.joint_vel,
        "Y_lvrt": poses.joint_ang,
        "Y_gaze_pos": per_frame,
        "audio_input_mean": p.scales.speech.mean,
        "audio_input_std": p.scales.speech.std,
        "anim_input_mean": p.scales.pose_in.mean,
        "anim_input_std": p.scales.pose_in.std,
        "anim_output_mean": p.scales.pose_out.mean,
        "anim_output_std": p.scales.pose_out.std,
    }
    for key, value in ours.items():
        if key in expected:
            yield compare(STAGE, case, file, key, value, expected[key])
    if "Y_lpos_joint0" in expected:
        error = max_error(poses.joint_pos[:, 0], expected["Y_lpos_joint0"])
        limit = case["files"]["processed_data.npz"]["arrays"]["Y_lpos"]["f32_vs_f64"]["suggested_atol"]
        yield Row(STAGE, "not_trimmed/Y_lpos_joint0", error, limit)
    if "ranges_train" in expected:
        yield from _ranges(case, p, expected)


def _ranges(case: dict[str, Any], p: Prepared, expected: dict[str, np.ndarray]) -> Iterator[Row]:
    """Labels are compared by name: the release's order of labels changes from run to run."""
    names = case["data_definition"]["label_names"]
    for split in ("train", "valid"):
        clips = p.clips(split)
        yield Row(STAGE, f"ranges_{split}", max_error(p.ranges[clips], expected[f"ranges_{split}"]), 0.0)
        ours = [names.index(p.styles[label]) for label in p.labels[clips]]
        yield Row(STAGE, f"ranges_{split}_labels", max_error(ours, expected[f"ranges_{split}_labels"]), 0.0)
    definition = case["data_definition"]
    ours = (list(p.skeleton.names), list(p.skeleton.parents))
    same = ours == (definition["bone_names"], definition["parents"])
    yield Row(STAGE, "data_definition/skeleton", 0.0 if same else float("inf"), 0.0)
    yield Row(STAGE, "data_definition/dt", abs(p.frame_time - definition["dt"]), 0.0)


def _trimmed(folder: Path, present: set[str], scratch: Path) -> Iterator[Row]:
    """The release's trimmed/*.bvh and *.wav, for every clip whose input is there."""
    source = _input(folder / "input", scratch / "input")
    for entry in corpus.find(source) if source else []:
        for take in takes(entry, PACE, as_released=True):
            if not any(f"trimmed_{take.name}.{kind}" in present for kind in ("bvh", "wav")):
                continue
            save_trimmed(scratch, take)
            expected = folder / f"trimmed_{take.name}"
            if f"{expected.name}.bvh" in present:
                yield from _same_bvh(scratch / f"{take.name}.bvh", expected.with_name(f"{expected.name}.bvh"))
            if f"{expected.name}.wav" in present:
                ours = wav.read(scratch / f"{take.name}.wav")
                theirs = wav.read(folder / f"{expected.name}.wav")
                yield Row(STAGE, f"{expected.name}.wav", max_error(ours, theirs), SAMPLE_ATOL)


def _same_bvh(ours: Path, theirs: Path) -> Iterator[Row]:
    """The hierarchy as text, up to the numbers; the motion as numbers."""
    (head, motion), (expected_head, expected_motion) = (path.read_text().split("MOTION", 1) for path in (ours, theirs))
    same = [word for word in head.split() if not _number(word)] == [
        word for word in expected_head.split() if not _number(word)
    ]
    yield Row(STAGE, f"{theirs.name}, hierarchy", 0.0 if same else float("inf"), 0.0)
    for label, a, b in (("offsets", head, expected_head), ("motion", motion, expected_motion)):
        numbers = [[float(word) for word in text.split() if _number(word)] for text in (a, b)]
        yield Row(STAGE, f"{theirs.name}, {label}", max_error(*numbers), TEXT_ATOL)


def _number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _input(folder: Path, out: Path) -> Path | None:
    """A copy of the clips of input/ that are there, with the lines of info.csv that name them."""
    if not (folder / "info.csv").exists():
        return None
    shutil.copytree(folder, out)
    title, *lines = (folder / "info.csv").read_text().splitlines()
    kept = [line for line in lines if line and (folder / line.split(",")[6]).exists()]
    (out / "info.csv").write_text("\n".join([title, *kept]) + "\n")
    return out if kept else None


def _windows(case: dict[str, Any], stored: dict[str, np.ndarray], data: dict[str, np.ndarray]) -> Iterator[Row]:
    """Rows of style examples, frames of windows and labels, by the index that the release's loader uses."""
    spec, ranges, frames = case["windows"], data["ranges_train"], len(data["Y_root_pos"])
    counts = window_count(ranges, spec["window"], as_released=True)
    yield Row(STAGE, "windows/count", abs(int(counts.sum()) - spec["len"]), 0.0)
    worst, wrong = 0.0, 0.0
    for item in spec["items"]:
        clip = int(np.searchsorted(np.cumsum(counts), item["index"], side="right"))
        start, stop = (int(edge) for edge in ranges[clip])
        first = int(start + item["index"] - counts[:clip].sum())
        window = (first, first + spec["window"])
        wrong += (clip, first, window[1] - 1) != (item["range"], item["first_frame"], item["last_frame"])
        wrong += int(stored[f"label_{item['index']}"].argmax() != data["ranges_train_labels"][clip])
        rows = released_example_rows(window, (start, stop), frames, item["example_window_length"])
        worst = max(worst, max_error(rows, stored[item["key"]]))
    yield Row(STAGE, "windows/frames and labels", wrong, 0.0)
    yield Row(STAGE, "windows/example rows", worst, 0.0)
    if {"example_full", "rows_5_48"} <= stored.keys():
        fields = [data[f"Y_{field}"] for field in ("root_vel", "root_vrt", "lpos", "ltxy", "lvel", "lvrt")]
        ours = np.concatenate([field.reshape(frames, -1)[stored["rows_5_48"]] for field in fields], axis=1)
        yield Row(STAGE, "windows/example_full", max_error(ours, stored["example_full"][:, :-3]), 0.0)
    for sample in case["samples"]:
        if "example_key" in sample:  # longer than the example asked for: nothing comes twice
            start, stop = sample["start_end"]
            rows = released_example_rows((start, stop + 1), (start, stop), frames, stop + 1 - start)
            error = max_error(np.unique(rows), stored[sample["example_key"]])
            yield Row(STAGE, f"windows/{sample['example_key']}", error, 0.0)
