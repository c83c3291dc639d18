"""Copies of the chapters for a class, made from the one source: `python book/_tools/copies.py OUT NOTEBOOK...`.

They read right wherever a notebook is opened, with no extension: the numbers stand in the text, answers, set-up and
solutions are folded, links lead somewhere. ``OUT/student`` has the stubs and their checks and no solutions,
``OUT/solutions`` has both. Neither holds outputs: who runs a cell sees its own. The students' cells carry the metadata
of nbgrader, which says nothing to anybody else: a point for each check, and below each open question a cell for the
answer, which a person grades.

An exercise is the code cell with the tag ``exercise-N``, its check the next one, ``check-N``, and its solution the one
with ``solution-N`` and the hidden code cells that follow it at once. The tag ``found`` is for what may be found for an
open question, and for the cell that found it.
"""

import argparse
import ast
import hashlib
import json
import os
import re
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import yaml
from addresses import addresses
from plain import Place, plain_markdown
from strip import folded

from pfslam import __version__
from pfslam.errors import DataError

ROOT = Path(__file__).resolve().parents[2]
NUMBERS = (
    ROOT / "_build" / "numbers"
)  # what the book's build wrote down, so that copies need not run the chapters again
EXERCISE, CHECK, SOLUTION = (re.compile(rf"{kind}-\d+") for kind in ("exercise", "check", "solution"))
POINTER = "Open the cell below for a solution."
POINTING = re.compile(re.escape(POINTER) + r"[^\n]*")
EVAL = re.compile(r"\{eval\}`([^`]+)`")
OPEN = re.compile(r"\*\*Exercise (\d+)[^*]*(?:explore and explain|open)[^*]*\*\*")
WHEEL = f"pfslam-{__version__}-py3-none-any.whl"
FOUND = "found"
"""The tag of what follows an open question: how we looked, and what may be found."""
INSTALL = """# Run this cell first: it brings the book's code to Colab, and lets Colab show its laboratories.
%pip install -q anywidget "pfslam[plots,ros,study] @ {wheel}"
from google.colab import output

output.enable_custom_widget_manager()"""
YOUR_ANSWER = "*Your answer: what you tried, what you saw, and why.*"


def source(cell: dict) -> str:
    """The text of a cell."""
    return "".join(cell["source"])


def number(cell: dict, tag: re.Pattern) -> str | None:
    """The N of a cell's tag ``exercise-N``, ``check-N`` or ``solution-N``, None without one."""
    found = [t for t in cell["metadata"].get("tags", []) if tag.fullmatch(t)]
    return found[0].split("-")[1] if found else None


def exercises(notebook: dict, tag: re.Pattern = EXERCISE) -> dict[str, dict]:
    """The cells of a chapter that carry a tag, by their number."""
    return {n: cell for cell in notebook["cells"] if (n := number(cell, tag)) is not None}


def expressions(notebook: dict) -> list[str]:
    """What the sentences of a chapter ask its kernel for, in their order."""
    texts = [source(cell) for cell in notebook["cells"] if cell["cell_type"] == "markdown"]
    return [expression for text in texts for expression in EVAL.findall(text)]


def full_copy(notebook: dict, numbers: Iterable[str], place: Place) -> dict:
    """The chapter with its solutions, in plain Markdown, without outputs and without the marks for its slides."""
    values, cells = iter(numbers), [cell for cell in notebook["cells"] if cell["cell_type"] != "raw"]
    return {**notebook, "cells": [_plain(cell, values, place) for cell in cells]}


def _plain(cell: dict, numbers, place: Place) -> dict:
    if cell["cell_type"] == "markdown":
        return {**cell, "source": plain_markdown(source(cell), numbers, place)}
    if cell["cell_type"] == "code":
        return {**cell, "metadata": folded(cell["metadata"]), "outputs": [], "execution_count": None}
    return cell


def student_copy(notebook: dict, numbers: Iterable[str], place: Place) -> dict:
    """The same without solutions and the lines that point at them; stubs and checks stay."""
    hidden = {cell["id"] for cell in [*solution_cells(notebook), *found_cells(notebook)]}
    cells = [
        graded
        for cell in full_copy(notebook, numbers, place)["cells"]
        if cell["id"] not in hidden
        for graded in _graded(_without_pointer(cell))
    ]
    return {
        **notebook,
        "cells": [cell for cell in cells if source(cell).strip() or cell["cell_type"] == "code"],
    }


def _graded(cell: dict) -> Iterator[dict]:
    """The cell as nbgrader knows it; an open question with a cell for the student's answer."""
    if n := number(cell, EXERCISE):
        yield _marked(cell, f"exercise-{n}", solution=True)
    elif n := number(cell, CHECK):
        yield _marked(cell, f"check-{n}", grade=True, locked=True)
    elif cell["cell_type"] == "markdown" and (question := OPEN.search(source(cell))):
        yield cell
        answer = {**cell, "id": f"{cell['id']}-answer", "metadata": {}, "source": YOUR_ANSWER}
        yield _marked(answer, f"open-{question[1]}", grade=True, solution=True)
    else:
        yield cell


def _marked(cell: dict, name: str, *, grade=False, solution=False, locked=False) -> dict:
    mark = {"grade_id": name, "grade": grade, "solution": solution, "locked": locked, "task": False}
    mark |= {"schema_version": 3} | ({"points": 1} if grade else {})
    return {**cell, "metadata": {**cell["metadata"], "nbgrader": mark}}


