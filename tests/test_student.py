"""Student copies: every stub and check survives, no solution leaks, and nothing but the solutions is missing."""

import ast
import json
from itertools import pairwise
from pathlib import Path

import pytest
from student import (
    EXERCISE,
    POINTER,
    SOLUTION,
    exercises,
    full_copy,
    main,
    number,
    solution_cells,
    source,
    student_copy,
)

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
each_chapter = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))


def code(cells):
    return [cell for cell in cells if cell["cell_type"] == "code"]


def defined(cell) -> set[str]:
    """The functions and variables that a code cell makes at its top level."""
    names = set()
    for node in ast.parse(source(cell)).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        names |= {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    return names


def used(cell) -> set[str]:
    return {node.id for node in ast.walk(ast.parse(source(cell))) if isinstance(node, ast.Name)}


@each_chapter
def test_every_exercise_has_its_stub_its_check_and_one_solution(path):
    notebook = read(path)
    stubs, solutions = exercises(notebook), exercises(notebook, SOLUTION)
    assert stubs.keys() == solutions.keys()
    assert len(stubs) == sum(number(cell, EXERCISE) is not None for cell in notebook["cells"])
    for n, stub in stubs.items():
        checks = [cell for cell in notebook["cells"] if f"check-{n}" in cell["metadata"].get("tags", [])]
        assert any("check_" in source(cell) for cell in [stub, *checks]), f"exercise {n} has no check"
        assert "..." in source(stub) or "None" in source(stub), f"exercise {n} is no stub"
    for before, cell in pairwise(notebook["cells"]):
        assert number(cell, SOLUTION) is None or POINTER in source(before), (
            f"{cell['id']}: no line points at it"
        )


@each_chapter
def test_a_student_copy_lacks_the_solutions_and_nothing_else(path):
    notebook = read(path)
    student, full = student_copy(notebook), full_copy(notebook)
    for n, stub in exercises(notebook).items():
        assert source(exercises(student)[n]) == source(stub)
    assert exercises(student, SOLUTION) == {}
    kept = {cell["id"]: cell for cell in student["cells"]}
    missing = [cell for cell in full["cells"] if cell["id"] not in kept]
    solutions = {cell["id"] for cell in solution_cells(notebook)}
    assert all(cell["id"] in solutions or source(cell).strip().startswith(POINTER) for cell in missing)
    for cell in code(student["cells"]):
        assert source(cell) == source({c["id"]: c for c in notebook["cells"]}[cell["id"]])


@each_chapter
def test_no_solution_and_no_output_leaks(path):
    notebook = read(path)
    student = student_copy(notebook)
    everything = "\n".join(source(cell) for cell in student["cells"])
    assert "_solution" not in everything
    assert POINTER not in everything
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code(student["cells"]))
    stubs = {line.strip() for cell in exercises(notebook).values() for line in source(cell).splitlines()}
    # Code cells may hold the very lines where a chapter shows the package: only those after the first stub count.
    cells = notebook["cells"]
    first = min((i for i, cell in enumerate(cells) if number(cell, EXERCISE)), default=len(cells))
    later = {cell["id"] for cell in cells[first:]}
    after = "\n".join(source(cell) for cell in student["cells"] if cell["id"] in later)
    for solution in solution_cells(notebook):
        for line in map(str.strip, source(solution).splitlines()):
            assert line in stubs or len(line) < 16 or line not in after, f"a line of the solution: {line}"


@each_chapter
def test_the_rest_of_the_chapter_does_not_need_the_solutions(path):
    notebook = read(path)
    hidden = set().union(*map(defined, solution_cells(notebook)))
    cells = code(student_copy(notebook)["cells"])
    hidden -= set().union(*map(defined, cells))
    for cell in cells:
        assert not used(cell) & hidden, f"{cell['id']} uses what only a solution makes"


@each_chapter
def test_a_full_copy_holds_every_cell_in_order(path):
    notebook = read(path)
    copy = full_copy(notebook)
    assert [(c["id"], source(c)) for c in copy["cells"]] == [(c["id"], source(c)) for c in notebook["cells"]]


def test_the_command_writes_the_copies(tmp_path, capsys):
    student, full = tmp_path / "student", tmp_path / "full"
    assert main([str(student), str(NOTEBOOKS[0])]) == 0
    assert main([str(full), "--solutions", str(NOTEBOOKS[0])]) == 0
    assert read(student / NOTEBOOKS[0].name) == student_copy(read(NOTEBOOKS[0]))
    assert read(full / NOTEBOOKS[0].name) == full_copy(read(NOTEBOOKS[0]))
    assert "1 chapters without solutions" in capsys.readouterr().out


def test_an_exercise_without_solution_is_refused(tmp_path, capsys):
    notebook = read(NOTEBOOKS[0])
    notebook["cells"] = [cell for cell in notebook["cells"] if number(cell, SOLUTION) != "1"]
    (tmp_path / "half.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    assert main([str(tmp_path / "out"), str(tmp_path / "half.ipynb")]) == 2
    assert "exercises: found 1 alone" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
