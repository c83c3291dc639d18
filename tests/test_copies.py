"""Copies of the chapters: readable with no extension, no solution leaks, and nothing but the solutions is missing."""

import ast
import json
import re
from itertools import pairwise
from pathlib import Path

import pytest
from copies import (
    CHECK,
    EXERCISE,
    OPEN,
    POINTER,
    SOLUTION,
    exercises,
    expressions,
    found_cells,
    full_copy,
    main,
    number,
    numbers_of,
    solution_cells,
    source,
    student_copy,
    write_numbers,
)
from plain import Place, plain_markdown

from pfslam.errors import DataError

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
BESIDE = frozenset(path.name for path in NOTEBOOKS)
HERE, ALONE = Place(ROOT, BESIDE), Place(ROOT)
PUBLISHED = Place(ROOT, BESIDE, "https://example.org/book/")
each_chapter = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
# What only MyST understands. A line of a formula may well begin with a parenthesis: a label ends in an equals sign.
MYST = re.compile(r"\{[\w:+-]+\}`|^ *:{3,}|^ *`{3,}\{|\$\$ *\(|^\([\w-]+\)= *$|^:[\w-]+: ", re.MULTILINE)
LINK = re.compile(r"\]\(([^()\s]*)\)")


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))


def values(notebook):
    """A number for each expression, so that no chapter need run."""
    return [f"{k}.5" for k, _ in enumerate(expressions(notebook))]


def full(notebook, place=HERE):
    return full_copy(notebook, values(notebook), place)


def student(notebook, place=HERE):
    return student_copy(notebook, values(notebook), place)


def code(cells):
    return [cell for cell in cells if cell["cell_type"] == "code"]


def prose(notebook):
    return [source(cell) for cell in notebook["cells"] if cell["cell_type"] == "markdown"]


