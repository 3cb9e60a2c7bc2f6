"""BVH text to `Clip` and back: any channel order and count per joint in, the release's layout out.

Degrees and file layout stay in here: a `Clip` holds radians and centimetres. A joint's position channels
replace its OFFSET, axis by axis, as in the release; End Sites are not joints.
"""

import codecs
import os
import re
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from zeggs_jax.motion import decimals
from zeggs_jax.motion.skeleton import Skeleton

ROWS = 64  # frames that are written at a time
HEAD = 4096  # bytes behind MOTION in which its two lines stand


class Clip(NamedTuple):
    """Motion of a body as BVH stores it, T frames of J joints."""

    skeleton: Skeleton
    orders: tuple[str, ...]  # one per joint: "zyx" is R_z R_y R_x, the columns of `euler`
    euler: Float[np.ndarray, "T J 3"]  # radians, each joint's columns in its own order, parent frame
    positions: Float[np.ndarray, "T J 3"]  # cm, xyz, parent frame (joint 0: world)
    frame_time: float  # s, as the file gives it; see `rate_hz`


class _Joint(NamedTuple):
    name: str
    parent: int
    offset: list[float]
    channels: list[str]  # lower case


def rate_hz(frame_time: float) -> float:
    """Frames per second: the whole number that `frame_time` (s) was rounded from, else `1 / frame_time`.

    0.016667, 0.0166666 and 0.016666 are all 60; 29.97 stays what it is.
    """
    rate = 1.0 / frame_time
    whole = round(rate)
    return float(whole) if whole and abs(rate / whole - 1.0) < 5e-4 else rate


def read(path: str | Path) -> Clip:
    """The clip in a BVH file; ValueError says what is wrong with the file and where."""
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"'{path}' is a folder, not a BVH file; give one of the .bvh files.")
    if not path.exists():
        raise FileNotFoundError(f"There is no BVH file '{path}'.")
    raw = path.read_bytes()
    if b"\0" in raw:
        raise ValueError(f"'{path.name}' is not a BVH file: it holds binary data, a BVH is plain text.")
    return _parse(raw, path.name)


def write(path: str | Path, clip: Clip, translations: bool = False) -> None:
    """Write a clip; without `translations` only joint 0 keeps its positions, the others their OFFSET.

    End Sites are not part of a `Clip`: every leaf gets one with OFFSET 0 0 0, as in the release, so a file that is
    read and written again loses the offsets of its End Sites.
    The file appears whole or not at all; an OSError or ValueError says in one sentence why it does not.
    """
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"'{path}' is a folder; give the name of a .bvh file.")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"There is no folder '{path.parent}' to write '{path.name}' in; make it first.")
    text = format(clip, translations)
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_text(text, encoding="utf-8", newline="\n")
        os.replace(partial, path)
    except OSError as error:
        raise OSError(f"'{path}' cannot be written: {error.strerror}.") from error
    finally:
        partial.unlink(missing_ok=True)


def parse(text: str, name: str = "BVH text") -> Clip:
    """The clip in BVH `text`; `name` stands for the file in error messages."""
    return _parse(text.encode(), name)


def _parse(raw: bytes, name: str) -> Clip:
    """The clip in a file's bytes: only what stands before its numbers becomes text, for they are many."""
    raw = raw.removeprefix(codecs.BOM_UTF8)
    if not raw or raw.isspace():
        raise ValueError(f"'{name}' is empty; a BVH begins with the word HIERARCHY.")
    raw = raw.replace(b"\r", b"\n")
    motion = re.search(rb"^[ \t]*MOTION[ \t]*$", raw, flags=re.M | re.I)
    hierarchy = _text(raw[: motion.start() if motion else len(raw)])
    if not re.match(r"\s*HIERARCHY\b", hierarchy, flags=re.I):
        first = hierarchy.split()[0] if hierarchy.strip() else "MOTION"
        raise ValueError(f"'{name}' is not a BVH file: it begins with {first[:20]!r}, not HIERARCHY.")
    if not motion:
        raise ValueError(f"'{name}' has a HIERARCHY but no MOTION; it was cut off or holds no motion.")
    joints = _hierarchy(hierarchy, name)
    names, parents, offsets, channels = zip(*joints, strict=True)
    frame_time, values = _frames(memoryview(raw)[motion.end() :], joints, name)
    try:
        skeleton = Skeleton(names, parents, np.asarray(offsets))
    except ValueError as error:
        raise ValueError(f"'{name}' has a hierarchy that cannot be used: {error}") from None
    return _clip(skeleton, channels, values, frame_time)


