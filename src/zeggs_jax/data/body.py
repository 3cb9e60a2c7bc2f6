"""Any body as the features expect it: centimetres, y up, hips and head facing +z, the joints' roles known.

The move is rigid but for the scale: every joint keeps its place in the turned world, and only the frames in
which rotations and offsets are written change, by quarter turns. A body that is so already comes back untouched.
"""

import difflib
import tomllib
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from zeggs_jax.data.stance import AXES, Axis, Stance, to_frames, to_world
from zeggs_jax.motion import edit
from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.skeleton import Roles, Skeleton

UNITS_CM = {"cm": 1.0, "m": 100.0, "mm": 0.1, "inches": 2.54, "feet": 30.48, "CMU units": 2.54 / 0.45}
HUMAN_CM = (110.0, 230.0)  # no two units let the same body be this tall
MOVES_CM = 0.01  # hips that move less in their parent's frame are fixed to it
TALLER = 1.15  # a standing body against its chain of bones from ankle to hips to head joint


@dataclass(frozen=True)
class BodyConfig:
    """How a corpus writes its body; what is "auto" or None is found from the first clip (see `resolve`)."""

    scale: float | None = None  # cm per unit of the files
    up: Axis = "auto"  # the axis of the files' world that points up
    facing: Axis = "auto"  # the axis of the hips' own frame that points ahead
    axes: tuple[str, ...] | None = None  # joint by joint its own axes that point up and ahead; () is "y z" for all
    roles: Roles | None = None  # joints by name; those left out are inferred
    lead: bool | None = None  # joints above the hips go with them; None: where the hips move below a still joint

    def __post_init__(self) -> None:
        if self.scale is not None and not 0 < self.scale < np.inf:
            raise ValueError(f"The scale of a body is {self.scale}; give the cm of one unit, above 0.")
        for pair in self.axes or ():
            up, _, ahead = pair.partition(" ")
            if up not in AXES or ahead not in AXES or up[-1] == ahead[-1]:
                raise ValueError(f"A joint's axes are {pair!r}; give those that point up and ahead, as 'y z'.")


AS_IS = BodyConfig(scale=1.0, up="y", facing="z", axes=(), lead=False)  # files that are so already, as the release's


def normalise(clip: Clip, config: BodyConfig, name: str) -> Clip:
    """The clip in cm, y up, hips and head facing +z, with roles; `name` is the file in errors.

    World positions are those of the file, scaled and turned by quarter turns; but joints above the hips go with
    them where config.lead. ValueError where a joint for
    hips, spine or head is not known, or size, up or facing are not clear and not given.
    """
    config = resolve(clip, config, name)
    assert config.scale is not None
    assert config.axes is not None
    skeleton = clip.skeleton
    if skeleton.roles != config.roles:
        skeleton = Skeleton(skeleton.names, skeleton.parents, skeleton.offsets, config.roles)
        clip = clip._replace(skeleton=skeleton)
    frames = to_frames(config.axes, len(skeleton))
    world = to_world(frames[skeleton.role("hips")], config.up)
    if config.scale != 1.0 or any((frame != np.eye(3)).any() for frame in (world, *frames)):
        clip = edit.reframe(clip, world, frames, config.scale)
    return edit.lead(clip, skeleton.role("hips")) if config.lead else clip


def resolve(clip: Clip, config: BodyConfig, name: str) -> BodyConfig:
    """The config with everything found that was left open, so that later clips are read as this one."""
    skeleton = clip.skeleton
    roles = _roles(skeleton, config.roles or Roles(), name)
    skeleton = Skeleton(skeleton.names, skeleton.parents, skeleton.offsets, roles)
    scale = config.scale or _scale(skeleton, name)
    if config.axes and len(config.axes) != len(skeleton):
        raise ValueError(
            f"'{name}' has {len(skeleton)} joints, and its axes were found or given for a body of {len(config.axes)}; "
            "prepare each skeleton by itself."
        )
    up, axes = config.up, config.axes
    if up == "auto" or axes is None:
        seen = Stance.of(clip._replace(skeleton=skeleton))
        up = seen.up(name) if up == "auto" else up
        axes = seen.axes(up, config.facing, name) if axes is None else axes
    facing: Any = axes[skeleton.role("hips")].split()[1] if axes else "z"
    if config.facing not in ("auto", facing):
        raise ValueError(f"'{name}': the hips are said to face {config.facing} and by their axes face {facing}.")
    hips, lead = clip.positions[:, skeleton.role("hips")], config.lead
    if lead is None:
        lead = skeleton.role("hips") > 0 and bool(np.ptp(hips, axis=0).max() * scale > MOVES_CM)
    return BodyConfig(scale, up, facing, axes, roles, lead)


def normalise_like(clip: Clip, config: BodyConfig, like: Skeleton, name: str) -> Clip:
    """`normalise`, but a clip whose bones are those of `like`, a normalised body, before it is left as it is.

    So that what a model makes can be its style example.
    """

    def apart(skeleton: Skeleton) -> float:
        return float(np.linalg.norm(skeleton.offsets[1:] - like.offsets[1:], axis=-1).sum())

    made = normalise(clip, config, name)
    return clip if apart(clip.skeleton) < apart(made.skeleton) else made


