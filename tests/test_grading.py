"""A class that is graded: copies of a chapter, right, wrong, half done and crashing, go through nbgrader.

nbgrader lives in an environment of its own, ``make nightly`` sees to that; elsewhere the test is skipped.
"""

import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from copies import ROOT, exercises, expressions, source, student_copy
from plain import Place

CHAPTER = "00_robot_and_data"
GRADER = Path(sys.prefix) / "nbgrader" / Path(sys.executable).parent.name
STUB = "return ..."


def course_copy():
    """A student's copy of the chapter, and the answers of the printed solutions by the number of the exercise."""
    notebook = json.loads((ROOT / "notebooks" / f"{CHAPTER}.ipynb").read_text(encoding="utf-8"))
    copy = student_copy(notebook, ["1"] * len(expressions(notebook)), Place(ROOT))
    texts = [source(cell) for cell in notebook["cells"]]
    answers = {}
    for n, cell in exercises(copy).items():
        name = source(cell).split("(")[0].removeprefix("def ")
        solution = next(text for text in texts if text.startswith(f"def {name}_solution"))
        answers[n] = solution.partition("\n\n\n")[0].replace(f"{name}_solution", name)
    return copy, answers


def submitted(copy, answers):
    """The copy as a student hands it in."""
    filled = json.loads(json.dumps(copy))
    for n, cell in exercises(filled).items():
        cell["source"] = answers.get(n, source(cell))
    return filled


def of_everybody(copy, right):
    """What six students hand in; the first has copied every cell."""
    wrong = {n: answer.replace("return ", "return 3 + ") for n, answer in right.items()}
    half = dict(list(right.items())[:2])
    crashing = right | {"1": "1 / 0"}
    kinds = {"right": right, "wrong": wrong, "half": half, "crashing": crashing, "untouched": {}}
    handed_in = {who: submitted(copy, answers) for who, answers in kinds.items()}
    cells = [
        twin for cell in handed_in["right"]["cells"] for twin in (cell, {**cell, "id": f"{cell['id']}-copy"})
    ]
    return {"a copier": {**handed_in["right"], "cells": cells}, **handed_in}


@pytest.mark.nightly
def test_nbgrader_gives_a_point_for_each_check_that_passes(tmp_path):
    if not (GRADER / "nbgrader").is_file():
        pytest.skip(f"nbgrader is not in {GRADER}")
    copy, answers = course_copy()
    lesson = CHAPTER[:2]
    for place, notebook in {
        "source": copy,
        **{f"submitted/{who}": of_them for who, of_them in of_everybody(copy, answers).items()},
    }.items():
        file = tmp_path / place / lesson / f"{CHAPTER}.ipynb"
        file.parent.mkdir(parents=True)
        file.write_text(json.dumps(notebook), encoding="utf-8")
    shutil.copy(ROOT / "book" / "_tools" / "nbgrader_config.py", tmp_path)
    paths = {"PATH": os.pathsep.join([str(GRADER), str(Path(sys.executable).parent), os.environ["PATH"]])}
    for words in (["generate_assignment", lesson], ["autograde", lesson], ["export"]):
        done = subprocess.run(
            [GRADER / "nbgrader", *words],
            cwd=tmp_path,
            env=os.environ | paths,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr[-2000:]
    released = json.loads((tmp_path / "release" / lesson / f"{CHAPTER}.ipynb").read_text(encoding="utf-8"))
    assert all(STUB in source(cell) for cell in exercises(released).values())
    with open(tmp_path / "grades.csv", newline="", encoding="utf-8") as file:
        points = {row["student_id"]: float(row["score"]) for row in csv.DictReader(file)}
    assert points == {"a copier": 4, "right": 4, "wrong": 0, "half": 2, "crashing": 3, "untouched": 0}