def colab_copy(notebook: dict, numbers: Iterable[str], place: Place) -> dict:
    """The students' copy with a first cell for Colab, which has no pfslam: it installs the wheel beside the site."""
    wheel = f"{place.site}/{WHEEL}"
    return with_first_cell(student_copy(notebook, numbers, place), INSTALL.format(wheel=wheel))


def with_first_cell(copy: dict, code: str) -> dict:
    """The copy with one more cell before all others: it brings the book's code to where the copy is opened."""
    cell = {"cell_type": "code", "id": "install", "metadata": {}, "outputs": [], "execution_count": None}
    return {**copy, "cells": [{**cell, "source": code}, *copy["cells"]]}


def solution_cells(notebook: dict) -> list[dict]:
    """The cells that a student does not get: solutions, and what is done with them in the cells right after."""
    found, inside = [], False
    for cell in notebook["cells"]:
        follows = inside and cell["cell_type"] == "code" and "hide-cell" in cell["metadata"].get("tags", [])
        inside = number(cell, SOLUTION) is not None or follows
        if inside:
            found.append(cell)
    return found


def found_cells(notebook: dict) -> list[dict]:
    """How we looked at an open question, and what was found, in order."""
    return [cell for cell in notebook["cells"] if FOUND in cell["metadata"].get("tags", [])]


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


def made_of(path: Path) -> str:
    """One number for all that a chapter's numbers depend on: its cells, the package, the libraries."""
    digest = hashlib.sha256()
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        digest.update(f"{cell['cell_type']}\0{source(cell)}\0".encode())
    code = [file for name in ("pfslam", "book/pfslam_book") for file in (ROOT / name).rglob("*.*")]
    for file in sorted([*code, ROOT / "requirements.lock"]):
        if file.is_file() and "__pycache__" not in file.parts:
            digest.update(f"{file.relative_to(ROOT).as_posix()}\0".encode() + file.read_bytes())
    return digest.hexdigest()


def write_numbers(path: Path, numbers: list[str], folder: Path = NUMBERS) -> None:
    """Keep the numbers of a chapter that was just run, with what they were made of."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = json.dumps({"made of": made_of(path), "numbers": numbers}, ensure_ascii=False)
    (folder / f"{path.stem}.json").write_text(kept, encoding="utf-8")


def numbers_of(path: Path, folder: Path = NUMBERS) -> list[str]:
    """The numbers in a chapter's sentences: as the book's build found them if nothing changed, else by running it."""
    kept = folder / f"{path.stem}.json"
    if kept.is_file() and (found := json.loads(kept.read_text(encoding="utf-8")))["made of"] == made_of(path):
        return found["numbers"]
    return run(path)


def run(path: Path) -> list[str]:
    """Run a chapter in a kernel of its own; gives what its sentences ask for, each at its place in the reading."""
    import nbformat  # two seconds, which only those pay who run a chapter
    from nbclient import NotebookClient

    notebook, numbers = nbformat.read(path, as_version=4), []
    client = NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(path.parent)}})
    with client.setup_kernel():
        for index, cell in enumerate(notebook.cells):
            if cell.cell_type == "code":
                client.execute_cell(cell, index)
            elif cell.cell_type == "markdown":
                numbers += [_value(client, path, expression) for expression in EVAL.findall(cell.source)]
    return numbers


def _value(client, path: Path, expression: str) -> str:
    """What the kernel answers to an expression, as the reader sees it."""
    request = client.kc.execute("", silent=True, user_expressions={"value": expression})
    answer = client.wait_for_reply(request)["content"]["user_expressions"]["value"]
    if answer["status"] != "ok":
        raise DataError(path, expression, f"{answer['ename']}: {answer['evalue']}", "an expression")
    text = answer["data"]["text/plain"]
    return ast.literal_eval(text) if text[0] in "'\"" else text


def write_notebook(path: Path, notebook: dict) -> None:
    """Write a notebook, and the folder that it lies in."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(notebook, indent=1, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def write_copies(out: Path, notebooks: list[Path], numbers: list[list[str]]) -> None:
    """Write both copies of each chapter below ``out``."""
    settings = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))
    site = addresses(settings, os.environ).site
    place = Place(ROOT, frozenset(path.name for path in notebooks), site)
    for path, values in zip(notebooks, numbers, strict=True):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        for kind, copy in (("student", student_copy), ("solutions", full_copy)):
            write_notebook(out / kind / path.name, copy(notebook, values, place))


def main(arguments: list[str] | None = None) -> int:
    """Write the copies named on the command line."""
    parser = argparse.ArgumentParser(prog="python book/_tools/copies.py", description=main.__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("notebooks", nargs="+", type=Path)
    parser.add_argument("--workers", type=int, default=2, help="chapters that run at the same time")
    options = parser.parse_args(arguments)
    try:
        for path in options.notebooks:
            check_pairs(path, json.loads(path.read_text(encoding="utf-8")))
        with ThreadPoolExecutor(options.workers) as pool:
            numbers = list(pool.map(numbers_of, options.notebooks))
        write_copies(options.out, options.notebooks, numbers)
    except DataError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{len(numbers)} chapters, without solutions and with them, are in {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
