"""Stage `generate`: speech and styles in, the release's BVH out, through the same functions as `zeggs generate`."""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from zeggs_jax.data import scale
from zeggs_jax.geometry import quaternion, rotation
from zeggs_jax.motion import bvh, edit, features, pose
from zeggs_jax.motion.features import Motion
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.speech import features as speech_features
from zeggs_jax.speech import wav
from zeggs_jax.zeroeggs import style_space, torch_weights
from zeggs_jax.zeroeggs.generate import synthesize
from zeggs_jax.zeroeggs.model import Model, encode_speech, encode_style, reparameterise

from . import golden as g
from . import mixed_precision
from .left_out import leave_out

STAGE = "generate"
DEGREES = np.radians(2e-4)  # written angles: the golden README's comparison of BVH text
END_TO_END = 1e-4  # rotation entries with our own resampler and float64 features all through
LAST_PLACE = 2e-4  # a scaled velocity when a hip position differs by its last float32 digit (5e-7 cm / dt / std, twice)
NEAR_LOCK = 2e-3  # the release's float32 asin within 2 degrees of gimbal lock
RESAMPLED = 5e-4  # speech features of a 44.1 kHz recording: another resampler than sox, most at the recording's ends


CLIPS = {"A": "../bvh/clip.bvh", "B": "../dataset/input/001_Old_1.bvh"}  # where case.json names none


class Plan(NamedTuple):
    """What one case is made of, as its sentence in case.json says."""

    used: str  # letters of the style clips, in their order
    start: str  # letter of the clip whose first frame and gaze start the body
    frames: tuple[int, int] | None  # cut of the style clips
    label: str | None
    embedding: bool


PLANS = {  # of cases whose sentence does not say it
    "single": Plan("A", "A", None, None, False),
    "frames": Plan("A", "A", (30, 150), None, False),
    "add": Plan("AB", "B", None, None, False),
    "stitch": Plan("AB", "B", None, None, False),
    "first_pose": Plan("B", "A", None, None, False),
    "embedding": Plan("", "A", None, None, True),
    "label": Plan("", "A", None, "Old", False),
}


def read_plan(name: str, spec: dict[str, Any], letters: str) -> Plan | None:
    """The case's plan from "style A, frames 30 to 150", "A and B added; first pose ... from B", "label 'Old'".

    Any other sentence: the plan that we know by the case's name, or None.
    """
    about = str(spec.get("about", ""))
    styles = re.split(r"[;,]?\s*(?:the )?first pose", about, maxsplit=1)[0]
    used = "".join(dict.fromkeys(re.findall(rf"(?<![\w'])[{letters}](?![\w'])", styles)))
    label = re.search(r"label '([^']+)'", styles)
    embedding = "embedding" in styles
    start = re.search(rf"first pose\b.*\bfrom ([{letters}])\b", about)
    first = start[1] if start else used[-1:]
    if not first or not (used or label or embedding) or (spec.get("style_type") == "label" and not label):
        return PLANS.get(name)
    cut = re.search(r"frames (\d+) to (\d+)", styles)
    return Plan(used, first, (int(cut[1]), int(cut[2])) if cut else None, label[1] if label else None, embedding)


class Inputs(NamedTuple):
    """What all cases share."""

    folder: Path
    case: dict[str, Any]
    features: dict[str, Any]  # case.json of the bvh stage
    clips: dict[str, bvh.Clip]  # style clips by letter, "A" and "B"
    eps: np.ndarray  # [2, 1, Z], the normal draw of the first and the second style
    embedding: np.ndarray  # [Z]


def check(golden: Path, reference: Path | None) -> Iterator[g.Row]:
    """All cases; the networks' scales are the release's, so nothing is checked without `reference`."""
    folder = golden / STAGE
    case = g.read_case(folder)
    if reference is None:
        for name in case["cases"]:
            leave_out(STAGE, name, "needs --reference")
        return
    given = g.read_arrays(folder / "inputs.npz")
    named = dict(re.findall(r"style ([A-Z]): (\S+\.bvh)", case.get("about", "")))
    clips = {letter: bvh.read(folder / path) for letter, path in (CLIPS | named).items()}
    inputs = Inputs(folder, case, g.read_case(golden / "bvh"), clips, given["eps"], given["embedding"])
    models = {v: formula_model(case, reference / v) for v in ("v1", "v2")}
    for name, spec in case["cases"].items():
        plan = read_plan(name, spec, "".join(clips))
        if plan is None:
            yield g.Row(STAGE, f"{name}: unknown case", np.inf, 0.0)
        elif not (folder / f"{name}.npz").exists() or not (folder / f"{name}.bvh").exists():
            leave_out(STAGE, name, f"{name}.npz or {name}.bvh is not in this set")
        else:
            yield from check_case(name, plan, inputs, models["v2" if plan.label else "v1"])