def _text(raw: bytes) -> str:
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _hierarchy(text: str, name: str) -> list[_Joint]:
    """The joints in order of appearance."""
    words = text.replace("{", " { ").replace("}", " } ").split()
    joints: list[_Joint] = []
    open_joints = [-1]
    at = 1
    try:
        while at < len(words):
            word = words[at].upper()
            if word in ("ROOT", "JOINT"):
                brace = words.index("{", at)
                if brace == at + 1:
                    raise ValueError("a joint has no name")
                joints.append(_Joint(" ".join(words[at + 1 : brace]), open_joints[-1], [], []))
                open_joints.append(len(joints) - 1)
                at = brace + 1
            elif word == "END":
                at = words.index("}", at) + 1
            elif word == "OFFSET":
                joints[open_joints[-1]].offset.extend(float(number) for number in words[at + 1 : at + 4])
                at += 4
            elif word == "CHANNELS":
                count = int(words[at + 1])
                joints[open_joints[-1]].channels.extend(_channels(words[at + 2 : at + 2 + count], count))
                at += 2 + count
            elif word == "}":
                open_joints.pop()
                at += 1
            else:
                raise ValueError(f"unexpected {words[at]!r}")
        if len(open_joints) != 1 or not joints or any(len(joint.offset) != 3 for joint in joints):
            raise ValueError("a brace or an OFFSET is missing")
        if not np.isfinite([joint.offset for joint in joints]).all():
            raise ValueError("an OFFSET is not finite")
    except (ValueError, IndexError) as error:
        joint = f"after joint '{joints[-1].name}'" if joints else "at its beginning"
        raise ValueError(f"'{name}' has a broken hierarchy {joint}: {error}.") from None
    return joints


def _channels(words: list[str], count: int) -> list[str]:
    """Channel names in lower case; scale channels are allowed and ignored later."""
    channels = [word.lower() for word in words]
    wrong = [word for word in channels if not re.fullmatch(r"[xyz](position|rotation|scale)", word)]
    if wrong or len(channels) != count or len(set(channels)) != count:
        raise ValueError(f"CHANNELS {count} is followed by {' '.join(words)!r}")
    return channels


def _frames(raw: memoryview, joints: list[_Joint], name: str) -> tuple[float, Float[np.ndarray, "T C"]]:
    """Frame time and the block of numbers, one row per frame."""
    text = bytes(raw[:HEAD]).decode("latin-1")
    frames = re.match(r"\s*Frames[ \t]*:?[ \t]*(\d+)[ \t]*$", text, flags=re.M | re.I)
    if frames is None:
        raise ValueError(f"'{name}' has no line 'Frames: N' after MOTION.")
    time = re.match(r"\s*Frame\s+Time[ \t]*:?[ \t]*(\S+)[ \t]*$", text[frames.end() :], flags=re.M | re.I)
    if time is None:
        raise ValueError(f"'{name}' has no line 'Frame Time: seconds' after its Frames line.")
    try:
        frame_time = float(time[1])
    except ValueError:
        frame_time = np.nan
    if not 1e-6 <= frame_time <= 1e3:
        raise ValueError(f"'{name}' has frame time {time[1]!r}; it must be a number of seconds from 1e-6 to 1000.")
    count, width = int(frames[1]), sum(len(joint.channels) for joint in joints)
    if not count or not width:
        raise ValueError(f"'{name}' holds no motion: {count} frames of {width} channels.")
    block = raw[frames.end() + time.end() :]
    values = decimals.read(block)
    values = _numbers(_text(bytes(block))) if values is None else values
    if values is None or values.size != count * width:
        raise ValueError(f"'{name}' {_what_is_wrong(_text(bytes(block)), count, width)}")
    values = values.reshape(count, width)
    if not np.isfinite(values).all():
        frame, column = np.argwhere(~np.isfinite(values))[0]
        joint, channel = [(j.name, channel) for j in joints for channel in j.channels][column]
        raise ValueError(
            f"'{name}' has {values[frame, column]} in channel {channel.capitalize()} of joint '{joint}' "
            f"in frame {frame} (counted from 0); every channel must be a finite number."
        )
    return frame_time, values


