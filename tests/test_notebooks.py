"""Every notebook runs from top to bottom in a kernel of this environment, without an error or a warning, offline.

What a test needs besides (few updates, the repository's place, a look at the sliders) it puts into cells of its own:
after the cell that is tagged `parameters`, and at the end.
"""

import json
import re
from pathlib import Path

import nbformat
import pytest
from jupyter_client.kernelspec import KernelSpecManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
SECONDS = 600  # for one cell, on a machine that has much else to do
BAR = re.compile(r"^\s*embedding: ")  # the only thing that may stand on stderr: the progress bar
OFFLINE = """
import socket


def refuse(self, address):
    if self.family != socket.AF_UNIX:
        raise OSError(f"the notebook called {address}")


socket.socket.connect = refuse
"""
GIVEN = {
    "03_against_the_reference": f"REPOSITORY = {str(ROOT)!r}\nSTAGES = ('audio', 'speech_encoder', 'decoder')",
    "04_extend_the_model": "UPDATES, CLIPS, KINDS = 4, 6, ['moments']",  # a step takes half a minute to compile
}
ASKED = {
    "01_first_gesture": """
assert {len(clip.euler) for clip in bodies.values()} == {len(neutral.clip.euler)}
assert zeggs.read_bvh("out/neutral.bvh").euler.shape == neutral.clip.euler.shape
assert Path("out/neutral.provenance.json").is_file()
""",
    "02_style_space": """
before = panel.screen.value
panel.knobs[1].value = -2.0
assert panel.screen.value != before and panel.values == {1: -2.0, 2: -1.0, 3: 0.0, 4: 0.0}
panel.set({1: 2.0})
assert panel.screen.value == before
assert far[0] < far[2] < far[4]
""",
    "03_against_the_reference": """
assert len(found) > 30 and all(row.passed for row in found)
assert all(jax.tree.leaves(same))
""",
    "04_extend_the_model": """
assert models["moments"].config.style.kind == "moments"
assert logs["moments"] and len(libraries["moments"].entries) == CLIPS
""",
}


def run(notebook: nbformat.NotebookNode, folder: Path) -> nbformat.NotebookNode:
    """The notebook executed in `folder`, by this very Python whatever kernels the user has installed."""
    client = NotebookClient(
        notebook,
        timeout=SECONDS,
        startup_timeout=SECONDS,
        kernel_name="python3",
        extra_arguments=["--log-level=ERROR"],
        resources={"metadata": {"path": str(folder)}},
    )
    client.create_kernel_manager().kernel_spec_manager = KernelSpecManager(kernel_dirs=[])
    return client.execute()


def prepared(path: Path) -> nbformat.NotebookNode:
    """A notebook with the test's own cells."""
    notebook = nbformat.read(path, as_version=4)
    tagged = [k for k, cell in enumerate(notebook.cells) if "parameters" in cell.metadata.get("tags", [])]
    if path.stem in GIVEN:
        notebook.cells.insert(tagged[0] + 1, nbformat.v4.new_code_cell(GIVEN[path.stem]))
    notebook.cells.insert(0, nbformat.v4.new_code_cell(OFFLINE))
    notebook.cells.append(nbformat.v4.new_code_cell(ASKED[path.stem]))
    return notebook


def complaints(notebook: nbformat.NotebookNode) -> list[str]:
    """What the cells wrote to stderr, besides the progress bar."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    told = [output.text for output in outputs if output.output_type == "stream" and output.name == "stderr"]
    lines = [line for text in told for line in re.split(r"[\r\n]+", text)]
    return [line for line in lines if line.strip() and not BAR.match(line)]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs(path, tmp_path, monkeypatch):
    monkeypatch.delenv("MPLBACKEND", raising=False)
    monkeypatch.setenv("TF_CPP_MIN_LOG_LEVEL", "3")  # the compiler complains where a machine is slow, not the notebook
    done = run(prepared(path), tmp_path)
    assert not complaints(done)
    assert all(cell.execution_count for cell in done.cells if cell.cell_type == "code")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_a_text_without_outputs(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert all(len("".join(cell["source"]).splitlines()) <= 26 for cell in code)
    assert sum(cell["cell_type"] == "markdown" for cell in cells) > 0.4 * len(code)
    assert "".join(cells[0]["source"]).startswith("# ")


def test_there_are_four():
    assert [path.stem[:2] for path in NOTEBOOKS] == ["01", "02", "03", "04"]


def test_a_planted_fault_is_found(tmp_path):
    """A cell that raises, one that warns, and one that calls a server."""
    cells = ["import warnings; warnings.warn('look here')", OFFLINE + "import urllib.request"]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    assert any("look here" in line for line in complaints(run(notebook, tmp_path)))
    notebook.cells.append(nbformat.v4.new_code_cell("urllib.request.urlopen('http://192.0.2.1', timeout=5)"))
    with pytest.raises(CellExecutionError, match="the notebook called"):
        run(notebook, tmp_path)
