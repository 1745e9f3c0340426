"""examples/research.ipynb runs from its first cell to its last, and is stored without what it printed."""

import json
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[2] / "examples" / "research.ipynb"
RUN = """
import sys
import nbformat
from nbclient import NotebookClient

notebook = nbformat.read(sys.argv[1], 4)
NotebookClient(notebook, timeout=300, resources={"metadata": {"path": sys.argv[2]}}).execute()
nbformat.write(notebook, sys.argv[3])
"""


@pytest.mark.thorough  # ten seconds; each of its commands has tests of its own
@pytest.mark.skipif(find_spec("nbclient") is None or find_spec("ipykernel") is None, reason="runs notebooks")
def test_the_notebook_runs_and_says_what_its_texts_promise(tmp_path: Path) -> None:
    done = tmp_path / "done.ipynb"
    command = [sys.executable, "-c", RUN, str(NOTEBOOK), str(NOTEBOOK.parent), str(done)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False)
    assert run.returncode == 0, run.stderr
    outputs = [output for cell in json.loads(done.read_text())["cells"] for output in cell.get("outputs", [])]
    printed = "".join("".join(output["text"]) for output in outputs if output.get("name") == "stdout")
    before, found = (float(word) for word in re.findall(r"unchanged ([\d.]+) px, found ([\d.]+) px", printed)[0])
    assert found < before / 5
    assert len(re.findall(r"basilica_0\d\.png: [\d.]+ px, confidence 0\.\d\d", printed)) == 3
    nothing, default = (float(word) for word in re.findall(r"(?:none|segment-manhattan): ([\d.]+) px", printed))
    assert default < nothing
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2


def test_the_notebook_is_stored_without_outputs() -> None:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    assert all(cell.get("outputs", []) == [] and cell.get("execution_count") is None for cell in cells)
    assert NOTEBOOK.stat().st_size < 20_000
