"""Cells of a chapter by tag, so that a test runs the very lines that the reader sees."""

import json
from pathlib import Path

import numpy as np

NOTEBOOKS = Path(__file__).resolve().parents[1] / "notebooks"


def source(chapter: str, tag: str) -> str:
    """The source of the one cell of ``notebooks/NN_*.ipynb`` that carries the tag."""
    (path,) = NOTEBOOKS.glob(f"{chapter}_*.ipynb")
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    (found,) = [c for c in cells if tag in c["metadata"].get("tags", [])]
    return "".join(found["source"])


def defined(chapter: str, tag: str, **names) -> dict:
    """What that cell defines when it runs with NumPy as ``np`` and the given names."""
    space = {"np": np, **names}
    exec(source(chapter, tag), space)
    return space
