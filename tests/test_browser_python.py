"""A Python that runs in a browser (Pyodide) can import the package, the book's modules and what the chapters need."""

import ast
import json
import re
import sys

import pytest
from conftest import ROOT

# What Pyodide 314.0.6, a Python 3.14, has of the libraries that are imported at the start.
PACKAGES = {
    "pfslam",
    "pfslam_book",
    "PIL",
    "cv2",
    "matplotlib",
    "numpy",
    "platformdirs",
    "scipy",
    "tqdm",
    "yaml",
}
# The modules of Python's library that could not be imported there, each tried.
LACKING = re.compile(
    r"(curses|dbm|ensurepip|grp|msvcrt|pwd|readline|resource|syslog|tkinter|venv|winreg|winsound"
    r"|multiprocessing\.(forkserver|resource_tracker|shared_memory|synchronize))(\.|$)"
)


def imported_at_the_start(code: str) -> set[str]:
    """The dotted names that code imports when it runs, other than in a function that may never be called."""
    found, waiting = set(), [*ast.parse(code).body]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            waiting += [child for child in ast.iter_child_nodes(node) if not isinstance(child, ast.expr)]
    return found


def is_there(name: str) -> bool:
    """Whether a browser's Python has a module, or a name of one; of ours all are there."""
    root = name.partition(".")[0]
    return root in PACKAGES or (root in sys.stdlib_module_names and not LACKING.match(name))


def test_modules_and_chapters_import_at_the_start_only_what_a_browsers_python_has():
    code = {path: path.read_text(encoding="utf-8") for path in (ROOT / "pfslam").rglob("*.py")}
    code |= {path: path.read_text(encoding="utf-8") for path in (ROOT / "book" / "pfslam_book").rglob("*.py")}
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        code[path] = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    lacking = {
        f"{path.relative_to(ROOT).as_posix()}: {name}"
        for path, text in code.items()
        for name in imported_at_the_start(text)
        if not is_there(name)
    }
    assert lacking == set()


@pytest.mark.parametrize(
    ("code", "lacking"),
    [
        ("from multiprocessing import resource_tracker", {"multiprocessing.resource_tracker"}),
        ("if True:\n  import tkinter.ttk", {"tkinter.ttk"}),
        ("import rosbags", {"rosbags"}),
        ("def later():\n  import resource", set()),
        ("if TYPE_CHECKING:\n  import rosbags", set()),
        ("from concurrent.futures.process import BrokenProcessPool", set()),
    ],
)
def test_an_import_that_a_browser_lacks_is_found(code, lacking):
    assert {name for name in imported_at_the_start(code) if not is_there(name)} == lacking
