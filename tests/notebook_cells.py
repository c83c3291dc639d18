"""Cells of a chapter by tag, so that a test runs the very lines that the reader sees."""

import json
from importlib import import_module
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
    """What that cell defines when it runs with NumPy as ``np``, its chapter's ``chNN`` and the given names."""
    helpers = f"ch{chapter}"
    space = {"np": np, helpers: import_module(f"pfslam.teaching.{helpers}"), **names}
    exec(source(chapter, tag), space)
    return space


def check_stub_and_solution(chapter: str, number: int, name: str, check, checks: dict) -> None:
    """The stub of an exercise counts as unanswered, its solution passes."""
    stub = defined(chapter, f"exercise-{number}", **checks)[name]
    assert check(stub).verdict == "unanswered"
    assert check(defined(chapter, f"solution-{number}", **checks)[f"{name}_solution"])


def check_nonsense_is_named(check, plain_number: float, row: int) -> None:
    """A check answers whatever a student's function does; it never raises."""

    def broken(*arguments):
        return nothing  # noqa: F821

    assert "NameError" in check(broken).message
    nonsense = ("text", [[1.0], [1.0, 2.0]], np.zeros((7, 7)), {"a": 1}, np.full(row, np.nan))
    for answer in (plain_number, *nonsense):
        assert check(lambda *arguments, answer=answer: answer).verdict == "wrong"