def formula_model(case: dict[str, Any], processed: Path) -> Model:
    """The case's networks (recipe weights) with the release's statistics; v2 is steered by labels."""
    label = processed.name == "v2"
    arrays = {}
    for network in ("speech_encoder", "decoder") if label else torch_weights.NETWORKS:
        spec = case["networks"]["decoder_label" if label and network == "decoder" else network]
        for name, tensor in spec["tensors"].items():
            value = g.recipe(name, tuple(tensor["shape"]), spec["recipe_seed"], spec["gain"])
            arrays[f"{network}/{name}"] = value
    definition = json.loads((processed / "data_definition.json").read_text())
    labels = tuple(definition["label_names"]) if label else ()
    config = torch_weights.infer_config(arrays, definition["dt"], labels)
    scales = torch_weights.read_scales(g.read_arrays(processed / "stats.npz"), config)
    names, parents = tuple(definition["bone_names"]), tuple(definition["parents"])
    skeleton = Skeleton(names, parents, np.asarray(scales.pose_out.mean)[6 : 6 + 3 * len(names)].reshape(-1, 3))
    return Model(config, torch_weights.from_torch(arrays, config), scales, skeleton)


def check_case(name: str, plan: Plan, inputs: Inputs, model: Model) -> Iterator[g.Row]:
    """One case: style features, embeddings, speech, the decoder's poses and the written file."""
    expected, spec = g.read_arrays(inputs.folder / f"{name}.npz"), inputs.case["cases"][name]

    def row(key: str, ours: Any, floor: float = 0.0) -> g.Row:
        theirs = expected[key]
        ours = np.asarray(ours).reshape(theirs.shape) if np.size(ours) == theirs.size else ours
        limit = g.meta(inputs.case, f"{name}.npz", key).get("f32_vs_f64", {}).get("suggested_atol")
        limit = limit if limit is not None else 16 * 1.2e-7 * float(np.abs(theirs).max())
        return g.Row(STAGE, f"{name}/{key}", g.max_error(ours, theirs), max(limit, floor))

    used, start = style_motions(plan, inputs, mixed_precision.encode)
    embeddings = []
    for k, motion in enumerate(used):
        vectors = jax.vmap(pose.to_vector)(motion.pose)
        style = encode_style(model.params, model.config, model.scales, vectors)
        # the release divides the noise by its temperature
        embeddings.append(reparameterise(style, jnp.asarray(inputs.eps[k, 0]), 1.0 / spec["temperature"]))
        scaled = scale.apply(model.scales.pose_in, jnp.pad(vectors, ((0, 0), (0, 3))))[::20]
        yield row(f"style_input_{k}", scaled, floor=LAST_PLACE)
        yield row(f"mu_{k}", style.mean)
        yield row(f"logvar_{k}", style.log_var)
        yield row(f"style_{k}", embeddings[k])
    if plan.embedding:
        embeddings = [jnp.asarray(inputs.embedding)]
    if plan.label:
        embeddings = [jax.nn.one_hot(model.config.labels.index(plan.label), len(model.config.labels))]
    frames = spec["n_frames"]
    if spec["blend_type"] == "stitch":
        sequence = style_space.stitch(jnp.stack(embeddings), spec["blend_ratio"], frames)
    else:
        weights = jnp.asarray(spec["blend_ratio"] or [1.0])
        sequence = style_space.hold(style_space.blend(jnp.stack(embeddings), weights), frames)
    yield row("final_style", sequence)
    yield from first_pose_rows(name, inputs, style_motions(plan, inputs, features.encode)[1], expected)

    wave = wav.read(inputs.folder / "audio.wav")
    spectrum = jnp.asarray(speech_features.extract(wave, rate_hz=bvh.rate_hz(model.config.frame_time)))
    if "audio_features" in expected:
        yield row("audio_features", spectrum, floor=RESAMPLED)
        released = jnp.asarray(expected["audio_features"])
        yield row("speech_encoding", encode_speech(model.params, model.config, model.scales, released))
    elif (inputs.folder / "single.npz").exists():
        released = jnp.asarray(g.read_arrays(inputs.folder / "single.npz")["audio_features"])
    else:
        released = spectrum
    yield from output_rows(name, row, inputs, model, synthesize(model, released, sequence, start), expected)
    start = style_motions(plan, inputs, features.encode)[1]
    ours = features.decode(
        synthesize(model, spectrum, sequence, start), model.skeleton, model.config.frame_time, **AS_RELEASED
    )
    yield from written_rows(f"{name} from the recording", ours, inputs.folder / f"{name}.bvh", END_TO_END)


