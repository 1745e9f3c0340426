"""The house: what the contracts in pyproject.toml (``make layers``) cannot see of it."""

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest

import unshutter


def test_no_module_imports_one_that_imports_it() -> None:
    """A folder's ``__init__`` counts as a module; imports inside functions and for annotations count, too."""
    graph = grimp.build_graph("unshutter", cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])), pytrace=False)


def test_decoding_begins_before_anything_slow_is_imported() -> None:
    """NumPy, which the search for the motion needs, comes later; most photos need nothing else of these."""
    slow = ("numpy", "multiprocessing", "urllib.request", "importlib.metadata", "hashlib")
    names = [
        "unshutter",
        "unshutter.cli",
        "unshutter.run",
        "unshutter.single.register",
        "unshutter.run.commands",
    ]
    code = f"import sys; sys.modules |= dict.fromkeys({slow}); import {', '.join(names)}"  # to import None fails
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_libraries_are_silent() -> None:
    """What a person reads is written by the command line, the page's server, the progress bar and a batch's report."""
    package = Path(unshutter.__file__).parent
    surfaces = ("cli", "page", "progress.py", "run/report.py", "run/commands.py", "run/estimates.py")
    loud = []
    for path in sorted(package.rglob("*.py")):
        name = path.relative_to(package).as_posix()
        calls = [node.func for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
        if any(isinstance(call, ast.Name) and call.id == "print" for call in calls) and not name.startswith(surfaces):
            loud.append(name)
    assert not loud


def test_few_files_lie_loose_at_the_top() -> None:
    loose = sorted(path.name for path in Path(unshutter.__file__).parent.glob("*.py"))
    assert len(loose) <= 11, loose
