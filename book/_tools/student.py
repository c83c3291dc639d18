"""Copies of the chapters for a class, made from the one source: `python book/_tools/student.py OUT NOTEBOOK...`.

A student copy has the stubs and their checks and no solutions; with ``--solutions`` the copy has both. Neither holds
outputs: who runs a cell sees its own. An exercise is the code cell with the tag ``exercise-N``, its solution the one
with ``solution-N`` and the hidden code cells that follow it at once.
"""

import argparse
import json
import re
import sys
from pathlib import Path

from pfslam.errors import DataError
from pfslam.io.files import read_text, write_text

EXERCISE, SOLUTION = re.compile(r"exercise-\d+"), re.compile(r"solution-\d+")
POINTER = "Open the cell below for a solution."
POINTING = re.compile(re.escape(POINTER) + r"[^\n]*")


def number(cell: dict, tag: re.Pattern) -> str | None:
    """The N of a cell's tag ``exercise-N`` or ``solution-N``, None without one."""
    found = [t for t in cell["metadata"].get("tags", []) if tag.fullmatch(t)]
    return found[0].split("-")[1] if found else None


def exercises(notebook: dict, tag: re.Pattern = EXERCISE) -> dict[str, dict]:
    """The cells of a chapter that carry a tag, by their number."""
    return {n: cell for cell in notebook["cells"] if (n := number(cell, tag)) is not None}


def source(cell: dict) -> str:
    """The text of a cell."""
    return "".join(cell["source"])


def full_copy(notebook: dict) -> dict:
    """The chapter with its solutions, without outputs."""
    return {**notebook, "cells": [_silent(cell) for cell in notebook["cells"]]}


def student_copy(notebook: dict) -> dict:
    """The chapter without outputs, solutions, and the lines that point at them; stubs and checks stay."""
    hidden = {cell["id"] for cell in solution_cells(notebook)}
    cells = [_without_pointer(cell) for cell in full_copy(notebook)["cells"] if cell["id"] not in hidden]
    return {
        **notebook,
        "cells": [cell for cell in cells if source(cell).strip() or cell["cell_type"] == "code"],
    }


def solution_cells(notebook: dict) -> list[dict]:
    """The cells that a student does not get: solutions, and what is done with them in the cells right after."""
    found, inside = [], False
    for cell in notebook["cells"]:
        follows = inside and cell["cell_type"] == "code" and "hide-cell" in cell["metadata"].get("tags", [])
        inside = number(cell, SOLUTION) is not None or follows
        if inside:
            found.append(cell)
    return found


def _silent(cell: dict) -> dict:
    return {**cell, "outputs": [], "execution_count": None} if cell["cell_type"] == "code" else cell


def _without_pointer(cell: dict) -> dict:
    if cell["cell_type"] != "markdown" or POINTER not in source(cell):
        return cell
    return {**cell, "source": POINTING.sub("", source(cell)).strip()}


def check_pairs(path: Path, notebook: dict) -> None:
    """Every exercise has one solution and the other way round, or ``DataError`` names those that have not."""
    asked, solved = set(exercises(notebook)), set(exercises(notebook, SOLUTION))
    if alone := sorted(asked ^ solved):
        raise DataError(
            path, "exercises", f"{', '.join(alone)} alone", "a stub and a solution for each number"
        )


def write_copies(out: Path, notebooks: list[Path], solutions: bool = False) -> list[Path]:
    """Write one copy of each chapter into ``out``; gives their paths."""
    written = []
    for path in notebooks:
        notebook = json.loads(read_text(path))
        check_pairs(path, notebook)
        copy = full_copy(notebook) if solutions else student_copy(notebook)
        write_text(out / path.name, json.dumps(copy, indent=1, ensure_ascii=False) + "\n")
        written.append(out / path.name)
    return written


def main(arguments: list[str] | None = None) -> int:
    """Write the copies named on the command line."""
    parser = argparse.ArgumentParser(prog="python book/_tools/student.py", description=main.__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("notebooks", nargs="+", type=Path)
    parser.add_argument("--solutions", action="store_true", help="with the solutions")
    options = parser.parse_args(arguments)
    try:
        written = write_copies(options.out, options.notebooks, options.solutions)
    except DataError as error:
        print(error, file=sys.stderr)
        return 2
    print(
        f"{len(written)} chapters {'with' if options.solutions else 'without'} solutions are in {options.out}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