AS_RELEASED: dict[str, Any] = {"offsets": "first_frame", "unit_root": False}


def style_motions(plan: Plan, inputs: Inputs, encode: Callable[[bvh.Clip], Motion]) -> tuple[list[Motion], Motion]:
    """The motions that are encoded, and the one whose first frame and gaze start the body."""
    clips = dict(inputs.clips)
    if plan.frames:
        clips |= {key: edit.trim(clips[key], *plan.frames) for key in plan.used}
    encoded = {key: encode(clips[key]) for key in {*plan.used, plan.start}}
    return [encoded[key] for key in plan.used], encoded[plan.start]


def first_pose_rows(name: str, inputs: Inputs, start: Motion, expected: dict[str, np.ndarray]) -> Iterator[g.Row]:
    """What `motion.features.encode` makes of the first frame, at the tolerances of the `bvh` stage's features."""
    first = jax.tree.map(lambda x: x[0], start.pose)
    parts = {
        "root_pos": first.root.pos, "root_rot": first.root.rot, "root_vel": first.root_vel, "root_vrt": first.root_ang,
        "lpos": first.joint_pos, "ltxy": first.joint_axes, "lvel": first.joint_vel, "lvrt": first.joint_ang,
        "gaze_pos": start.gaze,
    }  # fmt: skip
    for key, value in parts.items():
        theirs = expected[key if key == "gaze_pos" else f"first_{key}"]
        error = g.max_error(np.asarray(value).reshape(theirs.shape), theirs)
        yield g.Row(STAGE, f"{name}/first_{key}", error, g.allowed(inputs.features, "preprocess.npz", key))


def output_rows(name: str, row: Any, inputs: Inputs, model: Model, poses: pose.Pose, expected: dict) -> Iterator[g.Row]:
    """The decoder's poses and the file made from them, on the release's own speech features."""
    if "ltxy" in expected:
        yield row("ltxy", poses.joint_axes)
    turns = rotation.axes_to_quaternion(poses.joint_axes)
    yield row("V_root_pos", poses.root.pos)
    yield row("V_root_rot", poses.root.rot)
    yield row("V_lpos", poses.joint_pos)
    yield row("V_lrot", turns)
    clip = features.decode(poses, model.skeleton, model.config.frame_time, **AS_RELEASED)
    yield from written_rows(name, clip, inputs.folder / f"{name}.bvh")


def written_rows(name: str, clip: bvh.Clip, path: Path, turn: float = DEGREES) -> Iterator[g.Row]:
    """Our file against the release's: hierarchy text, positions, rotations as rotations (BVH has 6 decimals)."""
    theirs = bvh.parse(path.read_text(), path.name)
    ours = bvh.parse(bvh.format(clip), name)
    same = ours.skeleton.names == theirs.skeleton.names and ours.orders == theirs.orders
    yield g.Row(STAGE, f"{name}.bvh/joints, channels", 0.0 if same else np.inf, 0.0)
    yield g.Row(STAGE, f"{name}.bvh/frame time", abs(ours.frame_time - theirs.frame_time), 0.0)
    yield g.Row(STAGE, f"{name}.bvh/offsets [cm]", g.max_error(ours.skeleton.offsets, theirs.skeleton.offsets), 2e-4)
    yield g.Row(
        STAGE,
        f"{name}.bvh/root positions [cm]",
        g.max_error(ours.positions[:, 0], theirs.positions[:, 0]),
        5e-4,
    )
    turned = [np.asarray(quaternion.to_matrix(features.local_quaternions(clip))) for clip in (ours, theirs)]
    error = np.abs(turned[0] - turned[1]).max(axis=(-2, -1))
    locked = np.abs(np.cos(theirs.euler[..., 1])) < np.radians(2.0)
    yield g.Row(STAGE, f"{name}.bvh/rotations [matrix entries]", float(error[~locked].max()), turn)
    if locked.any():
        yield g.Row(STAGE, f"{name}.bvh/rotations near gimbal lock", float(error[locked].max()), NEAR_LOCK)
