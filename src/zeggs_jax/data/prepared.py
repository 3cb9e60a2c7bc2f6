"""A prepared corpus as training reads it: memory-mapped arrays, their statistics, what the manifest says."""

import json
import zipfile
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int32

from zeggs_jax.data.body import BodyConfig
from zeggs_jax.data.scale import Scale, Scales
from zeggs_jax.motion.pose import Pose, Root, from_vector
from zeggs_jax.motion.skeleton import Roles, Skeleton

FORMAT = 1
ARRAYS = ("speech", "pose", "root_pos", "root_rot")  # one .npy file each
MANIFEST = "manifest.json"  # written last: without it the folder is unfinished
SCALES = "scales.npz"


@dataclass(frozen=True, eq=False)
class Prepared:
    """N frames of C clips in a row."""

    folder: Path
    config: dict[str, Any]  # the PrepareConfig it was made with
    skeleton: Skeleton
    frame_time: float  # s
    styles: tuple[str, ...]  # sorted; labels index it
    names: tuple[str, ...]  # of the clips
    splits: tuple[str, ...]  # of the clips: train or valid
    labels: Int32[np.ndarray, " C"]
    ranges: Int32[np.ndarray, "C 2"]  # [start, stop) rows of each clip
    gaze: Float32[np.ndarray, "C 3"]  # what each clip looks at, cm, world
    speech: Float32[np.ndarray, "N S"]
    pose: Float32[np.ndarray, "N D"]  # pose vectors, see motion/pose.py
    root_pos: Float32[np.ndarray, "N 3"]  # cm, world
    root_rot: Float32[np.ndarray, "N 4"]  # world
    scales: Scales
    body: BodyConfig | None = None  # how the files were read; None in arrays of older versions

    @property
    def pipeline(self) -> str:
        """Which way of preparing made the arrays: "as released" or "mended"."""
        return "as released" if self.config["as_released"] else "mended"

    @cached_property
    def across(self) -> tuple[int, ...] | None:
        """For every joint its counterpart on the body's other side; None where the body has no mirror."""
        return across_of(self.skeleton)

    def clips(self, split: str) -> Int32[np.ndarray, " c"]:
        """Numbers of the clips of a split."""
        return np.array([i for i, s in enumerate(self.splits) if s == split], np.int32)

    def poses(self, rows: slice) -> Pose:
        """The given frames as a Pose with a leading frame axis."""
        root = Root(jnp.asarray(self.root_pos[rows]), jnp.asarray(self.root_rot[rows]))
        return from_vector(self.pose[rows], root)


def across_of(skeleton: Skeleton) -> tuple[int, ...] | None:
    """For every joint its counterpart on the other side; None for a body that has no mirror."""
    try:
        across = skeleton.mirror_map()
    except ValueError:
        return None
    return across if skeleton.asymmetry() < 0.5 else None  # else mirrored rotations are no mirrored motion


def load(folder: str | Path) -> Prepared:
    """What `prepare` wrote. FileNotFoundError when it is not there, ValueError when it is damaged."""
    folder = Path(folder)
    if not (folder / MANIFEST).exists():
        raise FileNotFoundError(f"'{folder}' has no {MANIFEST} of a prepared corpus; run `zeggs prepare`.")
    try:
        return _load(folder)
    except (ValueError, TypeError, KeyError, IndexError, OSError, EOFError, zipfile.BadZipFile) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise ValueError(f"The prepared '{folder}' is damaged ({reason}); run `zeggs prepare` again.") from error


def _load(folder: Path) -> Prepared:
    manifest = json.loads((folder / MANIFEST).read_text())
    if manifest["format"] != FORMAT:
        raise ValueError(f"its format is {manifest['format']}, {FORMAT} was expected")
    arrays = {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in ARRAYS}
    clips = manifest["clips"]
    if any(len(array) != clips[-1]["range"][1] for array in arrays.values()):
        raise ValueError("its arrays and its manifest differ in length")
    return Prepared(
        folder=folder,
        config=manifest["config"],
        skeleton=skeleton_from_json(manifest["skeleton"]),
        frame_time=manifest["frame_time"],
        styles=tuple(manifest["styles"]),
        names=tuple(clip["name"] for clip in clips),
        splits=tuple(clip["split"] for clip in clips),
        labels=np.array([clip["label"] for clip in clips], np.int32),
        ranges=np.array([clip["range"] for clip in clips], np.int32),
        gaze=np.array([clip["gaze"] for clip in clips], np.float32),
        scales=_read_scales(folder / SCALES),
        body=_body(manifest["body"]) if "body" in manifest else None,
        **arrays,
    )


def _body(stored: dict[str, Any]) -> BodyConfig:
    axes, roles = stored["axes"], stored["roles"]
    lists = {"axes": None if axes is None else tuple(axes), "roles": None if roles is None else Roles(**roles)}
    return BodyConfig(**{**stored, **lists})


def _read_scales(path: Path) -> Scales:
    with path.open("rb") as file, np.load(file) as arrays:
        return Scales(*(Scale(arrays[f"{kind}.mean"], arrays[f"{kind}.std"]) for kind in Scales._fields))


def skeleton_to_json(skeleton: Skeleton) -> dict[str, Any]:
    """Plain lists, roles included."""
    return {
        "names": list(skeleton.names),
        "parents": list(skeleton.parents),
        "offsets": np.asarray(skeleton.offsets).tolist(),
        "roles": asdict(skeleton.roles or Roles()),
    }


def skeleton_from_json(stored: dict[str, Any]) -> Skeleton:
    """Inverse of `skeleton_to_json`."""
    offsets = np.array(stored["offsets"], float)
    return Skeleton(tuple(stored["names"]), tuple(stored["parents"]), offsets, Roles(**stored["roles"]))
