"""The table for teachers: every chapter is in it, counted as it stands, and the plan follows from the counts."""

import sys
from pathlib import Path

import nbformat
import pytest
from measure_classroom import content

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "book" / "_ext"))
from classroom import TABLE, chapters_table, exercises, exercises_table, minutes, read, server_text  # noqa: E402

ROWS = read(ROOT / TABLE)
CHAPTERS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def test_every_chapter_is_measured():
    assert [row["chapter"] for row in ROWS] == [path.stem for path in CHAPTERS]


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda p: p.stem)
def test_counts_are_those_of_the_notebook(path):
    """Whoever adds an exercise or a page of text measures again: make classroom."""
    (row,) = (row for row in ROWS if row["chapter"] == path.stem)
    counted = content(nbformat.read(path, as_version=4))
    assert int(row["exercises"]) == counted["exercises"]
    assert int(row["widgets"]) == counted["widgets"]
    assert int(row["words"]) == pytest.approx(counted["words"], rel=0.05)


def test_minutes_and_memory_by_hand():
    row = {"chapter": "01_x", "words": "1200", "widgets": "2", "exercises": "3"}
    row |= {"startup_s": "1.0", "run_s": "30.0", "memory_mb": "256"}
    assert minutes(row) == 50  # 10 + 8 + 30 = 48
    assert "| **50** |" in chapters_table([row])
    assert "need 10 GB" in server_text([row])


def cell(text, *tags):
    """A cell of Markdown, or of code where it has tags."""
    return {"cell_type": "code" if tags else "markdown", "source": text, "metadata": {"tags": list(tags)}}


def test_exercises_by_hand():
    cells = [
        cell("**Exercise 1 (goes into your filter).** Write it."),
        cell("def move(poses):\n    return ...", "exercise-1"),
        cell("def move(poses):\n    return poses", "solution-1"),
        cell("**Exercise 2.** Another."),
        cell("def other():\n    return ...", "exercise-2"),
        cell("**Exercise 3 (explore and explain).** Look.\n\n**Explore and explain.** Again."),
    ]
    assert exercises({"cells": cells}) == (["move", "other"], ["move"], 2)


def test_the_table_has_every_exercise_and_the_parts_of_the_filter():
    text = exercises_table(CHAPTERS)
    parts = {
        name for line in text.splitlines()[2:] for name in line.split("|")[3].replace("`", "").split(",")
    }
    expected = (
        "scan_points to_world cell_of update_log_odds move count_on_walls update resample mean_pose step"
    )
    assert {name.strip() for name in parts} - {""} == set(expected.split())
    for path in CHAPTERS:
        counted = content(nbformat.read(path, as_version=4))["exercises"]
        (line,) = (line for line in text.splitlines() if path.name in line)
        assert line.split("|")[2].count("`") == 2 * counted
