"""The house's rules that a machine can check: import arrows, captions, lengths, rooms that touch the disk."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import zeggs_jax

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "zeggs_jax"
FILES = sorted(PACKAGE.rglob("*.py"))

ARROWS = {
    "cli": {"zeroeggs", "diffuclip", "data", "synthetic", "stage", "metrics", "nn"},
    "zeroeggs": {"data", "motion", "speech", "nn", "training"},
    "diffuclip": {"data", "motion", "speech", "nn", "training"},
    "synthetic": {"motion", "speech", "geometry"},
    "stage": {"motion"},
    "metrics": {"motion", "nn", "training"},
    "data": {"motion", "speech"},
    "motion": {"geometry"},
    "geometry": set(),
    "speech": set(),
    "nn": set(),
    "training": set(),
    "__init__": {"zeroeggs", "motion"},
}

TOUCH_DISK = {
    "speech/wav.py", "speech/transcript.py", "motion/bvh.py",
    "data/corpus.py", "data/prepare.py", "data/prepared.py",
    "data/arrays.py", "data/job.py", "data/join.py", "data/report.py", "data/shard.py",
    "data/takes.py", "data/body.py", "data/entry.py", "data/release.py", "data/table.py",
    "data/recorded.py", "data/made.py", "data/spoken.py",
    "training/checkpoint.py", "training/loop.py", "training/keep.py", "training/record.py",
    "training/devices.py",  # only os._exit
    "synthetic/corpus.py", "stage/player.py", "stage/figures.py", "stage/plots.py", "stage/report.py",
    "zeroeggs/generate.py", "zeroeggs/train.py", "zeroeggs/batch.py", "zeroeggs/examples.py",
    "zeroeggs/checkpoints.py", "zeroeggs/release_files.py", "zeroeggs/run_folder.py", "zeroeggs/settings.py",
    "zeroeggs/validation.py",
    "zeroeggs/timeline.py", "zeroeggs/timeline_text.py", "zeroeggs/library.py",
    "diffuclip/checkpoints.py", "diffuclip/takes.py", "diffuclip/train.py", "diffuclip/generate.py",
    "diffuclip/run_folder.py",
    "diffuclip/request.py", "diffuclip/video.py", "diffuclip/safetensors_folder.py", "diffuclip/t5.py",
    "diffuclip/clip.py", "diffuclip/minilm.py", "diffuclip/asr.py",
    "nn/compiled.py",  # into the user's cache folder, if there is one to write in
    "nn/native.py",  # compiles, into the user's cache folder
    "zeroeggs/export.py", "zeroeggs/library_file.py", "zeroeggs/embedding.py", "zeroeggs/style_clip.py",
}  # fmt: skip
DISK_NAMES = {"open", "pathlib", "os", "shutil", "tempfile"}


def room(path: Path) -> str:
    parts = path.relative_to(PACKAGE).parts
    return parts[0] if len(parts) > 1 else path.stem


def imported_rooms(path: Path) -> set[str]:
    """The rooms of the package that a file imports, by relative or absolute import."""
    parts = path.relative_to(PACKAGE).parts[:-1]
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.ImportFrom) and node.level:
            base = [*parts[: len(parts) - node.level + 1], *(node.module or "").split(".")]
            names = [[*filter(None, base), alias.name] for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("zeggs_jax"):
            names = [[*node.module.split(".")[1:], alias.name] for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [a.name.split(".")[1:] for a in node.names if a.name.startswith("zeggs_jax.")]
        found |= {name[0] for name in names if name}
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_run_one_way(path):
    here = room(path)
    assert here in ARROWS, f"a new room '{here}': draw its arrows here and in CONTRIBUTING.md"
    assert imported_rooms(path) - {here} <= ARROWS[here]


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_every_file_has_a_caption(path):
    tree = ast.parse(path.read_text())
    caption = ast.get_docstring(tree)
    assert caption
    assert caption.splitlines()[0].endswith(".")
    assert tree.body[0].lineno == 1


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_function_over_80_lines(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef):
            assert node.end_lineno - node.lineno < 80, f"{node.name} has {node.end_lineno - node.lineno + 1} lines"


def test_only_the_named_files_touch_the_disk():
    touching = set()
    for path in FILES:
        if room(path) == "cli":  # a door: every command names files
            continue
        tree = ast.parse(path.read_text())
        called = {n.func.id for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        modules = {a.name.split(".")[0] for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
        modules |= {
            (n.module or "").split(".")[0] for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and not n.level
        }
        if (called | modules) & DISK_NAMES:
            touching.add(str(path.relative_to(PACKAGE)))
    assert touching <= TOUCH_DISK


def test_no_room_is_called_utils():
    names = {part for path in FILES for part in path.relative_to(PACKAGE).with_suffix("").parts}
    assert not names & {"utils", "helpers", "common", "misc", "util"}


def test_the_public_face_has_all_its_names():
    assert all(getattr(zeggs_jax, name) is not None for name in zeggs_jax.__all__)
    assert {alias for names in zeggs_jax._PLACES.values() for *_, alias in map(_pair, names)} == set(zeggs_jax.__all__)
    with pytest.raises(AttributeError, match="nothing"):
        zeggs_jax.nothing  # noqa: B018


def _pair(name: str | tuple[str, str]) -> tuple[str, str]:
    return (name, name) if isinstance(name, str) else name


def test_the_command_line_starts_without_what_is_slow_to_import():
    slow = "{'jax', 'flax', 'numpy', 'scipy', 'librosa', 'matplotlib'}"
    code = f"import sys, zeggs_jax.cli; print(*({slow} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "\n"


def test_the_planted_fault_is_found(tmp_path, monkeypatch):
    """An arrow that points up is seen: geometry importing motion."""
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    source = "from ..motion import bvh\nimport zeggs_jax.stage.player\n"
    folder = PACKAGE / "geometry"
    tree_file = tmp_path / "planted.py"
    tree_file.write_text(source)
    fake = folder / "planted.py"
    monkeypatch.setattr(Path, "read_text", lambda self: source if self == fake else "")
    assert imported_rooms(fake) == {"motion", "stage"}
