"""Cells of a chapter by tag, so that a test runs the very lines that the reader sees."""

import ast
import json
from pathlib import Path

NOTEBOOKS = Path(__file__).resolve().parents[1] / "notebooks"


def source(chapter: str, tag: str) -> str:
    """The source of the one cell of ``notebooks/NN_*.ipynb`` that carries the tag."""
    (path,) = NOTEBOOKS.glob(f"{chapter}_*.ipynb")
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    (found,) = [c for c in cells if tag in c["metadata"].get("tags", [])]
    return "".join(found["source"])


def run(code: str, space: dict):
    """Run the lines of a cell among the names of ``space``; gives what the notebook would show, or None."""
    *before, last = ast.parse(code).body
    exec(compile(ast.Module(before, []), "cell", "exec"), space)
    if isinstance(last, ast.Expr):
        return eval(compile(ast.Expression(last.value), "cell", "eval"), space)
    exec(compile(ast.Module([last], []), "cell", "exec"), space)
    return None