def describe(config: BodyConfig) -> str:
    """What was decided, in one line."""
    unit = next((unit for unit, cm in UNITS_CM.items() if config.scale == cm), f"{config.scale} cm a unit")
    roles = ", ".join(f"{role} {joint}" for role, joint in asdict(config.roles or Roles()).items() if joint)
    turned = "" if not config.axes else ", joints turned to y up and z ahead"
    led = ", joints above the hips moved to them" if config.lead else ""
    return f"{unit}, {config.up} up, facing {config.facing}{turned}{led}; {roles}".removesuffix("; ")


def read_body(path: str | Path) -> BodyConfig:
    """A BodyConfig from a TOML file: scale, up, facing, and a table [roles] of role = "joint".

    OSError where it cannot be read, ValueError for an unknown key (the nearest one is named) or value.
    """
    try:
        table = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise OSError(f"'{path}' cannot be read ({error.strerror}); give a TOML file that describes a body.") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ValueError(f"'{path}' is not TOML ({error}); write lines such as scale = 100.") from None
    roles = table.pop("roles", {})
    if not isinstance(roles, dict):
        raise ValueError(f"'{path}' has roles = {roles!r}; write a table [roles] with lines such as hips = \"Hips\".")
    _known(table, ("scale", "up", "facing"), f"'{path}'")
    _known(roles, tuple(field.name for field in fields(Roles)), f"[roles] of '{path}'")
    for role, joint in roles.items():
        if not isinstance(joint, str):
            raise ValueError(f"[roles] of '{path}' has {role} = {joint!r}; give the joint's name in quotes.")
    scale = table.pop("scale", None)
    if scale is not None and type(scale) not in (int, float):
        raise ValueError(f"'{path}' has scale = {scale!r}; give the cm of one unit as a number.")
    for key, text in table.items():
        axis(text, f"'{path}' has {key} =")
    try:
        return BodyConfig(None if scale is None else float(scale), **table, roles=Roles(**roles) if roles else None)
    except ValueError as error:
        raise ValueError(f"'{path}': {error}") from None


def axis(text: Any, what: str) -> Axis:
    """The axis that a text names; ValueError, which begins with `what`, where it names none."""
    if text not in ("auto", *AXES):
        raise ValueError(f"{what} {text!r}; give one of auto, {', '.join(AXES)}.")
    return text


def _known(table: dict[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in keys:
            near = difflib.get_close_matches(key, keys, n=1, cutoff=0.0)[0]
            raise ValueError(f"{where} has an unknown key '{key}'; the nearest known one is '{near}'.")


def _roles(skeleton: Skeleton, given: Roles, name: str) -> Roles:
    """Roles by name, those given first; hips, spine and head must be there, the hips above the other two."""
    chosen = {role: joint for role, joint in asdict(given).items() if joint is not None}
    for role, joint in chosen.items():
        if joint not in skeleton.names:
            near = difflib.get_close_matches(joint, skeleton.names, n=1, cutoff=0.0)[0]
            raise ValueError(f"'{name}' has no joint '{joint}', which is given as its {role}; the nearest is '{near}'.")
    roles = replace(skeleton.roles or Roles(), **chosen)
    skeleton = Skeleton(skeleton.names, skeleton.parents, skeleton.offsets, roles)
    for role in ("hips", "spine", "head"):
        try:
            path = skeleton.path(skeleton.role(role))
        except ValueError as error:
            raise ValueError(f"'{name}': {str(error).rstrip('.')}; or name it under [roles] of a body file.") from None
        if skeleton.role("hips") not in path:
            raise ValueError(
                f"'{name}' has its {role} '{getattr(roles, role)}' not below its hips '{roles.hips}'; "
                "name both under [roles] of a body file."
            )
    return roles


def height(skeleton: Skeleton) -> float:
    """About how tall a body with hips and head stands, in the skeleton's units, by the lengths of its bones."""
    lengths = np.linalg.norm(skeleton.offsets, axis=-1)
    hips = skeleton.role("hips")

    def below_hips(role: str) -> float:
        path = skeleton.path(skeleton.role(role))
        return float(lengths[path[path.index(hips) + 1 :]].sum()) if hips in path else 0.0

    assert skeleton.roles is not None
    feet = [below_hips(role) for role in ("left_foot", "right_foot") if getattr(skeleton.roles, role)]
    trunk = below_hips("head")
    return TALLER * (trunk + max(feet)) if feet and max(feet) > 0 else 2.4 * trunk


def _scale(skeleton: Skeleton, name: str) -> float:
    """The cm of one unit in which the body is as tall as a human."""
    tall = height(skeleton)
    for cm in UNITS_CM.values():
        if HUMAN_CM[0] <= tall * cm < HUMAN_CM[1]:
            return cm
    raise ValueError(
        f"'{name}' has a body {tall:.4g} units tall, which is no human height in {', '.join(UNITS_CM)}; "
        "give its scale, the cm of one unit."
    )
