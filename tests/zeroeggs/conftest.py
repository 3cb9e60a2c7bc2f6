"""A body of five joints and networks of a few units, with random weights; files as PyTorch saves them."""

import io
import struct
import zipfile
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.data import scale
from zeggs_jax.data.body import BodyConfig
from zeggs_jax.data.prepare import PrepareConfig, prepare
from zeggs_jax.data.scale import Scale, Scales
from zeggs_jax.motion import bvh, edit, features, pose
from zeggs_jax.motion.pose import Pose, Root
from zeggs_jax.motion.skeleton import Skeleton
from zeggs_jax.nn.compute import PLAIN, Compute
from zeggs_jax.speech import wav
from zeggs_jax.zeroeggs import model as m
from zeggs_jax.zeroeggs.style_clip import bundled_clips

JOINTS, FRAMES = 5, 7
NAMES = ("calm/a", "calm/b", "wild/c", "wild/d")
decode = jax.jit(m.decode, static_argnames=("config", "compute"))


class Small(NamedTuple):
    config: m.ZeroEggsConfig
    params: m.Params
    scales: Scales
    first: Pose
    speech: jax.Array  # [T, S]
    style: jax.Array  # [T, Z]
    gaze: jax.Array  # [T, 3]

    def decode(self, compute: Compute = PLAIN, **changed) -> Pose:
        """`model.decode` of this clip, with some of it changed."""
        config, params, scales, *clip = self._replace(**changed)
        return decode(params, config, scales, *clip, compute=compute)


def random_pose(rng: np.random.Generator, joints: int = JOINTS) -> Pose:
    """Any numbers, and a root turned about y."""
    yaw, (x, z) = rng.uniform(-3.0, 3.0), rng.normal(size=2)
    rot = [np.cos(yaw / 2), 0.0, np.sin(yaw / 2), 0.0]
    shapes = ((3,), (3,), (joints, 3), (joints, 2, 3), (joints, 3), (joints, 3))
    root = Root(single([10.0 * x, 0.0, 10.0 * z]), single(rot))
    return Pose(root, *(single(rng.normal(size=s)) for s in shapes))


def single(numbers) -> jax.Array:
    return jnp.asarray(np.asarray(numbers, np.float32))


def make_small(conditioning: str = "normal", layers: int = 2, frames: int = FRAMES, seed: int = 0) -> Small:
    """A small model and one clip."""
    config = m.ZeroEggsConfig(
        joints=JOINTS,
        speech=m.SpeechEncoderConfig(features=9, hidden=6, size=5, kernel=5),
        style=m.StyleEncoderConfig(hidden=12, size=4),
        decoder=m.DecoderConfig(hidden=16, layers=layers, conditioning=conditioning),  # pyright: ignore
    )
    rng, n = np.random.default_rng(seed), config.vector_size
    scales = Scales(*(Scale(single(rng.normal(size=k)), single(rng.uniform(0.5, 1.5, k))) for k in (9, n + 3, n)))
    shapes = jax.eval_shape(lambda: m.init(jax.random.key(0), config))
    params = jax.tree.map(lambda a: single(rng.normal(size=a.shape) / a.shape[-1] ** 0.5), shapes)
    speech, style, gaze = (single(rng.normal(size=(frames, k)) * by) for k, by in ((5, 1), (4, 1), (3, 100)))
    return Small(config, params, scales, random_pose(rng), speech, style, gaze)


@pytest.fixture(scope="session")
def small() -> Small:
    """Two GRU layers, 'normal' conditioning."""
    return make_small()


@pytest.fixture(scope="session")
def build():
    """`make_small`, for tests that vary it."""
    return make_small


@pytest.fixture(scope="session")
def corpus(tmp_path_factory) -> Path:
    """Two styles of three joints, prepared; one clip is for validation."""
    folder = tmp_path_factory.mktemp("corpus")
    skeleton = Skeleton(("Hips", "Spine", "Head"), (-1, 0, 1), np.array([[0, 90, 0], [0, 30, 0], [0, 40, 0]], float))
    for seed, name in enumerate(NAMES):
        random, time = np.random.default_rng(seed), np.arange(30)[:, None, None] / 30
        euler = 0.3 * np.sin(random.uniform(1, 6, (1, 3, 3)) * time + random.uniform(0, 6, (1, 3, 3)))
        positions = np.repeat(skeleton.offsets[None], len(time), axis=0)
        (folder / name).parent.mkdir(exist_ok=True)
        bvh.write(folder / f"{name}.bvh", bvh.Clip(skeleton, ("zyx",) * 3, euler, positions, 0.033333))
        wav.write(folder / f"{name}.wav", 0.1 * random.normal(size=16000), 16000)
    rows = [f"{name},{name.split('/')[0]},{'valid' if name == NAMES[-1] else 'train'}" for name in NAMES]
    (folder / "corpus.csv").write_text("\n".join(["name,style,split", *rows]) + "\n")
    prepare(folder, folder / "arrays", PrepareConfig(body=BodyConfig(scale=1.0, up="y", facing="z")))
    return folder / "arrays"


@pytest.fixture(scope="session")
def clips(tmp_path_factory) -> Path:
    """The first 2 s of two bundled styles, old.bvh and happy.bvh, and a recording of 1.3 s."""
    where = tmp_path_factory.mktemp("clips")
    for name in ("old", "happy"):
        bvh.write(where / f"{name}.bvh", edit.trim(bvh.read(bundled_clips()[name]), 0, 60))
    noise = np.random.default_rng(0).normal(size=20_800) * np.repeat([0.02, 0.2], 10_400)
    wav.write(where / "speech.wav", noise.astype(np.float32))
    return where