def defined(cell) -> set[str]:
    """The functions and variables that a code cell makes at its top level."""
    names = set()
    for node in ast.parse(source(cell)).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        names |= {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    return names


def used(cell) -> set[str]:
    """The names that a code cell uses, but for the arguments of its functions."""
    nodes = list(ast.walk(ast.parse(source(cell))))
    own = {node.arg for node in nodes if isinstance(node, ast.arg)}
    return {node.id for node in nodes if isinstance(node, ast.Name)} - own


@each_chapter
def test_every_exercise_has_its_stub_its_check_and_one_solution(path):
    notebook = read(path)
    stubs, checks, solutions = (exercises(notebook, tag) for tag in (EXERCISE, CHECK, SOLUTION))
    assert stubs.keys() == checks.keys() == solutions.keys()
    for before, cell in pairwise(notebook["cells"]):
        n = number(cell, CHECK)
        assert n is None or before is stubs[n], f"the check of exercise {n} is not right below it"
        assert number(cell, SOLUTION) is None or POINTER in source(before), (
            f"{cell['id']}: nothing points at it"
        )


@each_chapter
@pytest.mark.parametrize("copy", [student, full])
@pytest.mark.parametrize("place", [HERE, ALONE, PUBLISHED], ids=["beside", "alone", "published"])
def test_every_sentence_reads_right_without_an_extension(path, copy, place):
    for text in prose(copy(read(path), place)):
        assert not MYST.search(text), MYST.search(text)[0]
        assert text.count("<details>") == text.count("</details>") == text.count("<summary>")
        for target in LINK.findall(text):
            assert target in place.beside or (place.site and target.startswith(place.site)), target


@each_chapter
def test_a_student_copy_lacks_the_solutions_and_nothing_else(path):
    notebook = read(path)
    kept = {cell["id"]: cell for cell in student(notebook)["cells"]}
    assert exercises(student(notebook), SOLUTION) == {}
    answers = {cell["id"] for cell in [*solution_cells(notebook), *found_cells(notebook)]}
    for cell in full(notebook)["cells"]:
        if cell["id"] not in kept:
            assert cell["id"] in answers or source(cell).strip().startswith(POINTER)
        elif POINTER not in source(cell):
            assert source(kept[cell["id"]]) == source(cell)
    names = [c["metadata"]["nbgrader"]["grade_id"] for c in kept.values() if "nbgrader" in c["metadata"]]
    assert len(set(names)) == len(names) > 2 * len(exercises(notebook))


@each_chapter
def test_what_was_found_for_an_open_question_is_kept_from_students_and_asked_of_them(path):
    notebook = read(path)
    kept = {cell["id"]: cell for cell in student(notebook)["cells"]}
    asked = [cell["id"] for cell in notebook["cells"] if OPEN.search(source(cell))]
    assert len(asked) == 1
    assert kept[f"{asked[0]}-answer"]["metadata"]["nbgrader"]["grade"]
    *looked, answer = found_cells(notebook)
    assert answer["cell_type"] == "markdown"
    assert len(looked) <= 1
    assert not {cell["id"] for cell in found_cells(notebook)} & set(kept)


@each_chapter
def test_no_solution_leaks(path):
    notebook = read(path)
    copy = student(notebook)
    everything = "\n".join(source(cell) for cell in copy["cells"])
    assert "_solution" not in everything
    assert POINTER not in everything
    stubs = {line.strip() for cell in exercises(notebook).values() for line in source(cell).splitlines()}
    # Code cells may hold the very lines where a chapter shows the package: only those after the first stub count.
    cells = notebook["cells"]
    first = min((i for i, cell in enumerate(cells) if number(cell, EXERCISE)), default=len(cells))
    later = {cell["id"] for cell in cells[first:]}
    after = "\n".join(source(cell) for cell in copy["cells"] if cell["id"] in later)
    for solution in solution_cells(notebook):
        for line in map(str.strip, source(solution).splitlines()):
            assert line in stubs or len(line) < 16 or line not in after, f"a line of the solution: {line}"


@each_chapter
def test_the_rest_of_the_chapter_does_not_need_the_solutions(path):
    notebook = read(path)
    answers = [*solution_cells(notebook), *found_cells(notebook)]
    hidden = set().union(*map(defined, (cell for cell in answers if cell["cell_type"] == "code")))
    cells = code(student(notebook)["cells"])
    hidden -= set().union(*map(defined, cells))
    for cell in cells:
        assert not used(cell) & hidden, f"{cell['id']} uses what only a solution makes"


PLAIN = {
    "It is {eval}`f'{x:.1f}'` m.": "It is 1.5 m.",
    "Eq. {eq}`eq-12` says": "Eq. (12) says",
    "$$\na = b\n$$ (eq-12)\n\nand": "$$\na = b \\tag{12}\n$$\n\nand",
    "```{math}\n:label: eq-2\n:enumerator: 2\na = b\n```": "$$\na = b\n\\tag{2}\n$$",
    "```{math}\n:enumerated: false\na = b\n```": "$$\na = b\n$$",
    ":::{admonition} Answer\n:class: dropdown\n42\n:::": "<details><summary>Answer</summary>\n\n42\n\n</details>",
    "::::{note}\n:::{tip}\nlook\n:::\n::::": "> **Note**\n>\n> > **Tip**\n> >\n> > look",
    "(here)=\n## Heading": "## Heading",
    "```python\n:::{note}\n```": "```python\n:::{note}\n```",
    "[](05_particle_filter_slam.ipynb)": "[05 Particle-filter SLAM](05_particle_filter_slam.ipynb)",
    "[slips](../book/errata.md#eq-9)": "[slips](https://example.org/book/book/errata.html#eq-9)",
    "[`pfslam/slam.py`](../pfslam/slam.py)": "[`pfslam/slam.py`](https://example.org/book/_modules/pfslam/slam.html)",
    "[out](https://example.org)": "[out](https://example.org)",
    "{doc}`/book/errata`": "[Reading the report critically](https://example.org/book/book/errata.html)",
    "{doc}`slips </book/errata>`, {term}`clouds <cloud>`": "[slips](https://example.org/book/book/errata.html), clouds",
}


@pytest.mark.parametrize("myst", PLAIN)
def test_myst_becomes_plain_markdown(myst):
    assert plain_markdown(myst, iter(["1.5"]), PUBLISHED) == PLAIN[myst]


@pytest.mark.parametrize(
    "strange", ["{kbd}`x`", "{ref}`somewhere`", ":::{figure} a.png\n:::", "[a](../book/no.md)", ":::{tip}\n"]
)
def test_what_has_no_plain_form_is_refused(strange):
    with pytest.raises(DataError):
        plain_markdown(strange, iter([]), PUBLISHED)


def tiny(path, expression="f'{x:.2f}'"):
    """A notebook of three cells that runs in a moment."""
    code = {"cell_type": "code", "metadata": {}, "outputs": [], "execution_count": None}
    sentence = f"{{eval}}`{expression}` m, {{eval}}`x > 0`"
    cells = [
        {**code, "id": "a", "source": "x = 1 / 3"},
        {"cell_type": "markdown", "id": "b", "metadata": {}, "source": sentence},
        {**code, "id": "c", "source": "x = 2"},
    ]
    metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    notebook = {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}
    path.write_text(json.dumps(notebook), encoding="utf-8")
    return path


@pytest.mark.slow
def test_numbers_are_taken_where_they_stand(tmp_path):
    """After the cells above a sentence, before those below it."""
    assert numbers_of(tiny(tmp_path / "tiny.ipynb")) == ["0.33", "True"]


@pytest.mark.slow
def test_numbers_of_the_book_s_build_serve_again_until_something_changes(tmp_path):
    path = tiny(tmp_path / "tiny.ipynb")
    write_numbers(path, ["kept", "kept"], tmp_path)
    assert numbers_of(path, tmp_path) == ["kept", "kept"]
    assert numbers_of(tiny(path, "f'{x:.1f}'"), tmp_path) == ["0.3", "True"]


@pytest.mark.slow
def test_a_name_that_no_cell_made_is_an_error(tmp_path, capsys):
    assert main([str(tmp_path / "out"), str(tiny(tmp_path / "tiny.ipynb", "missing"))]) == 2
    assert "name 'missing' is not defined" in capsys.readouterr().err


def test_an_exercise_without_solution_is_refused(tmp_path, capsys):
    notebook = read(NOTEBOOKS[0])
    notebook["cells"] = [cell for cell in notebook["cells"] if number(cell, SOLUTION) != "1"]
    (tmp_path / "half.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    assert main([str(tmp_path / "out"), str(tmp_path / "half.ipynb")]) == 2
    assert "exercises: found 1 alone" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