def _numbers(text: str) -> Float[np.ndarray, "n"] | None:
    """All numbers of a text, None where something is no number."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.loadtxt(text.splitlines(), comments=None).ravel()
        except (ValueError, UserWarning):  # also where lines differ in length, which is slower to read
            pass
        try:
            return np.fromstring(text, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def _what_is_wrong(block: str, count: int, width: int) -> str:
    """Why a block is not `count` lines of `width` numbers."""
    lines = [line.split() for line in block.splitlines() if line.strip()]
    for frame, words in enumerate(lines):
        bad = next((word for word in words if _numbers(word) is None), None)
        if bad is not None:
            return f"has {bad!r} where a number belongs, in frame {frame} (counted from 0)."
        if len(words) < width and frame == len(lines) - 1:
            return f"is cut off in frame {frame} (counted from 0): {len(words)} of {width} numbers are there."
        if len(words) != width:
            return f"has {len(words)} numbers in frame {frame} (counted from 0), its channels need {width}."
    return f"announces {count} frames and holds {len(lines)}; correct its Frames line or complete the file."


def _clip(skeleton: Skeleton, channels: tuple[list[str], ...], values: np.ndarray, frame_time: float) -> Clip:
    """The block's columns brought to their joints and axes."""
    letters = ["".join(c[0] for c in joint if c.endswith("rotation")) for joint in channels]
    usual = max((o for o in letters if len(o) == 3), key=letters.count, default="zyx")
    orders = tuple(order + "".join(x for x in usual if x not in order) for order in letters)
    turns, places = np.full((2, len(skeleton), 3), -1)  # column of each joint's axes; -1: none
    flat = [(joint, channel) for joint, listed in enumerate(channels) for channel in listed]
    for column, (joint, channel) in enumerate(flat):
        if channel.endswith("rotation"):
            turns[joint, orders[joint].index(channel[0])] = column
        elif channel.endswith("position"):
            places[joint, "xyz".index(channel[0])] = column
    euler = _placed(values, turns, np.zeros_like(skeleton.offsets))
    return Clip(skeleton, orders, np.radians(euler, out=euler), _placed(values, places, skeleton.offsets), frame_time)


def _placed(values: Float[np.ndarray, "T C"], columns: Int[np.ndarray, "J 3"], without: Float[np.ndarray, "J 3"]):
    """The values of some columns, [T, J, 3], and for a joint that has none what it is `without` one."""
    if (columns >= 0).all():
        return values.take(columns, axis=1)
    placed = np.tile(without, (len(values), 1, 1))
    placed[:, columns >= 0] = values[:, columns[columns >= 0]]
    return placed


def format(clip: Clip, translations: bool = False) -> str:
    """BVH text in the release's layout: tabs, six decimals, depth first, an End Site on every leaf."""
    lines = ["HIERARCHY"]
    columns: list[np.ndarray] = []

    def joint_text(joint: int, depth: int) -> None:
        tab, skeleton = "\t" * depth, clip.skeleton
        lines.extend([f"{tab}{'JOINT' if joint else 'ROOT'} {skeleton.names[joint]}", f"{tab}{{"])
        lines.append(f"{tab}\tOFFSET {_triple(skeleton.offsets[joint])}")
        turns = " ".join(f"{letter.upper()}rotation" for letter in clip.orders[joint])
        if translations or not joint:
            lines.append(f"{tab}\tCHANNELS 6 Xposition Yposition Zposition {turns} ")
            columns.append(clip.positions[:, joint])
        else:
            lines.append(f"{tab}\tCHANNELS 3 {turns}")
        columns.append(np.degrees(clip.euler[:, joint]))
        children = [child for child, parent in enumerate(skeleton.parents) if parent == joint]
        for child in children:
            joint_text(child, depth + 1)
        if not children:
            lines.extend([f"{tab}\tEnd Site", f"{tab}\t{{", f"{tab}\t\tOFFSET {_triple(np.zeros(3))}", f"{tab}\t}}"])
        lines.append(f"{tab}}}")

    joint_text(0, 0)
    block = np.concatenate(columns, axis=-1)
    lines.extend(["MOTION", f"Frames: {len(block)}", f"Frame Time: {_seconds(clip.frame_time)}", ""])
    return "\n".join(lines) + _rows(block)


def _rows(block: Float[np.ndarray, "T C"]) -> str:
    """The numbers, a line per frame; many frames at a time, as one conversion of many numbers is faster than many."""
    row = "%f " * block.shape[1] + "\n"
    parts = (block[start : start + ROWS] for start in range(0, len(block), ROWS))
    return "".join(row * len(part) % tuple(part.ravel().tolist()) for part in parts)


def _seconds(frame_time: float) -> str:
    """Six decimals where they are exact, as in the release, else as many as bring the same number back."""
    text = f"{frame_time:f}"
    return text if float(text) == frame_time else repr(float(frame_time))


def _triple(xyz: np.ndarray) -> str:
    return " ".join(f"{x:f}" for x in xyz)
