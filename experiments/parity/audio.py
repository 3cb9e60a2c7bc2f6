"""Golden case `audio`: reading, resampling, loudness, spectrogram stages, mels, energy, features."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from zeggs_jax.speech import features, wav

from .golden import Row, compare, max_error, meta, read_arrays, read_case
from .left_out import leave_out

STAGE = "audio"
MARGIN = 8  # over the resampler differences that case.json measured, as in the set's own tolerances


def check(golden: Path, reference: Path | None) -> Iterator[Row]:
    """Mel features from the stored waveforms, resampling separately; the real voice only with `reference`."""
    folder = golden / STAGE
    case = read_case(folder)
    found = [*folder.glob("*.npz")]
    if not found:
        raise ValueError(f"'{folder}' holds no arrays that its case.json describes.")
    if (folder / "mel_basis.npz").exists():
        yield from _filters(read_arrays(folder / "mel_basis.npz"))
    for name, facts in case["wavs"].items():
        if not (folder / f"{name}.npz").exists():
            leave_out(STAGE, f"{name}.npz", "not in this set")
            continue
        arrays = read_arrays(folder / f"{name}.npz")
        yield from _stages(case, name, facts, arrays)
        path = folder / facts["file"]
        if facts["file"].startswith("reference/"):
            path = reference / facts["file"].removeprefix("reference/") if reference else folder / "absent"
        if path.exists():
            yield from _file(case, name, facts, arrays, path)
        else:
            leave_out(STAGE, facts["file"], "needs --reference" if reference is None else "not there")


def _filters(arrays: dict[str, np.ndarray]) -> Iterator[Row]:
    config = features.RELEASED
    ours = {
        "mel_basis": features.mel_basis(),
        "window": features.hann(config.window),
        "min_amplitude": config.min_clipping / config.window,
    }
    for key, value in ours.items():
        expected = arrays[key]
        yield Row(STAGE, f"mel_basis/{key}", max_error(value, expected), 1e-12 * float(np.abs(expected).max()))


def _stages(case: dict[str, Any], name: str, facts: dict[str, Any], arrays: dict[str, np.ndarray]) -> Iterator[Row]:
    """Each stage from the stored result of the stage before."""
    file, rows = f"{name}.npz", arrays["stage_rows"]
    yield Row(STAGE, f"{name}/loudness_lufs", abs(wav.loudness(arrays["waveform"]) - facts["loudness_lufs"]), 1e-5)
    amplitude = features.amplitude(arrays["normalized"])
    mel = amplitude @ features.mel_basis().T
    log_mel = features.log_mel(arrays["normalized"])
    ours = {
        "normalized": wav.normalize_loudness(arrays["waveform"]),
        "amplitude": amplitude[rows],
        "mel": mel[rows],
        "db": features.decibels(mel)[rows],
        "log_mel": log_mel,
        "energy": features.energy(log_mel),
    }
    for key, value in ours.items():
        yield compare(STAGE, case, file, key, value, arrays[key])
    released = features.extract(arrays["waveform"], as_released=True)
    yield from _features(case, name, released, arrays["features"], "features", 0.0)
    mended = features.extract(arrays["waveform"])
    known = np.isfinite(arrays["features"]).all(axis=1)
    yield Row(STAGE, f"{name}/features, clamped", max_error(mended[known], released[known]), 0.0)
    yield Row(STAGE, f"{name}/features, clamped: not finite", float((~np.isfinite(mended)).sum()), 0.0)


def _file(
    case: dict[str, Any], name: str, facts: dict[str, Any], arrays: dict[str, np.ndarray], path: Path
) -> Iterator[Row]:
    """From the file itself; resampled ones as near as the set says soxr's HQ comes to sox."""
    wave = wav.read(path)
    soxr = facts.get("other_resamplers_vs_sox", {}).get("soxr.HQ", {"max_abs": 0.0, "feature_max_abs": 0.0})
    yield Row(STAGE, f"{name}/waveform", max_error(wave, arrays["waveform"]), MARGIN * soxr["max_abs"])
    ours = features.extract(wave, as_released=True)
    yield from _features(case, name, ours, arrays["features"], "features from file", MARGIN * soxr["feature_max_abs"])


def _features(
    case: dict[str, Any], name: str, ours: np.ndarray, expected: np.ndarray, label: str, extra: float
) -> Iterator[Row]:
    """Mels and energy apart: the energy is a hundred times larger."""
    parts = meta(case, f"{name}.npz", "features")["f32_vs_f64_parts"]
    for part, columns in (("columns 0-79 (mel)", slice(80)), ("column 80 (energy)", slice(80, None))):
        limit = max(parts[part]["suggested_atol"], extra)
        if ours.shape != expected.shape:
            yield Row(STAGE, f"{name}/{label}, {part}", float("inf"), limit)
        else:
            yield Row(STAGE, f"{name}/{label}, {part}", max_error(ours[:, columns], expected[:, columns]), limit)