@pytest.fixture(scope="session")
def gesturer(clips) -> m.Model:
    """A small model of the clips' body: random parameters, scales fitted on one clip."""
    clip = bvh.read(clips / "old.bvh")
    motion = features.encode(clip)
    vectors = np.asarray(jax.vmap(pose.to_vector)(motion.pose))
    gaze = np.asarray(jax.vmap(pose.gaze_direction, (0, None))(motion.pose.root, motion.gaze))
    speech = np.random.default_rng(1).normal(size=(60, 81)).astype(np.float32)
    config = m.ZeroEggsConfig(
        frame_time=clip.frame_time,
        speech=m.SpeechEncoderConfig(hidden=8, size=8),
        style=m.StyleEncoderConfig(hidden=16, size=8),
        decoder=m.DecoderConfig(hidden=16),
    )
    scales = scale.fit([speech], [vectors], [gaze], 75)
    return m.Model(config, m.init(jax.random.key(0), config), scales, clip.skeleton)


class Global(NamedTuple):
    """A name in a pickle."""

    module: str
    name: str


class Call(NamedTuple):
    """A pickle's request to call something (REDUCE)."""

    function: object
    arguments: tuple


class Build(NamedTuple):
    """A pickle's request to make an object of a class (NEWOBJ) and give it a state (BUILD)."""

    kind: object
    state: object


class Stored(NamedTuple):
    """A pickle's reference to a storage of the archive."""

    pid: tuple


class TorchFile:
    """Writes .pt files opcode by opcode, good ones and bad ones; needs no PyTorch."""

    Global, Call, Build, Stored = Global, Call, Build, Stored

    def pickled(self, value) -> bytes:
        """`value` in the opcodes of protocol 2."""
        match value:
            case Global():
                return f"c{value.module}\n{value.name}\n".encode()
            case Call():
                return self.pickled(value.function) + self.pickled(value.arguments) + b"R"
            case Build():
                return self.pickled(value.kind) + b")\x81" + self.pickled(value.state) + b"b"
            case Stored():
                return self.pickled(value.pid) + b"Q"
            case None | True | False:
                return {None: b"N", True: b"\x88", False: b"\x89"}[value]
            case int():
                return b"J" + struct.pack("<i", value)
            case str():
                return b"X" + struct.pack("<I", len(value.encode())) + value.encode()
            case tuple():
                return b"(" + b"".join(map(self.pickled, value)) + b"t"
            case list():
                return b"](" + b"".join(map(self.pickled, value)) + b"e"
            case dict():
                return b"}(" + b"".join(self.pickled(k) + self.pickled(v) for k, v in value.items()) + b"u"
        raise TypeError(value)

    def tensor(self, storage, shape, strides=None, offset=0, kind="FloatStorage", count=None, size=0):
        """A parameter whose numbers are in entry data/<storage>."""
        strides = tuple(int(np.prod(shape[i + 1 :])) for i in range(len(shape))) if strides is None else strides
        count = int(np.prod(shape)) if count is None else count
        pid = ("storage", Global("torch", kind), str(storage), "cuda:0", count)
        hooks = Call(Global("collections", "OrderedDict"), ())
        tensor = Call(Global("torch._utils", "_rebuild_tensor_v2"), (Stored(pid), offset, shape, strides, False, hooks))
        return Call(Global("torch._utils", "_rebuild_parameter"), (tensor, True, hooks))

    def module(self, parameters=None, children=None, **extra) -> Build:
        """A network's object."""
        none = Call(Global("__builtin__", "set"), ([],))
        state = {
            "training": True,
            "_parameters": parameters or {},
            "_buffers": {},
            "_modules": children or {},
        }
        return Build(Global("modules", "Decoder"), state | {"_non_persistent_buffers_set": none} | extra)

    def archive(self, value, storages=(), root="archive", compression=zipfile.ZIP_STORED, **entries) -> bytes:
        """The .pt file that holds `value`; a `bytes` value is taken as the pickle itself."""
        pickle = value if isinstance(value, bytes) else b"\x80\x02" + self.pickled(value) + b"."
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", compression) as archive:
            archive.writestr(f"{root}/data.pkl", pickle)
            for number, storage in enumerate(storages):
                archive.writestr(f"{root}/data/{number}", np.asarray(storage, "<f4").tobytes())
            for name, content in entries.items():
                archive.writestr(f"{root}/{name}", content)
        return file.getvalue()

    def network(self, state: dict[str, np.ndarray]) -> bytes:
        """A whole network with this state_dict, as the release saves it."""
        tree: dict = {}
        for number, (name, array) in enumerate(state.items()):
            *parents, leaf = name.split(".")
            place = tree
            for parent in parents:
                place = place.setdefault(parent, {})
            place[leaf] = self.tensor(number, array.shape)

        def build(place: dict) -> Build:
            children = {name: build(child) for name, child in place.items() if isinstance(child, dict)}
            return self.module({k: v for k, v in place.items() if not isinstance(v, dict)}, children)

        return self.archive(build(tree), list(state.values()))


@pytest.fixture(scope="session")
def torch_file() -> TorchFile:
    """A writer of .pt files."""
    return TorchFile()
